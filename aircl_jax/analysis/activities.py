"""Collect what the row that is fitted to whole recordings has found, as arrays over its seeds."""

from typing import NamedTuple

import jax
import numpy as np
from jaxtyping import Bool, Float
from scipy.special import expit

from aircl_jax.animals.behaviour import begun_at
from aircl_jax.animals.changes import Changes, log_bayes, p_of
from aircl_jax.runs.result import Result
from aircl_jax.types import TrainState
from envs import Activities
from envs.animals.full.steps import Recordings, possible_changes

FORBIDDEN_BELOW = 0.5  # δ₁ under which a change counts as avoided


class Found(NamedTuple):
    """Of every bootstrap sample: rewards, n, M and δ₁ of every change; and what all recordings show."""

    recordings: Recordings  # those that were learned from
    reward: Float[np.ndarray, "S P C"]  # r(place, c') less its mean over the behaviours at that place
    begun: Float[np.ndarray, "P C"]  # changes to c' at each place
    delta: Float[np.ndarray, "S C C"]
    expected: Float[np.ndarray, "S C C"]  # M in each sample
    made: Float[np.ndarray, "C C"]  # n in all recordings
    possible: Bool[np.ndarray, "C C"]

    @property
    def middle(self) -> Float[np.ndarray, "C C"]:
        """The median M over samples; it is the greater the more other ways into an activity a sample flags."""
        return np.median(self.expected, axis=0)


def found_of(result: Result) -> Found:
    """Collect what was found. Raises TypeError for a run that was not fitted to whole recordings."""
    return collect(result.spec.env.view, result.states)


def collect(view: object, states: TrainState) -> Found:
    """Collect what was found from the states, [S, …]."""
    if not isinstance(view, Activities):
        raise TypeError("the run was not fitted to whole recordings")
    recordings = view.recordings
    params = jax.device_get(states.params)
    reward, test = params.reward["params"]["reward"], params.feasibility["step"]["params"]
    steps, size = recordings.steps, len(recordings.names)
    changed = steps.code != steps.following
    made, possible = np.zeros((size, size)), np.zeros((size, size), dtype=bool)
    np.add.at(made, (steps.code[changed], steps.following[changed]), 1.0)
    np.logical_or.at(possible, steps.code[changed], possible_changes(recordings)[changed])
    return Found(
        recordings,
        np.asarray(reward, np.float64)[:, : max(reward.shape[1] - 1, 1)],
        begun_at(recordings),
        expit(np.asarray(test["logit"], np.float64)),
        np.asarray(test["expected"], np.float64),
        made,
        possible,
    )


def as_changes(found: Found) -> Changes:
    """Set n of all recordings beside the samples' median M, as the test of changes has them; groups are not counted."""
    expected = found.middle
    nobody = np.zeros(expected.shape, dtype=np.int64)
    posterior = 1.0 - found.delta.mean(axis=0)
    return Changes(
        found.made,
        expected,
        log_bayes(found.made, expected),
        posterior * found.possible,
        p_of(found.made, expected),
        found.possible,
        nobody,
        nobody,
    )


def maps_of_activities(view: object, states: TrainState) -> dict[str, np.ndarray]:
    """Collect the arrays of recovered.npz."""
    found = collect(view, states)
    return {
        "activities": np.array(found.recordings.names),
        "places": np.array(found.recordings.places),
        "reward": found.reward,
        "begun": found.begun,
        "delta": found.delta,
        "expected": found.expected,
        "made": found.made,
        "possible": found.possible,
    }
