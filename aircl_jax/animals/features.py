"""Describe each step by numbers: what may decide whether an animal leaves its activity. What a table lacks is left out.

The steps may be arrays of NumPy, to be fitted to, or of JAX, as a policy sees them; the columns are of the same kind.
"""

from collections.abc import Callable, Sequence
from typing import NamedTuple

import jax
import numpy as np
from jaxtyping import Bool, Float, Int, Shaped

from envs.animals.full.observation import OLDEST
from envs.animals.full.steps import Lack, Recordings
from envs.animals.full.tempo import tempo_of

YOUNG = (1, 2, 5)  # rows: the first, the first two, the first five of a bout

Numbers = np.ndarray | jax.Array


class Features(NamedTuple):
    """Columns of a log-linear model with their names and their ridges λ, the inverse variances of a normal prior."""

    values: Float[Numbers, "N K"]
    names: tuple[str, ...]
    ridge: Float[np.ndarray, " K"]


def one_hot(index: Int[Numbers, " N"], size: int) -> Float[Numbers, "N S"]:
    """Code indices as rows of 0 and 1; NONE is a row of 0."""
    return (index[:, None] == np.arange(size)) * 1.0


def named(values: Float[Numbers, "N K"], names: Sequence[str], ridge: float) -> Features:
    return Features(values, tuple(names), np.full(len(names), ridge))


def joined(blocks: Sequence[Features]) -> Features:
    """Set blocks of columns side by side."""
    values, names, ridge = zip(*blocks, strict=True)
    xp = values[0].__array_namespace__()
    return Features(xp.concat(values, axis=1), sum(names, ()), np.concatenate(ridge))


def log_age(recordings: Recordings) -> Float[Numbers, " N"]:
    xp = recordings.steps.age.__array_namespace__()
    return xp.log(xp.minimum(recordings.steps.age, OLDEST))


def somebody(recordings: Recordings) -> Float[Numbers, "N B"]:
    """Mark the behaviours that some close or distant neighbour shows."""
    steps = recordings.steps
    return ((steps.close_doing + steps.distant_doing)[:, :-1] > 0) * 1.0


def doing_the_same(recordings: Recordings, doing: Shaped[Numbers, "N B"]) -> Bool[Numbers, " N"]:
    """Mark the steps at which a neighbour shows the behaviour of the animal itself."""
    xp = doing.__array_namespace__()
    own = xp.asarray(recordings.behaviour_of)[recordings.steps.code]
    return xp.take_along_axis(doing, own[:, None], axis=1)[:, 0] > 0


def _activity(recordings: Recordings) -> Features:
    codes = one_hot(recordings.steps.code, len(recordings.names))
    always = named(codes.sum(axis=1, keepdims=True), ["always"], 0.01)
    return joined([always, named(codes, [f"in {name}" for name in recordings.names], 1.0)])


def _age(recordings: Recordings) -> Features:
    steps, log = recordings.steps, log_age(recordings)
    xp, unseen = log.__array_namespace__(), steps.unseen * 1.0
    young = [(steps.age <= rows) * (1 - unseen) for rows in YOUNG]
    names = ["log age", "beginning unseen", "log age, beginning unseen", *(f"first {rows} rows" for rows in YOUNG)]
    return named(xp.stack([log, unseen, unseen * log, *young], axis=1), names, 1.0)


def _age_by_activity(recordings: Recordings) -> Features:
    steps, size = recordings.steps, len(recordings.names)
    codes, log = one_hot(steps.code, size), log_age(recordings)
    values = log.__array_namespace__().concat([codes * log[:, None], codes * steps.unseen[:, None]], axis=1)
    names = [f"log age in {name}" for name in recordings.names] + [f"beginning unseen in {name}" for name in recordings.names]
    return named(values, names, 3.0)


def _previous(recordings: Recordings) -> Features:
    names = [f"after {name}" for name in recordings.names]
    return named(one_hot(recordings.steps.previous, len(names)), names, 5.0)


def _place(recordings: Recordings) -> Features:
    return named(one_hot(recordings.steps.place, len(recordings.places)), [f"at {place}" for place in recordings.places], 5.0)


def _company(recordings: Recordings) -> Features:
    steps = recordings.steps
    xp = steps.close.__array_namespace__()
    values = xp.stack([xp.log1p(steps.close * 1.0), xp.log1p(steps.distant * 1.0)], axis=1)
    return named(values, ["log number close", "log number distant"], 1.0)


def _doing(recordings: Recordings) -> Features:
    steps = recordings.steps
    same = [doing_the_same(recordings, doing) for doing in (steps.close_doing, steps.distant_doing)]
    names = ["a close one does the same", "a distant one does the same"]
    shown = [f"somebody shows {name}" for name in recordings.names[: recordings.num_behaviours]]
    stacked = same[0].__array_namespace__().stack(same, axis=1)
    blocks = [named(stacked * 1.0, names, 1.0), named(somebody(recordings), shown, 5.0)]
    return joined(blocks)


def _others(recordings: Recordings) -> Features:
    return named((recordings.steps.close_doing[:, -1:] > 0) * 1.0, ["one of another group close"], 1.0)


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
    """Compute how restless each animal has been before now, against the rates of leaving in the `trained` recordings."""
    return tempo_column(tempo_of(recordings, trained))


def tempo_column(values: Float[Numbers, " N"]) -> Features:
    return named(values[:, None], ["tempo so far"], 1.0)
