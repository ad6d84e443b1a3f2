"""What the figures show of a finished run, computed from its states: fresh episodes, their δ̄, and a grid's maps."""

from functools import partial
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from aircl_jax.algorithm.rollout import rollouts
from aircl_jax.algorithm.sampler import SAMPLERS, take
from aircl_jax.algorithm.scoring import trajectory_feasibility
from aircl_jax.demonstrations.soft_optimal import occupancy, soft_value_iteration
from aircl_jax.model.feasibility import log_step_feasibility
from aircl_jax.model.networks import Networks
from aircl_jax.runs.result import Result
from aircl_jax.types import Scores, TrainState, Trajectory
from envs import Env, Tabular

MAX_EPISODES = 200  # fresh ones of each seed's policy: enough for a picture
ONCE = {"xla_backend_optimization_level": 0}  # compiles faster, for what runs once and is small
KEY_FIGURES = 1  # folded into a state's key: other episodes than the evaluation's


class Evidence(NamedTuple):
    """Of every seed: fresh episodes of π, draws of q among them, and δ̄ of π's episodes and of the reference set."""

    policy: Trajectory  # [S, N, T, …]
    sampled: Trajectory  # [S, N, T, …]
    delta_policy: Float[np.ndarray, "S N"]
    delta_reference: Float[np.ndarray, "S M"]


class GridEvidence(NamedTuple):
    """Of every seed: f(c, a), δ₁(c, a), and how often π is in each cell c, exactly; and the expert's occupancy."""

    reward: Float[np.ndarray, "S C A"]
    step_delta: Float[np.ndarray, "S C A"]
    occupancy: Float[np.ndarray, "S C"]
    expert_occupancy: Float[np.ndarray, " C"]


def gather(result: Result) -> Evidence:
    """Roll out, score and draw, all seeds at once."""
    one_seed = partial(_evidence, result.networks, min(MAX_EPISODES, result.spec.config.num_evaluation))
    options = ONCE if result.spec.env.tabular is not None else None
    run = jax.jit(jax.vmap(one_seed, (0, None)), compiler_options=options)
    return Evidence(*jax.device_get(run(result.states, result.reference)))


def gather_grid(result: Result, table: Tabular) -> GridEvidence:
    """The maps of a world whose observations are one-hot; recordings, and one's own, stand for the exact expert."""
    maps = jax.jit(jax.vmap(partial(_grid_maps, result.networks, table)), compiler_options=ONCE)(result.states)
    if result.spec.own is None and result.spec.env.recorded is None:
        seen = jax.jit(partial(_expert_occupancy, result.spec.env, table), compiler_options=ONCE)()
    else:
        seen = result.expert.obs[0].mean(axis=(0, 1))
    return GridEvidence(*jax.device_get((*maps, seen)))


def infeasible(trajectories: Trajectory) -> Bool[np.ndarray, "*S N"]:
    """Which trajectories have a violation in any unmasked step."""
    return np.asarray((np.asarray(trajectories.cost) * np.asarray(trajectories.mask)).max(axis=-1) > 0)


def _evidence(nets: Networks, number: int, state: TrainState, reference: Trajectory) -> tuple:
    params, stats = state.params, state.obs_stats
    key_policy, key_sampler = jax.random.split(jax.random.fold_in(jax.random.fold_in(state.key, KEY_FIGURES), state.step))
    policy = rollouts(nets.env, nets, params, stats, key_policy, number)
    log_delta = trajectory_feasibility(nets, params, stats, policy)
    if nets.method.sampled_from == "policy":
        sampled = policy
    else:
        sampled = take(policy, SAMPLERS[nets.config.adversary.sampler](log_delta, number, key_sampler))
    reference_log_delta = trajectory_feasibility(nets, params, stats, reference)
    return policy, sampled, jnp.exp(log_delta), jnp.exp(reference_log_delta)


def _grid_maps(
    nets: Networks, table: Tabular, state: TrainState
) -> tuple[Float[Array, "C A"], Float[Array, "C A"], Float[Array, " C"]]:
    env, params, stats = nets.env, state.params, state.obs_stats
    actions = jnp.arange(table.reward.shape[1])
    cells = jnp.eye(env.obs_size)

    def maps(obs: Float[Array, " O"], action: Array) -> tuple[Array, Array]:
        logit = nets.step_logit(params.feasibility, stats, obs, action)
        scores = Scores(jnp.zeros(1), jnp.zeros(1), logit[None], jnp.zeros(()), jnp.ones(1), params.thresholds)
        log_step = log_step_feasibility(nets.method, nets.config.coefficients, scores)
        return nets.reward(params.reward, stats, obs, action), jnp.exp(log_step[0])

    def log_policy(t: Array, obs: Float[Array, " O"]) -> Array:
        return jax.vmap(lambda action: jnp.asarray(nets.policy(params.policy, stats, obs, t).log_prob(action)))(actions)

    reward, step_delta = jax.vmap(jax.vmap(maps, (None, 0)), (0, None))(cells, actions)
    along = jax.vmap(jax.vmap(log_policy, (None, 0)), (0, None))(jnp.arange(env.horizon), table.obs)
    return reward, step_delta, (occupancy(table, along) @ table.obs).mean(axis=0)


def _expert_occupancy(env: Env, table: Tabular) -> Float[Array, " C"]:
    planned = soft_value_iteration(table, table.reward, env.horizon, env.expert_temperature, forbid=True)
    return (occupancy(table, planned.log_policy) @ table.obs).mean(axis=0)
