"""Read and validate tables of animal tracks, in which a row is one animal at one time, or one bout of its behaviour."""

import re
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int, Shaped

from envs.animals.bouts import overlap, sampled
from envs.animals.columns import ColumnMapping
from envs.animals.rows.checker import Checker, passes_midnight, refuse, row_of
from envs.animals.rows.labels import Labels, constant, small, taken, together
from envs.animals.spacing import check_spacing
from envs.animals.tables import SUFFIXES, Found, find_tables, read_pieces
from envs.animals.times import CLOCK, Kind

_STOPS = re.compile(r"\b(stop|end)\b", re.IGNORECASE)


class Tracks(NamedTuple):
    """All rows, ordered by recording, individual and time. A position is NaN where it is missing."""

    recording: Labels
    site: Labels  # the camera
    individual: Labels  # unique within its recording only
    group: Labels
    time: Float[np.ndarray, " R"]
    behaviour: Labels
    place: Labels
    position: Float[np.ndarray, "R 3"]
    close: Int[np.ndarray, " R"]  # number of close neighbours
    distant: Int[np.ndarray, " R"]

    def take(self, rows: Shaped[np.ndarray, " Q"]) -> "Tracks":
        return Tracks(*(taken(column, rows) for column in self))

    @staticmethod
    def joined(parts: "Sequence[Tracks]") -> "Tracks":
        return Tracks(*(together(columns) for columns in zip(*parts, strict=True)))


class Parsed(NamedTuple):
    """The rows of one table; a bout is a row for each of its samples."""

    tracks: Tracks
    bouts: int = 0  # rows of the table, where a row is a bout
    bouts_without_sample: int = 0  # events, and bouts so short that they end before their first sample
    names: tuple[str, ...] = ()  # of the table's columns
    row_names: bool = False  # whether a column of row names was left out


class Reading(NamedTuple):
    """What a folder held: all rows, and what was noted on the way."""

    tracks: Tracks
    found: Found
    row_names: tuple[Path, ...] = ()  # tables with a column of row names that the header does not name
    bouts: int = 0
    bouts_without_sample: int = 0


def read_folder(folder: Path, mapping: ColumnMapping) -> Reading:
    """Read every table in and below `folder`. Raises ValueError where none is there, one is malformed or two overlap."""
    found = find_tables(folder)
    if not found.tables:
        hidden = f"; {len(found.hidden)} are hidden and not read" if found.hidden else ""
        raise ValueError(f"{folder}: no table of tracks in or below it; looked for {', '.join(SUFFIXES)}{hidden}")
    seen: dict[str, Path] = {}
    parts: list[Parsed] = []
    for file in found.tables:
        parts.append(parse(file, mapping))
        for recording in parts[-1].tracks.recording.counts():
            if seen.setdefault(recording, file) != file:
                raise ValueError(f"{file}: recording {recording!r} is also in {seen[recording]}")
    tracks = parts[0].tracks if len(parts) == 1 else Tracks.joined([part.tracks for part in parts])
    if "stop" not in mapping.columns:
        stops = tuple(dict.fromkeys(name for part in parts for name in part.names if _STOPS.search(name)))
        check_spacing(np.diff(tracks.time)[~new_track(tracks)], mapping.step, stops)
    row_names = tuple(file for file, part in zip(found.tables, parts, strict=True) if part.row_names)
    return Reading(
        tracks, found, row_names, sum(part.bouts for part in parts), sum(part.bouts_without_sample for part in parts)
    )


