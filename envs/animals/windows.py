"""Turn tracks into windows of codes: gap-free segments, "moving to PLACE" codes, windows, and a report of all rows."""

from dataclasses import dataclass
from typing import Literal, NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int, Shaped

from envs.animals.columns import ColumnMapping
from envs.animals.rows.labels import Labels, small
from envs.animals.spacing import one_step
from envs.animals.tracks import Tracks, new_track

Coding = Literal["bout", "step"]

STAYS = -1  # index of no place


@dataclass(frozen=True)
class Report:
    """Counts of rows: of other groups, in short segments, after the last window, and used; these four add up to all."""

    recordings: int
    rows: int
    rows_of_other_groups: int  # pups: their behaviour is not annotated
    rows_without_coordinates: int  # among all rows; masked, not dropped
    tracks: int  # tracks of the groups in use, each unique within its recording only
    segments: int  # gap-free runs of a track
    longest_segment: int  # rows
    rows_in_short_segments: int  # segments shorter than one window
    rows_after_last_window: int  # the rest of longer segments
    rows_used: int
    windows: int


class Windows(NamedTuple):
    """Windows of L = horizon + 1 rows; neighbours share one row, so that no transition is lost or repeated."""

    code: Int[np.ndarray, "N L"]
    place: Int[np.ndarray, "N L"]  # index into `places`
    close: Int[np.ndarray, "N L"]  # number of close neighbours
    distant: Int[np.ndarray, "N L"]
    recording: Shaped[np.ndarray, " N"]
    site: Shaped[np.ndarray, " N"]
    names: tuple[str, ...]  # of the codes
    places: tuple[str, ...]
    report: Report


class Coded(NamedTuple):
    """The rows in use, each with its gap-free segment, its code and its place."""

    tracks: Tracks
    segment: Int[np.ndarray, " R"]
    code: Int[np.ndarray, " R"]
    place: Int[np.ndarray, " R"]
    names: tuple[str, ...]
    places: tuple[str, ...]


def code_rows(tracks: Tracks, mapping: ColumnMapping, coding: Coding = "bout", other_groups: bool = False) -> Coded:
    """Code the rows: behaviours, then "moving to PLACE" for every place, then one code for rows without annotation.

    With `bout`, a whole run of moving that ends in another place becomes moving to that place. The end is the place of the
    first row after the run, or of its last row at the end of its segment. Other moving stays plain. With `step`, only the
    row before the place changes becomes moving to the new place.

    Raises ValueError where no row is of the groups in use, and where the behaviour that moves is none of the rows'.
    """
    others = tracks.group.are(*mapping.other_groups) if mapping.other_groups else np.zeros(len(tracks.time), dtype=bool)
    rows = tracks if other_groups or not others.any() else tracks.take(~others)
    annotated = ~others | ~tracks.behaviour.are(mapping.no_behaviour) if other_groups else ~others
    if not annotated.any():
        raise ValueError(f"all {len(others)} rows are of other_groups, {', '.join(mapping.other_groups)}; choose other groups")
    behaviours = mapping.behaviours or _by_share(tracks.behaviour[annotated])
    if mapping.moving and mapping.moving not in behaviours:
        raise ValueError(f"moving: {mapping.moving!r} is no behaviour of the tables; choose from {', '.join(behaviours)}")
    places = mapping.places or tuple(sorted(set(tracks.place.counts()) - {""}))
    names = behaviours + (tuple(f"moving to {place}" for place in places) if mapping.moving else ())
    index = {name: code for code, name in enumerate(behaviours)}
    if other_groups and mapping.other_groups:
        index[mapping.no_behaviour] = len(names)
        names += (f"{'/'.join(mapping.other_groups)}: not annotated",)
    behaviour = rows.behaviour.recoded(index)
    place = rows.place.recoded({name: code for code, name in enumerate(places)}, STAYS)
    segment = np.append(np.zeros(1, np.int32), np.cumsum(new_track(rows) | ~one_step(rows.time, mapping.step), dtype=np.int32))
    if mapping.moving:
        target = _TARGETS[coding](behaviour, place, segment)
        moving_there = (behaviour == index.get(mapping.moving, STAYS)) & (target != STAYS)
        behaviour = small(np.where(moving_there, len(behaviours) + target.astype(np.int64), behaviour))
    return Coded(rows, segment, behaviour, place, names, places)


