"""List every step of every gap-free segment: what is known of an animal at a row, and the code of the next row."""

from collections.abc import Sequence
from typing import Any, Literal, NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int, Shaped

from envs.animals.columns import ColumnMapping
from envs.animals.rows.labels import Labels, constant, taken
from envs.animals.tracks import Tracks, new_track
from envs.animals.windows import STAYS, Coded, Coding

NONE = STAYS  # index of no code or no place
MOVING_TO = "moving to "
Lack = Literal["places", "positions", "neighbours", "names", "groups", "sites", "recordings"]
LACKS: dict[Lack, str] = {
    "places": "The tables name no places: no reward by place, no trips.",
    "positions": "The tables have no positions: what distance costs is not asked.",
    "neighbours": "The tables count no neighbours: nothing is known of company.",
    "names": "The tables do not say who the neighbours are: what they do is not seen.",
    "groups": "The tables have one group of animals only.",
    "sites": "The tables have one site only.",
    "recordings": "There is one recording only: animals are held out in its place, and what is of that day is taken for all.",
}


COMPANY = ("close", "distant", "close_doing", "distant_doing")


class Steps(NamedTuple):
    """What is known at each row that has a next one. Rows are in order of recording, animal and time.

    Arrays of NumPy, or of JAX where a policy sees them.
    """

    code: Int[Any, " N"]
    following: Int[Any, " N"]  # the code one row later
    age: Int[Any, " N"]  # rows since the first seen of this bout, itself counted
    unseen: Bool[Any, " N"]  # whether the bout began before the segment
    previous: Int[Any, " N"]  # code of the bout before this one; NONE where it was not seen
    place: Int[Any, " N"]
    position: Float[Any, "N 2"]  # on the ground, in the mapping's unit; NaN where unknown
    close: Int[Any, " N"]  # number of close neighbours
    distant: Int[Any, " N"]
    close_doing: Shaped[Any, "N B"]  # of them, how many show each behaviour; the last column counts all others
    distant_doing: Shaped[Any, "N B"]
    recording: Int[Any, " N"]
    site: Int[Any, " N"]
    track: Int[Any, " N"]  # an animal in a recording
    segment: Int[Any, " N"]  # a gap-free run of a track
    window: Int[Any, " N"]  # which window of `horizon` steps holds it (`envs.animals.windows.cut_windows`); NONE

    def take(self, rows: Int[Any, " Q"]) -> "Steps":
        return Steps(*(taken(column, rows) for column in self))

    def columns(self, names: Sequence[str]) -> list[Int[np.ndarray, " N"]]:
        """List the columns of these names, whose numbers are whole; each behaviour of the neighbours is one."""
        whole = [np.asarray(getattr(self, name)) for name in names]
        whole = [column.astype(np.int64) if column.dtype.kind in "fb" else column for column in whole]
        return [part for column in whole for part in (column.T if column.ndim == 2 else [column])]

    @property
    def in_window(self) -> Bool[np.ndarray, " N"]:
        return self.window != NONE


class Recordings(NamedTuple):
    """The steps of one data set with the names of their indices, and what the tables lack."""

    steps: Steps
    names: tuple[str, ...]  # of the codes: behaviours, then "moving to PLACE"
    behaviour_of: Int[np.ndarray, " C"]  # the behaviour of each code
    destination: Int[np.ndarray, " C"]  # the place that a code moves to; NONE for the others
    moving: str  # the behaviour that leads from place to place; empty where there is none
    places: tuple[str, ...]
    recordings: tuple[str, ...]
    sites: tuple[str, ...]
    sight: Bool[np.ndarray, "K P"]  # places that some row of each site is at or moves to
    one_move: Bool[np.ndarray, " C"]  # codes of which two in a row would be one bout
    seconds: float  # between two rows, in the unit of the table's time
    unit: str  # of positions
    lacks: tuple[Lack, ...]
    simulated: bool

    @property
    def num_behaviours(self) -> int:
        return int((self.destination == NONE).sum())


