"""The behaviour model: a hazard of leaving times a reward of where to go, both by likelihood.

log π(c' | x) = log(1 − h(x)) where c' = c, else log h(x) + log softmax_{possible c''} u(x, c'') [c'].
The two parts share no parameter, so each is fitted alone; both problems are convex.
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float

from aircl_jax.animals import features as of_step
from aircl_jax.animals.features import LEAVING, Features
from aircl_jax.animals.going import MODEL, Choices, Weights, choices_of, fit_going, log_going
from aircl_jax.animals.leaving import fit_leaving, log_leaving
from envs.animals.full.steps import NONE, Recordings

TEMPO = "tempo"  # the group of columns that depends on which recordings are trained on


class Design(NamedTuple):
    """Everything that is known at every step and change of one data set, as columns."""

    recordings: Recordings
    columns: Features  # of leaving, but for tempo
    has_tempo: bool
    choices: Choices
    left: Bool[np.ndarray, " N"]

    def leaving(self, trained: Bool[np.ndarray, " R"]) -> Features:
        """Compute the columns of leaving; the rates that tempo compares with are the trained recordings'."""
        if not self.has_tempo:
            return self.columns
        return of_step.joined([self.columns, of_step.tempo(self.recordings, trained)])


class Behaviour(NamedTuple):
    """What was fitted: the weights of leaving with their names, and those of where to go."""

    leaving: Float[np.ndarray, " K"]
    leaving_names: tuple[str, ...]
    going: Weights


class Prediction(NamedTuple):
    """Of every step: log-probability of staying or leaving as it did, of going where it went (0 where it stayed), and h."""

    whether: Float[np.ndarray, " N"]
    where: Float[np.ndarray, " N"]
    hazard: Float[np.ndarray, " N"]


def leaving_groups(recordings: Recordings) -> tuple[str, ...]:
    """List the groups of columns of leaving that these tables allow."""
    return (*of_step.available(LEAVING, recordings), TEMPO)


def design(
    recordings: Recordings, leaving: tuple[str, ...] | None = None, going: tuple[str, ...] = MODEL, strength: float = 1.0
) -> Design:
    """Compute the columns of these groups, by default of all that the tables allow; `strength` multiplies every ridge."""
    groups = leaving_groups(recordings) if leaving is None else leaving
    columns = of_step.leaving_features(recordings, [name for name in groups if name != TEMPO])
    choices = choices_of(recordings, going)
    return Design(
        recordings,
        columns._replace(ridge=columns.ridge * strength),
        TEMPO in groups,
        choices._replace(ridge=Weights(*(strength * part for part in choices.ridge))),
        recordings.steps.code != recordings.steps.following,
    )


def fit(
    columns: Design,
    trained: Bool[np.ndarray, " R"],
    rows: Bool[np.ndarray, " N"] | None = None,
    start: Behaviour | None = None,
) -> Behaviour:
    """Fit both parts to the `trained` recordings, to all their steps or to the `rows` alone."""
    use = trained[columns.recordings.steps.recording].astype(np.float64)
    if rows is not None:
        use = use * rows
    leaving = columns.leaving(trained)
    weights = fit_leaving(leaving, columns.left, use, None if start is None else start.leaving)
    going = fit_going(columns.choices, use[columns.choices.step], None if start is None else start.going)
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
    where = steps.place if has_places else np.zeros_like(steps.place)
    here = changed & (where != NONE)
    np.add.at(begun, (where[here], steps.following[here]), 1.0)
    return begun


def predict(columns: Design, behaviour: Behaviour, trained: Bool[np.ndarray, " R"]) -> Prediction:
    """Compute the log-probability of what every animal did at every step."""
    whether, hazard = log_leaving(columns.leaving(trained), behaviour.leaving, columns.left)
    where = np.zeros(len(whether))
    where[columns.choices.step] = log_going(columns.choices, behaviour.going)
    return Prediction(whether, where, hazard)
