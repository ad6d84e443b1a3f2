"""Describe each step by numbers: what may decide whether an animal leaves its activity. What a table lacks is left out."""

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int

from aircl_jax.animals.steps import Lack, Recordings

OLDEST = 120  # rows; older bouts count as this old
YOUNG = (1, 2, 5)  # rows: the first, the first two, the first five of a bout
TEMPO_ROWS = 10.0  # pseudo-rows of an activity's rate of leaving
TEMPO_CHANGES = 2.0  # pseudo-changes of an animal's tempo


class Features(NamedTuple):
    """Columns of a log-linear model with their names and their ridges λ, the inverse variances of a normal prior."""

    values: Float[np.ndarray, "N K"]
    names: tuple[str, ...]
    ridge: Float[np.ndarray, " K"]


def one_hot(index: Int[np.ndarray, " N"], size: int) -> Float[np.ndarray, "N S"]:
    """Code indices as rows of 0 and 1; NONE is a row of 0."""
    return (index[:, None] == np.arange(size)).astype(np.float64)


def named(values: Float[np.ndarray, "N K"], names: Sequence[str], ridge: float) -> Features:
    return Features(values, tuple(names), np.full(len(names), ridge))


def joined(blocks: Sequence[Features]) -> Features:
    """Set blocks of columns side by side."""
    values, names, ridge = zip(*blocks, strict=True)
    return Features(np.concatenate(values, axis=1), sum(names, ()), np.concatenate(ridge))


def log_age(recordings: Recordings) -> Float[np.ndarray, " N"]:
    return np.log(np.minimum(recordings.steps.age, OLDEST))


def somebody(recordings: Recordings) -> Float[np.ndarray, "N B"]:
    """Mark the behaviours that some close or distant neighbour shows."""
    steps = recordings.steps
    return ((steps.close_doing + steps.distant_doing)[:, :-1] > 0).astype(np.float64)


def doing_the_same(recordings: Recordings, doing: Float[np.ndarray, "N B"]) -> Bool[np.ndarray, " N"]:
    """Mark the steps at which a neighbour shows the behaviour of the animal itself."""
    own = recordings.behaviour_of[recordings.steps.code]
    return doing[np.arange(len(own)), own] > 0


def _activity(recordings: Recordings) -> Features:
    codes = one_hot(recordings.steps.code, len(recordings.names))
    every = np.ones((len(codes), 1))
    return joined([named(every, ["always"], 0.01), named(codes, [f"in {name}" for name in recordings.names], 1.0)])


def _age(recordings: Recordings) -> Features:
    steps, log = recordings.steps, log_age(recordings)
    unseen = steps.unseen.astype(np.float64)
    young = [(steps.age <= rows) * (1 - unseen) for rows in YOUNG]
    names = ["log age", "beginning unseen", "log age, beginning unseen", *(f"first {rows} rows" for rows in YOUNG)]
    return named(np.stack([log, unseen, unseen * log, *young], axis=1), names, 1.0)


def _age_by_activity(recordings: Recordings) -> Features:
    steps, size = recordings.steps, len(recordings.names)
    codes, log = one_hot(steps.code, size), log_age(recordings)
    values = np.concatenate([codes * log[:, None], codes * steps.unseen[:, None]], axis=1)
    names = [f"log age in {name}" for name in recordings.names] + [f"beginning unseen in {name}" for name in recordings.names]
    return named(values, names, 3.0)


def _previous(recordings: Recordings) -> Features:
    names = [f"after {name}" for name in recordings.names]
    return named(one_hot(recordings.steps.previous, len(names)), names, 5.0)


def _place(recordings: Recordings) -> Features:
    return named(one_hot(recordings.steps.place, len(recordings.places)), [f"at {place}" for place in recordings.places], 5.0)


def _company(recordings: Recordings) -> Features:
    steps = recordings.steps
    values = np.stack([np.log1p(steps.close), np.log1p(steps.distant)], axis=1)
    return named(values, ["log number close", "log number distant"], 1.0)


def _doing(recordings: Recordings) -> Features:
    steps = recordings.steps
    same = [doing_the_same(recordings, doing) for doing in (steps.close_doing, steps.distant_doing)]
    names = ["a close one does the same", "a distant one does the same"]
    shown = [f"somebody shows {name}" for name in recordings.names[: recordings.num_behaviours]]
    blocks = [named(np.stack(same, axis=1).astype(np.float64), names, 1.0), named(somebody(recordings), shown, 5.0)]
    return joined(blocks)


def _others(recordings: Recordings) -> Features:
    return named((recordings.steps.close_doing[:, -1:] > 0).astype(np.float64), ["one of another group close"], 1.0)


LEAVING: dict[str, tuple[Callable[[Recordings], Features], tuple[Lack, ...]]] = {
    "activity": (_activity, ()),
    "age": (_age, ()),
    "age by activity": (_age_by_activity, ()),
    "previous activity": (_previous, ()),
    "place": (_place, ("places",)),
    "company": (_company, ("neighbours",)),
    "neighbours' behaviour": (_doing, ("names",)),
    "other groups": (_others, ("names", "groups")),
}
"""Groups of columns that may decide whether to leave, and what of the tables each needs; tempo is `tempo`'s."""


def available(table: dict[str, tuple[Callable, tuple[Lack, ...]]], recordings: Recordings) -> tuple[str, ...]:
    """List the groups that the tables have all columns for."""
    return tuple(name for name, (_, needs) in table.items() if not set(needs) & set(recordings.lacks))


def leaving_features(recordings: Recordings, groups: Sequence[str]) -> Features:
    """Compute the columns of these groups of LEAVING."""
    return joined([LEAVING[name][0](recordings) for name in groups])


def tempo(recordings: Recordings, trained: Bool[np.ndarray, " R"]) -> Features:
    """Compute log((changes seen + 2) / (changes expected + 2)) of each animal before now: how restless it has been.

    What is expected are the rates of leaving each activity in the `trained` recordings, the animal's own left out.
    """
    steps, size = recordings.steps, len(recordings.names)
    left = (steps.code != steps.following).astype(np.float64)
    changes, rows = np.zeros((2, len(recordings.recordings), size))
    np.add.at(changes, (steps.recording, steps.code), left)
    np.add.at(rows, (steps.recording, steps.code), 1.0)
    kept_changes, kept_rows = (array * trained[:, None] for array in (changes, rows))
    other_changes, other_rows = (kept.sum(axis=0) - kept for kept in (kept_changes, kept_rows))
    everywhere = other_changes.sum(axis=1, keepdims=True) / np.maximum(other_rows.sum(axis=1, keepdims=True), 1.0)
    rate = (other_changes + TEMPO_ROWS * everywhere) / (other_rows + TEMPO_ROWS)
    seen = _before(left, steps.track)
    expected = _before(rate[steps.recording, steps.code], steps.track)
    return named(np.log((seen + TEMPO_CHANGES) / (expected + TEMPO_CHANGES))[:, None], ["tempo so far"], 1.0)


def _before(values: Float[np.ndarray, " N"], track: Int[np.ndarray, " N"]) -> Float[np.ndarray, " N"]:
    """Sum the values of a track before each step."""
    total = np.cumsum(values) - values
    first = np.append(True, track[1:] != track[:-1])
    return total - total[np.maximum.accumulate(np.where(first, np.arange(len(track)), 0))]
