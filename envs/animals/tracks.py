"""Read and validate tables of animal tracks, in which a row is one animal at one time, or one bout of its behaviour."""

import re
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, NamedTuple, NoReturn

import numpy as np
from jaxtyping import Bool, Float, Int, Shaped

from envs.animals.bouts import overlap, sampled
from envs.animals.columns import NUMBER, ColumnMapping
from envs.animals.spacing import check_spacing
from envs.animals.tables import SUFFIXES, Found, Table, find_tables, read_table
from envs.animals.times import CLOCK, HALF_A_DAY, read_times

LONGEST_LABEL = 200  # characters; what is longer is no label, but a column of text
ABSENT = ("", "NA", "NaN", "nan")  # how tables write a coordinate that is missing

_COORDINATE = NUMBER.pattern
_VECTOR = re.compile(rf"\[{_COORDINATE};{_COORDINATE};{_COORDINATE}\]", re.ASCII)
_SET = re.compile(r"\{(?:[^;{}]+(?:;[^;{}]+)*)?\}")


class Tracks(NamedTuple):
    """All rows, ordered by recording, individual and time. A position is NaN where it is missing."""

    recording: Shaped[np.ndarray, " R"]
    site: Shaped[np.ndarray, " R"]  # the camera
    individual: Shaped[np.ndarray, " R"]  # unique within its recording only
    group: Shaped[np.ndarray, " R"]
    time: Float[np.ndarray, " R"]
    behaviour: Shaped[np.ndarray, " R"]
    place: Shaped[np.ndarray, " R"]
    position: Float[np.ndarray, "R 3"]
    close: Int[np.ndarray, " R"]  # number of close neighbours
    distant: Int[np.ndarray, " R"]

    def take(self, rows: Shaped[np.ndarray, " Q"]) -> "Tracks":
        return Tracks(*(column[rows] for column in self))


class Parsed(NamedTuple):
    """The rows of one table; a bout is a row for each of its samples."""

    tracks: Tracks
    bouts: int = 0  # rows of the table, where a row is a bout
    bouts_without_sample: int = 0  # events, and bouts so short that they end before their first sample


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
    parts, row_names, stops = [], [], {}
    for file in found.tables:
        table = read_table(file)
        parts.append(parse(table, mapping))
        row_names += [file] if table.row_names else []
        stops |= dict.fromkeys(name for name in table.columns if re.search(r"\b(stop|end)\b", name, re.IGNORECASE))
        for recording in np.unique(parts[-1].tracks.recording).tolist():
            if seen.setdefault(recording, file) != file:
                raise ValueError(f"{file}: recording {recording!r} is also in {seen[recording]}")
    tracks = Tracks(*(np.concatenate(columns) for columns in zip(*(part.tracks for part in parts), strict=True)))
    if "stop" not in mapping.columns:
        check_spacing(np.diff(tracks.time)[~new_track(tracks)], mapping.step, tuple(stops))
    return Reading(
        tracks, found, tuple(row_names), sum(part.bouts for part in parts), sum(part.bouts_without_sample for part in parts)
    )


