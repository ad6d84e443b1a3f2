"""Compute what the figures show of a finished run from its states: fresh episodes, their δ̄, and a grid's maps."""

from functools import partial
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from aircl_jax.algorithm.entries import log_policy
from aircl_jax.algorithm.scoring import roll_out_and_draw, trajectory_feasibility
from aircl_jax.demonstrations.soft_optimal import occupancy, plan_expert
from aircl_jax.model.feasibility import log_step_feasibility
from aircl_jax.model.networks import Networks
from aircl_jax.runs.result import Result
from aircl_jax.runs.seeds import in_groups
from aircl_jax.types import FeasibilityScores, TrainState, Trajectory
from envs import Env, SoftOptimalExpert, Tabular

MAX_EPISODES = 200  # fresh episodes of each seed's policy: enough for a picture
MOST_EPISODES = 10_000  # of all seeds together: beyond 50 seeds each has fewer
ONCE = {"xla_backend_optimization_level": 0}  # for small programs that run once: compiles faster
KEY_FIGURES = 1  # folded into a state's key, so that the episodes differ from the evaluation's


class Evidence(NamedTuple):
    """Fresh episodes of π of every seed, draws of q among them, and δ̄ of π's episodes and of the reference set."""

    policy: Trajectory  # [S, N, T, …]
    sampled: Trajectory  # [S, N, T, …]
    delta_policy: Float[np.ndarray, "S N"]
    delta_reference: Float[np.ndarray, "S M"]


class GridEvidence(NamedTuple):
    """f(c, a), δ₁(c, a) and the exact share of time that π is in each cell c, of every seed; and the expert's occupancy."""

    reward: Float[np.ndarray, "S C A"]
    step_delta: Float[np.ndarray, "S C A"]
    occupancy: Float[np.ndarray, "S C"]
    expert_occupancy: Float[np.ndarray, " C"]


def gather(result: Result) -> Evidence:
    """Roll out π, score its episodes and draw q."""
    number = min(MAX_EPISODES, result.spec.config.num_evaluation, max(1, MOST_EPISODES // len(result.spec.seeds)))
    options = ONCE if result.spec.env.tabular is not None else None
    run = jax.jit(jax.vmap(partial(_evidence, result.networks, number), (0, None)), compiler_options=options)
    return Evidence(*in_groups(lambda states: run(states, result.reference), result.states))


def gather_grid(result: Result, table: Tabular) -> GridEvidence:
    """Make the maps of a one-hot world; demonstrations from a file or from recordings stand for the exact expert."""
    of_seeds = jax.jit(jax.vmap(partial(_grid_maps, result.networks, table)), compiler_options=ONCE)
    maps = in_groups(of_seeds, result.states)
    planner = result.spec.env.expert
    if result.spec.own is None and isinstance(planner, SoftOptimalExpert):
        seen = jax.jit(partial(_expert_occupancy, result.spec.env, planner), compiler_options=ONCE)()
    else:
        seen = result.expert.obs[0].mean(axis=(0, 1))
    return GridEvidence(*jax.device_get((*maps, seen)))


class LearnedTables(NamedTuple):
    """f(x, a), δ₁(x, a) and log π(a|x, t) of every seed, on the states X of a finite world."""

    reward: Float[np.ndarray, "S X A"]
    step_delta: Float[np.ndarray, "S X A"]
    log_policy: Float[np.ndarray, "S T X A"]
    state_reward: Float[np.ndarray, "S X"] | None  # g(x), in rows with a reward of states
    potential: Float[np.ndarray, "S X"] | None  # h(x), likewise


def learned_tables(networks: Networks, states: TrainState, table: Tabular) -> LearnedTables:
    """Evaluate the learned functions on every state, action and step of a finite world."""
    of_steps = in_groups(jax.jit(jax.vmap(partial(_tables, networks, table)), compiler_options=ONCE), states)
    of_states = (None, None)
    if networks.method.state_reward:
        of_states = in_groups(jax.jit(jax.vmap(partial(_state_rewards, networks, table)), compiler_options=ONCE), states)
    return LearnedTables(*of_steps, *of_states)


def infeasible(trajectories: Trajectory) -> Bool[np.ndarray, "*S N"]:
    """Mark the trajectories that have a violation in any unmasked step."""
    return np.asarray((np.asarray(trajectories.cost) * np.asarray(trajectories.mask)).max(axis=-1) > 0)


def _evidence(networks: Networks, number: int, state: TrainState, reference: Trajectory) -> tuple:
    nets = networks.bind(state.params, state.obs_stats)
    key_policy, key_sampler = jax.random.split(jax.random.fold_in(jax.random.fold_in(state.key, KEY_FIGURES), state.step))
    drawn = roll_out_and_draw(nets, key_policy, key_sampler, number, number)
    return drawn.policy, drawn.sampled, jnp.exp(drawn.log_delta), jnp.exp(trajectory_feasibility(nets, reference))


def _grid_maps(
    networks: Networks, table: Tabular, state: TrainState
) -> tuple[Float[Array, "C A"], Float[Array, "C A"], Float[Array, " C"]]:
    reward, step_delta, _ = _tables(networks, table._replace(obs=jnp.eye(networks.env.obs_size)), state)
    _, _, log_policy = _tables(networks, table, state)
    return reward, step_delta, (occupancy(table, log_policy) @ table.obs).mean(axis=0)


def _tables(
    networks: Networks, table: Tabular, state: TrainState
) -> tuple[Float[Array, "X A"], Float[Array, "X A"], Float[Array, "T X A"]]:
    nets = networks.bind(state.params, state.obs_stats)
    actions = jnp.arange(table.reward.shape[1])

    def maps(obs: Float[Array, " O"], action: Array) -> tuple[Array, Array]:
        logit = nets.step_logit(obs, action)
        scores = FeasibilityScores(logit[None], jnp.zeros(()), jnp.ones(1), nets.params.thresholds)
        log_step = log_step_feasibility(nets.method, nets.config.coefficients, scores)
        return nets.reward(obs, action), jnp.exp(log_step[0])

    reward, step_delta = jax.vmap(jax.vmap(maps, (None, 0)), (0, None))(table.obs, actions)
    return reward, step_delta, log_policy(nets, table)


def _state_rewards(networks: Networks, table: Tabular, state: TrainState) -> tuple[Float[Array, " X"], Float[Array, " X"]]:
    nets = networks.bind(state.params, state.obs_stats)
    return jax.vmap(nets.state_reward)(table.obs), jax.vmap(nets.potential)(table.obs)


def _expert_occupancy(env: Env, planner: SoftOptimalExpert) -> Float[Array, " C"]:
    return (occupancy(planner.table, plan_expert(env, planner)) @ planner.table.obs).mean(axis=0)
