"""Measure a run on a grid by the swap tests, from what its networks have learned."""

from collections.abc import Callable
from typing import Any

import numpy as np
from jaxtyping import Float

from aircl_jax.analysis.episodes import LearnedTables, learned_tables
from aircl_jax.analysis.exact import World
from aircl_jax.methods import Method
from aircl_jax.model.networks import Networks
from aircl_jax.runs.spec import RunSpec
from aircl_jax.transfer.table_tests import FORBIDDEN_BELOW, Learned, measures
from aircl_jax.types import TrainState
from envs.options import GridOptions
from envs.registry import options_of


def of_a_grid(spec: RunSpec, networks: Networks, states: TrainState) -> dict[str, Float[np.ndarray, " S"]]:
    """Measure every seed; empty where the run is not on a named grid whose states are seen, or it has no changed worlds."""
    options = grid_options(spec)
    if options is None or spec.env.tabular is None:
        return {}
    tables = learned_tables(networks, states, spec.env.tabular)
    try:
        rows = [measures(options, seed) for seed in learned(spec.method, tables)]
    except ValueError:  # a layout of one's own that leaves too few starts or walls
        return {}
    return {name: np.array([row[name] for row in rows]) for name in rows[0]}


def grid_options(spec: RunSpec) -> GridOptions | None:
    """Return the settings of a run on a named grid; None for other worlds."""
    options: Any = options_of(spec.env.name, spec.env_settings) if spec.named else None
    return options if isinstance(options, GridOptions) else None


def in_every_world(reward: Float[np.ndarray, "X A"]) -> Callable[[World], Float[np.ndarray, "X A"]]:
    """Pay the same for a step wherever it leads: f(s, a) does not see the successor."""
    return lambda world: reward


def learned(method: Method, tables: LearnedTables) -> list[Learned]:
    """Take of each seed what its method learns. A cell is forbidden where δ₁ of every action in it is below ½."""
    policies = np.exp(tables.log_policy.astype(float))
    return [
        Learned(
            reward=in_every_world(tables.reward[seed].astype(float)) if method.learns_reward else None,
            forbids=(tables.step_delta[seed] < FORBIDDEN_BELOW).all(axis=-1) if method.tests_steps else None,
            policy=policies[seed] / policies[seed].sum(axis=-1, keepdims=True),
        )
        for seed in range(len(tables.reward))
    ]