def parse(table: Table, mapping: ColumnMapping) -> Parsed:
    """Read our columns of one table. Raises ValueError, in one line with file, row and column, for the first bad value."""
    check = _Checker(table, mapping)
    number = len(table.row)
    blank = np.full(number, "")
    recording = np.full(number, table.file.stem)
    if mapping.recording != "file":
        recording = check.labels(mapping.recording)
    sites = {name: re.search(mapping.site, name) if mapping.site else None for name in np.unique(recording).tolist()}
    group = check.members("group", mapping.groups + mapping.other_groups) if "group" in check.names else blank
    behaviour_free = np.isin(group, mapping.other_groups) if mapping.other_groups else np.zeros(number, dtype=bool)
    time, kind = check.times("time")
    tracks = Tracks(
        recording=recording,
        site=np.array([(match[1] or "") if (match := sites[name]) else "" for name in recording.tolist()]),
        individual=check.labels(check.names["individual"]),
        group=group,
        time=time,
        behaviour=check.members("behaviour", mapping.behaviours, behaviour_free, mapping.no_behaviour),
        place=check.members("place", mapping.places) if "place" in check.names else blank,
        position=check.positions(mapping),
        close=check.set_sizes("close") if "close" in check.names else np.zeros(number, dtype=np.int64),
        distant=check.set_sizes("distant") if "distant" in check.names else np.zeros(number, dtype=np.int64),
    )
    if kind is CLOCK:
        check.midnight(tracks)
    order = np.lexsort((tracks.time, tracks.individual, tracks.recording))
    if "stop" in check.names:
        return _sampled(tracks, order, mapping, check)
    tracks = tracks.take(order)
    again = np.append(False, ~new_track(tracks) & (tracks.time[1:] == tracks.time[:-1]))
    if again.any():
        check.fail(int(order[again].min()), check.names["time"], "repeats a time of its track")
    return Parsed(tracks)


def _sampled(tracks: Tracks, order: Int[np.ndarray, " R"], mapping: ColumnMapping, check: "_Checker") -> Parsed:
    """Sample bouts at the multiples of the mapping's step. Raises ValueError where two of a track overlap or one ends early."""
    stop, _ = check.times("stop", like="time")
    early = np.flatnonzero(stop < tracks.time)
    if len(early):
        check.fail(int(early[0]), check.names["stop"], "is before the bout's start")
    lasting = order[(stop > tracks.time)[order]]  # the others are events
    bouts, stop = tracks.take(lasting), stop[lasting]
    at = overlap(new_track(bouts), bouts.time, stop)
    if at is not None:
        row = check.table.row[lasting[at]]
        check.fail(
            int(lasting[at + 1]), check.names["time"], f"begins before the bout of row {row} has ended, in the same track"
        )
    rows, times = sampled(bouts.time, stop, mapping.step, str(check.table.file))
    return Parsed(bouts.take(rows)._replace(time=times), len(order), len(order) - len(np.unique(rows)))


def new_track(tracks: Tracks) -> Bool[np.ndarray, " Q"]:
    """Say of each row but the first whether another track begins there."""
    return (tracks.recording[1:] != tracks.recording[:-1]) | (tracks.individual[1:] != tracks.individual[:-1])


