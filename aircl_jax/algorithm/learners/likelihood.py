"""Fit the behaviour model by likelihood, in double precision and outside PPO: one convex problem, no rollouts.

Each seed is fitted to a bootstrap sample of the recordings, drawn with replacement, and judged on those that were not drawn.
"""

from collections.abc import Callable
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int, PRNGKeyArray
from scipy.special import logit

from aircl_jax.algorithm.measures import FINITE
from aircl_jax.animals.behaviour import leaving_cells, reward_by_place
from aircl_jax.animals.changes import LAPSE, Changes, avoided_changes, ruled_out
from aircl_jax.animals.counting import counts_by_recording, smoothed_chain
from aircl_jax.animals.features import LEAVING, available, tempo_column
from aircl_jax.animals.going import MODEL, ORDINARY, Choices, Weights, choices_of, fit_going, log_going
from aircl_jax.animals.leaving import Known, fit_leaving, log_leaving
from aircl_jax.model.networks import Networks
from aircl_jax.types import Metrics, ObsStats, TrainState, Trajectory
from envs import Activities
from envs.animals.full.observation import read
from envs.animals.full.steps import Recordings

LEAST_SHARE = 1e-6  # of a posterior, so that its logit is finite
_NO_REPLAY = Trajectory(*[jnp.zeros(())] * 8)


class Judged(NamedTuple):
    """The fit on the recordings that were not drawn, in nats; NaN before the fit, and where all were drawn."""

    held_out_log_prob: Float[Array, ""]  # a step
    held_out_chain_gain: Float[Array, ""]  # a step, over the smoothed first-order chain of the same sample
    held_out_whether_gain: Float[Array, ""]  # a step: whether to leave
    held_out_where_gain: Float[Array, ""]  # a change: where to go
    held_out_recordings: Float[Array, ""]  # how many were not drawn


class Steps(NamedTuple):
    """As `Trainer` has them; `step` computes on the host and cannot be traced."""

    init: Callable[[PRNGKeyArray, Trajectory], TrainState]
    step: Callable[[TrainState, Trajectory], tuple[TrainState, Metrics]]


class Sample(NamedTuple):
    """The steps of D_E in double precision, and how often each one's recording was drawn."""

    recordings: Recordings
    leaving: Known
    choices: Choices
    times: Float[np.ndarray, " R"]
    weight: Float[np.ndarray, " N"]


def make_steps(nets: Networks) -> Steps:
    """Make the two functions of a seed: nothing is known at first, and the first step fits everything."""

    def init(key: PRNGKeyArray, expert: Trajectory) -> TrainState:
        size = expert.obs.shape[-1]
        undefined = Judged(*[jnp.full((), jnp.nan)] * len(Judged._fields))
        stats = ObsStats(jnp.zeros(size), jnp.ones(size))  # columns are seen as they are
        return TrainState(nets.init(key), (), undefined, stats, _NO_REPLAY, key, jnp.zeros((), jnp.int32))

    def step(state: TrainState, expert: Trajectory) -> tuple[TrainState, Metrics]:
        if state.step == 0:
            params, judged = _fitted(nets, state, jax.device_get(expert))
            state = state._replace(params=params, adversary_opt=judged)
        return state._replace(step=state.step + 1), {**state.adversary_opt._asdict(), FINITE: jnp.ones(())}

    return Steps(init, step)


def draw_recordings(key: PRNGKeyArray, number: int) -> Float[np.ndarray, " R"]:
    """Draw as many recordings as there are, with replacement; return how often each was drawn. One alone stays."""
    drawn = jax.random.randint(jax.random.fold_in(key, 1), (number,), 0, number)
    return np.bincount(np.asarray(drawn), minlength=number).astype(np.float64)