def recordings_of(
    coded: Coded,
    mapping: ColumnMapping,
    coding: Coding = "bout",
    *,
    doing: tuple[Int[np.ndarray, "R B"], Int[np.ndarray, "R B"]] | None = None,
    horizon: int = 30,
    simulated: bool = False,
) -> Recordings:
    """List the steps of coded rows; `doing` counts the behaviours of each row's close and distant neighbours.

    Where there is one recording only, its animals take the place of recordings. Raises ValueError where no animal has two
    rows without a gap, or none ever changes.
    """
    moves_to = np.array([MOVING_TO + place for place in coded.places] if mapping.moving else [], dtype=str)
    size, num_behaviours = len(coded.names), len(coded.names) - len(moves_to)
    destination = np.append(np.full(num_behaviours, NONE), np.arange(len(moves_to)))
    plain_move = coded.names.index(mapping.moving) if mapping.moving in coded.names else NONE
    behaviour_of = np.where(destination == NONE, np.arange(size), max(plain_move, 0))
    rows = coded.tracks
    recording_names, recording = _used(rows.recording)
    site_names, site = _used(rows.site)
    begins = np.append(True, new_track(rows))
    track = np.cumsum(begins, dtype=np.int32) - 1
    lacks = _lacks(mapping, rows, doing is not None, len(recording_names), len(site_names))
    if "recordings" in lacks:
        recording, recording_names = track, tuple(rows.individual[begins].texts().tolist())
    here = np.flatnonzero(np.append(coded.segment[1:] == coded.segment[:-1], False))
    if not len(here):
        raise ValueError("no animal has two rows in a row without a gap: check the time column and `step` of the mapping")
    ground = _ground(rows.position, mapping)
    nobody = constant(np.zeros(num_behaviours + 1, np.int16), len(rows.time))
    close_doing, distant_doing = doing or (nobody, nobody)
    age, unseen, previous = _bouts(coded)
    following = np.append(coded.code[1:], np.array(NONE, coded.code.dtype))
    columns = (coded.code, following, age, unseen, previous, coded.place, ground)
    columns += (rows.close, rows.distant, close_doing, distant_doing, recording, site, track)
    columns += (coded.segment, _windows(coded, horizon))
    steps = Steps(*(taken(column, here) for column in columns))
    if (steps.code == steps.following).all():
        raise ValueError(f"no animal changes its behaviour within a segment of {len(here)} steps: there is nothing to learn")
    return Recordings(
        steps=steps,
        sight=_sight(steps, destination, len(coded.places), len(site_names)),
        names=coded.names,
        behaviour_of=behaviour_of,
        destination=destination,
        moving=mapping.moving,
        places=coded.places,
        recordings=recording_names,
        sites=site_names,
        one_move=((destination != NONE) | (np.arange(size) == plain_move)) & (coding == "bout"),
        seconds=mapping.step,
        unit=mapping.coordinate_unit,
        lacks=lacks,
        simulated=simulated,
    )


def _used(labels: Labels) -> tuple[tuple[str, ...], Int[np.ndarray, " R"]]:
    """Return the labels that some row has, and the number of each row's."""
    names = tuple(labels.counts())
    return names, labels.recoded({name: number for number, name in enumerate(names)})


def _ground(position: Float[np.ndarray, "R 3"], mapping: ColumnMapping) -> Float[np.ndarray, "R 2"]:
    """Take the two coordinates that span the ground, in the mapping's unit."""
    if "coordinates" not in mapping.columns:
        return constant(np.full(2, np.nan), len(position))
    return position[:, list(mapping.map_axes)] / mapping.coordinate_scale


def _lacks(mapping: ColumnMapping, rows: Tracks, named: bool, num_recordings: int, num_sites: int) -> tuple[Lack, ...]:
    absent: dict[Lack, bool] = {
        "places": "place" not in mapping.columns,
        "positions": "coordinates" not in mapping.columns or not np.isfinite(rows.position).all(axis=1).any(),
        "neighbours": not {"close", "distant"} & set(mapping.columns),
        "names": not named,
        "groups": not mapping.other_groups,
        "sites": num_sites < 2,
        "recordings": num_recordings < 2,
    }
    return tuple(name for name, missing in absent.items() if missing)


def _bouts(coded: Coded) -> tuple[Int[np.ndarray, " R"], Bool[np.ndarray, " R"], Int[np.ndarray, " R"]]:
    """Find each row's age in its bout, whether the bout's beginning is unseen, and the code of the bout before it."""
    row = np.arange(len(coded.code), dtype=np.int32)
    new_segment = np.append(True, coded.segment[1:] != coded.segment[:-1])
    begins = new_segment | np.append(True, coded.code[1:] != coded.code[:-1])
    onset = np.maximum.accumulate(np.where(begins, row, 0))
    unseen = new_segment[onset]
    previous = np.where(unseen, np.array(NONE, coded.code.dtype), coded.code[np.maximum(onset - 1, 0)])
    return row - onset + 1, unseen, previous


def _windows(coded: Coded, horizon: int) -> Int[np.ndarray, " R"]:
    """Number the window that each row is a step of, as `cut_windows` does; NONE for the rest of a segment."""
    size = np.bincount(coded.segment)
    first, number = np.append(0, np.cumsum(size)[:-1]), (size - 1) // horizon
    within = np.arange(len(coded.segment)) - first[coded.segment]
    window = (np.cumsum(number) - number)[coded.segment] + within // horizon
    return np.where(within < (number * horizon)[coded.segment], window, NONE).astype(np.int32)


def _sight(steps: Steps, destination: Int[np.ndarray, " C"], places: int, sites: int) -> Bool[np.ndarray, "K P"]:
    """Mark the places that each site's animals are seen at or move to: a move may end where no row of a segment was."""
    seen = np.zeros((sites, max(places, 1)), dtype=bool)
    for place in (steps.place, destination[steps.following]):
        seen[steps.site[place != NONE], place[place != NONE]] = True
    return seen


def possible_changes(recordings: Recordings) -> Bool[Any, "N C"]:
    """Mark the codes that can follow at each step: another one, no second move in a row, no place out of the camera's sight.

    Steps of NumPy or of JAX.
    """
    steps, size = recordings.steps, len(recordings.names)
    xp = steps.code.__array_namespace__()
    stays, moves = np.arange(size) == steps.code[:, None], xp.asarray(recordings.one_move)
    in_sight = xp.asarray(recordings.sight)[steps.site][:, np.maximum(recordings.destination, 0)]
    return ~stays & ~(moves[steps.code][:, None] & moves) & ((recordings.destination == NONE) | in_sight)