class _Checker:
    """Read the columns of one table; raise ValueError for the first bad row with file, row, column and value."""

    def __init__(self, table: Table, mapping: ColumnMapping) -> None:
        self.table = table
        self.names: dict[str, str] = {ours: name for ours, name in mapping.columns.items() if ours != "coordinates"}
        coordinates = mapping.columns.get("coordinates", ())
        self.coordinates = [coordinates] if isinstance(coordinates, str) else list(coordinates)
        extra = [] if mapping.recording == "file" else [mapping.recording]
        for name in [*self.names.values(), *self.coordinates, *extra]:
            if name not in table.columns:
                has = ", ".join(table.columns)
                raise ValueError(f"{table.file}: row 1, column {name!r}: missing; the file has {has}")
            if name in table.repeated:
                raise ValueError(f"{table.file}: row 1, column {name!r}: more than one column has this name")
            if not table.columns[name]:
                raise ValueError(f"{table.file}: row 2: no rows below the header")
            if name not in self.coordinates:
                self._each(name, lambda text: text != "", "is empty")

    def fail(self, position: int, name: str, what: str) -> NoReturn:
        """Refuse the value at a position of a column."""
        value, row = self.table.columns[name][position], self.table.row[position]
        shown = repr(value if len(value) <= LONGEST_LABEL else value[:LONGEST_LABEL] + "…")
        raise ValueError(f"{self.table.file}: row {row}, column {name!r}: {shown} {what}")

    def _each(self, name: str, good: Callable[[str], Any], what: str) -> None:
        for position, text in enumerate(self.table.columns[name]):
            if not good(text):
                self.fail(position, name, what)

    def labels(self, name: str) -> Shaped[np.ndarray, " R"]:
        self._each(name, lambda text: len(text) <= LONGEST_LABEL, f"is longer than {LONGEST_LABEL} characters, and no label")
        return np.array(self.table.columns[name])

    def members(
        self,
        ours: str,
        known: Sequence[str],
        excused: Shaped[np.ndarray, " R"] | None = None,
        excuse: str = "",
    ) -> Shaped[np.ndarray, " R"]:
        """Read a column of labels; the rows in `excused` may also have the label `excuse`."""
        name = self.names[ours]
        values = self.labels(name)
        bad = ~np.isin(values, known) if known else np.zeros(len(values), dtype=bool)
        if excused is not None:
            bad &= ~(excused & (values == excuse))
        if bad.any():
            self.fail(int(bad.argmax()), name, f"is unknown; choose from {', '.join(known)}")
        return values

    def times(self, ours: str, like: str = "") -> tuple[Float[np.ndarray, " R"], Any]:
        """Read a column of times, which are written as those of the column `like`."""
        name = self.names[ours]
        times, kind = read_times(self.table.columns[name], lambda position, what: self.fail(position, name, what))
        if like and kind is not self.times(like)[1]:
            self.fail(0, name, f"is {kind.words}, and {self.names[like]!r} is not")
        return times, kind

    def midnight(self, tracks: Tracks) -> None:
        """Refuse times of day that begin anew within a track: its rows would come in another order."""
        last: dict[tuple[str, str], float] = {}
        for position, track in enumerate(zip(tracks.recording.tolist(), tracks.individual.tolist(), strict=True)):
            if tracks.time[position] < last.get(track, 0.0) - HALF_A_DAY:
                self.fail(position, self.names["time"], "passes midnight; choose dates with the time of day")
            last[track] = tracks.time[position]

    def positions(self, mapping: ColumnMapping) -> Float[np.ndarray, "R 3"]:
        """Read three coordinates: NaN where one is empty or the mapping marks them as missing, 0 for a third that it lacks."""
        position = np.full((len(self.table.row), 3), np.nan)
        if isinstance(mapping.columns.get("coordinates"), str):
            name = self.coordinates[0]
            texts = self.table.columns[name]
            self._each(name, lambda text: text in ABSENT or _VECTOR.fullmatch(text), "is not [x;y;z]")
            position = np.array([[np.nan] * 3 if text in ABSENT else text[1:-1].split(";") for text in texts], dtype=np.float64)
        elif self.coordinates:
            position[:] = 0.0
            position[:, : len(self.coordinates)] = np.stack([self._coordinate(name) for name in self.coordinates], axis=1)
        if np.isinf(position).any():
            wrong = np.argwhere(np.isinf(position))[0]
            self.fail(int(wrong[0]), self.coordinates[min(int(wrong[1]), len(self.coordinates) - 1)], "is not a finite number")
        missing = np.isnan(position).any(axis=1)
        if mapping.missing_coordinates:
            missing |= (position[:, : len(mapping.missing_coordinates)] == mapping.missing_coordinates).all(axis=1)
        position[missing] = np.nan
        return position

    def _coordinate(self, name: str) -> Float[np.ndarray, " R"]:
        self._each(name, lambda text: text in ABSENT or NUMBER.fullmatch(text), "is not a number")
        return np.array([np.nan if text in ABSENT else float(text) for text in self.table.columns[name]])

    def set_sizes(self, ours: str) -> Int[np.ndarray, " R"]:
        """Read sets such as `{1;2}` as their numbers of members."""
        name = self.names[ours]
        self._each(name, _SET.fullmatch, "is not {a;b;…}")
        return np.array([0 if text == "{}" else text.count(";") + 1 for text in self.table.columns[name]], dtype=np.int64)