def _fitted(nets: Networks, state: TrainState, expert: Trajectory) -> tuple[Any, Judged]:
    sample = _sample(nets, state.key, expert)
    steps, choices = sample.recordings.steps, sample.choices
    left, ordinary = steps.code != steps.following, choices_of(sample.recordings, ORDINARY)
    of_changes = sample.weight[choices.change]
    changes = avoided_changes(ordinary, sample.recordings, ordinary.weighed(of_changes))
    going = fit_going(ruled_out(choices, changes.flagged), choices.weighed(of_changes))
    leaving = fit_leaving(sample.leaving, left, sample.weight)
    offset = np.log(LAPSE) * changes.flagged
    params = _params(sample.recordings, leaving, going, changes, offset)
    like = jax.tree.map(lambda new, old: jnp.asarray(new, old.dtype).reshape(old.shape), params, {**_like(state.params)})
    return state.params._replace(**like), _judged(sample, leaving, going, offset)


def _like(params: Any) -> dict[str, Any]:
    return {name: getattr(params, name) for name in ("policy", "reward", "feasibility")}


def _sample(nets: Networks, key: PRNGKeyArray, expert: Trajectory) -> Sample:
    view, recorded = nets.env.view, nets.env.recorded
    assert isinstance(view, Activities)  # noqa: S101
    assert recorded is not None  # noqa: S101
    assert recorded.groups is not None  # noqa: S101
    here = np.asarray(expert.mask) > 0
    names, group = np.unique(recorded.groups(), return_inverse=True)
    recordings, tempo = read(np.asarray(expert.obs, np.float64)[here], view.recordings)
    recording: Int[np.ndarray, " N"] = np.broadcast_to(group[:, None], here.shape)[here]
    following = np.asarray(expert.action, np.int64)[here]
    recordings = recordings._replace(
        steps=recordings.steps._replace(following=following, recording=recording),
        recordings=tuple(view.recordings.recordings[name] for name in names),
    )
    times = draw_recordings(key, len(names))
    leaving = Known(*leaving_cells(recordings, available(LEAVING, recordings)), tempo_column(tempo))
    return Sample(recordings, leaving, choices_of(recordings, MODEL), times, times[recording])


def _params(
    recordings: Recordings,
    leaving: Float[np.ndarray, " K"],
    going: Weights,
    changes: Changes,
    offset: Float[np.ndarray, "C C"],
) -> dict[str, Any]:
    posterior = np.clip(changes.posterior, LEAST_SHARE, 1 - LEAST_SHARE)
    test = {"logit": -logit(posterior), "made": changes.made, "expected": changes.expected}
    return {
        "policy": {"params": {**going._asdict(), "leaving": leaving, "offset": offset}},
        "reward": {"params": {"reward": reward_by_place(recordings, going, nowhere=True)}},
        "feasibility": {"step": {"params": test}},
    }


def _judged(sample: Sample, leaving: Float[np.ndarray, " K"], going: Weights, offset: Float[np.ndarray, "C C"]) -> Judged:
    steps, choices = sample.recordings.steps, sample.choices
    left, held = steps.code != steps.following, sample.weight == 0
    whether = log_leaving(sample.leaving, leaving, left)[0]
    where = np.zeros(len(whether))
    where[choices.change] = log_going(choices, going, offset)[choices.row]
    counts = counts_by_recording(sample.recordings, np.ones(len(left))) * sample.times[:, None, None]
    chain = smoothed_chain(counts, sample.times > 0)[0]
    stay = np.diag(chain)[steps.code]
    chain_whether = np.where(left, np.log1p(-np.exp(stay)), stay)
    chain_where = chain[steps.code, steps.following] - chain_whether
    values = (whether + where, whether + where - chain_whether - chain_where, whether - chain_whether)
    means = [float(value[held].mean()) if held.any() else np.nan for value in values]
    changed = held & left
    means.append(float((where - chain_where)[changed].mean()) if changed.any() else np.nan)
    return Judged(*(jnp.asarray(mean, jnp.float32) for mean in (*means, float((sample.times == 0).sum()))))
