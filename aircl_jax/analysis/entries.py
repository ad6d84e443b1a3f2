"""Gather what a row with a reward of states found in a finite world: g, h, and the entries made and expected."""

from functools import partial
from typing import NamedTuple

import jax
import numpy as np
from jaxtyping import Array, Bool, Float

from aircl_jax.algorithm.entries import expected_entries, model_policy, shown_by
from aircl_jax.analysis import exact
from aircl_jax.analysis.episodes import ONCE
from aircl_jax.model.networks import Networks
from aircl_jax.runs.result import Result
from aircl_jax.runs.seeds import in_groups
from aircl_jax.types import TrainState, Trajectory
from envs import Tabular


class Entries(NamedTuple):
    """Of each state and seed: how often D_E enters it, and how often it would, were entering that state alone ordinary."""

    made: Float[np.ndarray, "S X"]  # n
    expected: Float[np.ndarray, "S X"]  # M


def entries_of(networks: Networks, states: TrainState, expert: Trajectory, table: Tabular) -> Entries:
    """Count entries by what was learned, in rows that test them; `expert` is [S, N, T, …].

    Where tasks share one constraint these are the sums over all of them, as of the last update.
    """
    if states.params.evidence is not None:
        return Entries(*np.asarray(states.params.evidence).swapaxes(0, 1))
    run = jax.jit(jax.vmap(partial(_entries, networks, table)), compiler_options=ONCE)
    return Entries(*in_groups(run, states, expert))


def slopes(result: Result) -> Float[np.ndarray, "S P"]:
    """Return what one step along each coordinate of the position is worth: the potential's slopes."""
    return np.asarray(result.states.params.reward["potential"])


def tempted_share(reward: Float[np.ndarray, "X A"], table: Tabular, horizon: int, forbidden: Bool[np.ndarray, " X"]) -> float:
    """Compute the share of steps that the soft plan of a reward alone spends in states that were found forbidden.

    It is the test of identification that needs no truth: where it is about 0 the reward itself keeps clear of them.
    """
    world = exact.world_of(table)._replace(forbidden=forbidden)
    return exact.evaluate(*world, exact.soft_plan(world.transition, reward, horizon)).violating_steps


def _entries(
    networks: Networks, table: Tabular, state: TrainState, expert: Trajectory
) -> tuple[Float[Array, " X"], Float[Array, " X"]]:
    nets, shown = networks.bind(state.params, state.obs_stats), shown_by(expert, networks.env, table)
    return shown.entered, expected_entries(nets, table, shown, model_policy(nets, expert, table))