def _by_share(labels: Labels) -> tuple[str, ...]:
    """Order labels by falling frequency, ties by name."""
    counts = labels.counts()
    return tuple(sorted(counts, key=lambda name: (-counts[name], name)))


def _bout_target(
    behaviour: Int[np.ndarray, " R"], place: Int[np.ndarray, " R"], segment: Int[np.ndarray, " R"]
) -> Int[np.ndarray, " R"]:
    """Find the place where each row's bout ends; STAYS where that is the place where it begins."""
    begins = _run_starts(behaviour, segment)
    first = np.flatnonzero(begins)
    last = np.append(first[1:] - 1, len(begins) - 1)
    after = np.minimum(last + 1, len(begins) - 1)
    end = np.where(segment[after] == segment[last], place[after], place[last])
    return np.where(end != place[first], end, STAYS)[np.cumsum(begins) - 1]


def _step_target(
    behaviour: Int[np.ndarray, " R"], place: Int[np.ndarray, " R"], segment: Int[np.ndarray, " R"]
) -> Int[np.ndarray, " R"]:
    """Find the place one row later; STAYS where it is the same place."""
    after = np.append(place[1:], STAYS)
    continues = np.append(segment[1:] == segment[:-1], False)
    return np.where(continues & (after != place), after, STAYS)


_TARGETS = {"bout": _bout_target, "step": _step_target}


def _run_starts(values: Int[np.ndarray, " R"], segment: Int[np.ndarray, " R"]) -> Bool[np.ndarray, " R"]:
    """Mark the first row of every run of equal values inside a segment."""
    same = (values[1:] == values[:-1]) & (segment[1:] == segment[:-1])
    return np.append(np.ones(min(len(values), 1), dtype=bool), ~same)


class Transitions(NamedTuple):
    """Every change of code inside a segment: from the first row of one bout to the first row of the next."""

    source: Int[np.ndarray, " M"]
    target: Int[np.ndarray, " M"]
    start: Float[np.ndarray, "M 3"]  # position where the first bout begins, NaN where unknown
    end: Float[np.ndarray, "M 3"]  # position where the second begins
    recording: Shaped[np.ndarray, " M"]
    site: Shaped[np.ndarray, " M"]


def transitions(coded: Coded) -> Transitions:
    """List the behaviour transitions of the paper's Section 6, with the positions of their two onsets."""
    onset = np.flatnonzero(_run_starts(coded.code, coded.segment))
    inside = coded.segment[onset[1:]] == coded.segment[onset[:-1]]
    source, target = onset[:-1][inside], onset[1:][inside]
    return Transitions(
        source=coded.code[source],
        target=coded.code[target],
        start=coded.tracks.position[source],
        end=coded.tracks.position[target],
        recording=coded.tracks.recording[source].texts(),
        site=coded.tracks.site[source].texts(),
    )


def cut_windows(coded: Coded, tracks: Tracks, horizon: int = 30) -> Windows:
    """Cut windows of horizon + 1 coded rows, one every `horizon` rows of a segment. Raises ValueError where none fits."""
    size = np.bincount(coded.segment)
    first = np.append(0, np.cumsum(size)[:-1])
    number = (size - 1) // horizon
    starts = np.concatenate([first[k] + horizon * np.arange(number[k]) for k in range(len(size))])
    if not len(starts):
        raise ValueError(f"no segment of {horizon + 1} rows without a gap; the longest has {size.max()}: shorten the horizon")
    rows = starts[:, None] + np.arange(horizon + 1)
    used = int((number * horizon + (number > 0)).sum())
    short = int(size[number == 0].sum())
    report = Report(
        recordings=len(tracks.recording.counts()),
        rows=len(tracks.time),
        rows_of_other_groups=len(tracks.time) - len(coded.code),
        rows_without_coordinates=int(np.isnan(tracks.position[:, 0]).sum()),
        tracks=1 + int(new_track(coded.tracks).sum()),
        segments=len(size),
        longest_segment=int(size.max()),
        rows_in_short_segments=short,
        rows_after_last_window=len(coded.code) - short - used,
        rows_used=used,
        windows=len(starts),
    )
    return Windows(
        code=coded.code[rows],
        place=coded.place[rows],
        close=coded.tracks.close[rows],
        distant=coded.tracks.distant[rows],
        recording=coded.tracks.recording[starts].texts(),
        site=coded.tracks.site[starts].texts(),
        names=coded.names,
        places=coded.places,
        report=report,
    )