def parse(file: Path, mapping: ColumnMapping) -> Parsed:
    """Read our columns of one table, piece by piece.

    Raises ValueError, in one line with file, row and column, for the first bad value.
    """
    parts, stops, kind, check = [], [], None, None
    for table in read_pieces(file):
        check = Checker(table, mapping)
        tracks, kind = _columns(check, mapping, kind)
        parts.append(tracks)
        if "stop" in check.names:
            stops.append(check.stops(kind))
    if check is None:
        raise TypeError(f"{file}: a table has at least one piece")
    tracks = parts[0] if len(parts) == 1 else Tracks.joined(parts)
    del parts
    if kind is CLOCK:
        at = passes_midnight(tracks.recording.index, tracks.individual.index, tracks.time)
        if at is not None:
            refuse(file, mapping, at, "time", "passes midnight; choose dates with the time of day")
    order = np.lexsort((tracks.time, tracks.individual.index, tracks.recording.index))
    about = {"names": tuple(check.table.columns), "row_names": check.table.row_names}
    if "stop" in check.names:
        return _sampled(tracks, np.concatenate(stops), order, mapping, file)._replace(**about)
    tracks = tracks.take(order)
    again = np.append(False, ~new_track(tracks) & (tracks.time[1:] == tracks.time[:-1]))
    if again.any():
        refuse(file, mapping, int(order[again].min()), "time", "repeats a time of its track")
    return Parsed(tracks, **about)


def _columns(check: Checker, mapping: ColumnMapping, kind: Kind | None) -> tuple[Tracks, Kind]:
    """Read and check the rows of a piece in the order of the table; `kind` is that of the times before."""
    number = len(check.table.row)
    blank, zero = Labels.same("", number), constant(np.zeros((), np.int32), number)
    recording = Labels.same(check.table.file.stem, number) if mapping.recording == "file" else check.labels(mapping.recording)
    sites = {name: re.search(mapping.site, name) if mapping.site else None for name in recording.names}
    cameras = [(match[1] or "") if (match := sites[name]) else "" for name in recording.names]
    site = Labels(tuple(sorted(set(cameras))), small(np.array([sorted(set(cameras)).index(name) for name in cameras])))
    group = check.members("group", mapping.groups + mapping.other_groups) if "group" in check.names else blank
    behaviour_free = group.are(*mapping.other_groups) if mapping.other_groups else np.zeros(number, dtype=bool)
    time, kind = check.times("time", kind)
    tracks = Tracks(
        recording=recording,
        site=Labels(site.names, taken(site.index, recording.index)),
        individual=check.labels(check.names["individual"]),
        group=group,
        time=time,
        behaviour=check.members("behaviour", mapping.behaviours, behaviour_free, mapping.no_behaviour),
        place=check.members("place", mapping.places) if "place" in check.names else blank,
        position=check.positions(mapping),
        close=check.set_sizes("close") if "close" in check.names else zero,
        distant=check.set_sizes("distant") if "distant" in check.names else zero,
    )
    return tracks, kind


def _sampled(
    tracks: Tracks, stop: Float[np.ndarray, " R"], order: Int[np.ndarray, " R"], mapping: ColumnMapping, file: Path
) -> Parsed:
    """Sample bouts at the multiples of the mapping's step. Raises ValueError where two of a track overlap or one ends early."""
    early = np.flatnonzero(stop < tracks.time)
    if len(early):
        refuse(file, mapping, int(early[0]), "stop", "is before the bout's start")
    lasting = order[(stop > tracks.time)[order]]  # the others are events
    bouts, stop = tracks.take(lasting), stop[lasting]
    at = overlap(new_track(bouts), bouts.time, stop)
    if at is not None:
        earlier = row_of(file, int(lasting[at]))
        what = f"begins before the bout of row {earlier} has ended, in the same track"
        refuse(file, mapping, int(lasting[at + 1]), "time", what)
    rows, times = sampled(bouts.time, stop, mapping.step, str(file))
    return Parsed(bouts.take(rows)._replace(time=times), len(order), len(order) - len(np.unique(rows)))


def new_track(tracks: Tracks) -> Bool[np.ndarray, " Q"]:
    """Say of each row but the first whether another track begins there."""
    return tracks.recording.differ() | tracks.individual.differ()
