"""The behaviour model: a hazard of leaving times a reward of where to go, both by likelihood.

log π(c' | x) = log(1 − h(x)) where c' = c, else log h(x) + log softmax_{possible c''} u(x, c'') [c'].
The two parts share no parameter, so each is fitted alone; both problems are convex.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int

from aircl_jax.animals import features as of_step
from aircl_jax.animals.features import LEAVING, Features
from aircl_jax.animals.going import MODEL, Choices, Weights, choices_of, fit_going
from aircl_jax.animals.leaving import Known, fit_leaving
from envs.animals.full.observation import OLDEST
from envs.animals.full.steps import COMPANY, NONE, Recordings
from envs.animals.rows.cells import cells_of

TEMPO = "tempo"  # the group of columns that depends on which recordings are trained on


class Design(NamedTuple):
    """Everything that is known at every step and change of one data set, as columns."""

    recordings: Recordings
    cells: Features  # [G] of leaving, but for tempo
    cell: Int[np.ndarray, " N"]  # of every step
    has_tempo: bool
    choices: Choices
    left: Bool[np.ndarray, " N"]

    def leaving(self, trained: Bool[np.ndarray, " R"]) -> Known:
        """Compute the columns of leaving; the rates that tempo compares with are the trained recordings'."""
        if self.has_tempo:
            return Known(self.cells, self.cell, of_step.tempo(self.recordings, trained))
        return Known(self.cells, self.cell, of_step.named(np.zeros((len(self.cell), 0)), (), 1.0))


class Behaviour(NamedTuple):
    """What was fitted: the weights of leaving with their names, and those of where to go."""

    leaving: Float[np.ndarray, " K"]
    leaving_names: tuple[str, ...]
    going: Weights


def leaving_groups(recordings: Recordings) -> tuple[str, ...]:
    """List the groups of columns of leaving that these tables allow."""
    return (*of_step.available(LEAVING, recordings), TEMPO)


def design(
    recordings: Recordings, leaving: tuple[str, ...] | None = None, going: tuple[str, ...] = MODEL, strength: float = 1.0
) -> Design:
    """Compute the columns of these groups, by default of all that the tables allow; `strength` multiplies every ridge."""
    groups = leaving_groups(recordings) if leaving is None else leaving
    columns, cell = leaving_cells(recordings, [name for name in groups if name != TEMPO])
    choices = choices_of(recordings, going)
    return Design(
        recordings,
        columns._replace(ridge=columns.ridge * strength),
        cell,
        TEMPO in groups,
        choices._replace(ridge=Weights(*(strength * part for part in choices.ridge))),
        recordings.steps.code != recordings.steps.following,
    )


def leaving_cells(recordings: Recordings, groups: Sequence[str]) -> tuple[Features, Int[np.ndarray, " N"]]:
    """Compute the columns of these groups once for all steps that look the same, and number each step's cell."""
    steps = recordings.steps
    seen = steps._replace(age=np.minimum(steps.age, OLDEST))
    cells = cells_of(seen.columns(("code", "age", "unseen", "previous", "place", *COMPANY)))
    at = recordings._replace(steps=steps.take(cells.first))
    return of_step.leaving_features(at, groups), cells.of


def fit(
    columns: Design,
    leaving: Known,
    trained: Bool[np.ndarray, " R"],
    rows: Bool[np.ndarray, " N"] | None = None,
    start: Behaviour | None = None,
) -> Behaviour:
    """Fit both parts to the `trained` recordings, whose columns of leaving are given, to all their steps or to `rows` alone."""
    use = trained[columns.recordings.steps.recording].astype(np.float64)
    if rows is not None:
        use *= rows
    weights = fit_leaving(leaving, columns.left, use, None if start is None else start.leaving)
    of_rows = columns.choices.weighed(use[columns.choices.change])
    going = fit_going(columns.choices, of_rows, None if start is None else start.going)
    return Behaviour(weights, leaving.names, going)


def reward_by_place(recordings: Recordings, going: Weights, nowhere: bool = False) -> Float[np.ndarray, "P C"]:
    """Compute r(place, c') = T₀ + T_place, less its mean over the behaviours; one row for everywhere without places.

    With `nowhere` a last row, T₀ less its mean, is of no known place.
    """
    table, has_places = going.table, "places" not in recordings.lacks
    reward = table[0] + table[1 : 1 + len(recordings.places)] if has_places else table[:1]
    if nowhere and has_places:
        reward = np.append(reward, table[:1], axis=0)
    return reward - reward[:, : recordings.num_behaviours].mean(axis=1, keepdims=True)


def begun_at(recordings: Recordings) -> Float[np.ndarray, "P C"]:
    """Count how often each activity was begun at each place; one row for everywhere where the tables name no place."""
    steps, has_places = recordings.steps, "places" not in recordings.lacks
    changed = steps.code != steps.following
    begun = np.zeros((max(len(recordings.places), 1) if has_places else 1, len(recordings.names)))
    here = np.flatnonzero(changed & (steps.place != NONE) if has_places else changed)
    where = steps.place[here] if has_places else np.zeros(len(here), np.int64)
    np.add.at(begun, (where, steps.following[here]), 1.0)
    return begun
