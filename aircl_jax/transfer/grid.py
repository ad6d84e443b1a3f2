"""Measure a run on a grid by the swap tests, from what its networks have learned."""

from collections.abc import Callable, Mapping
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from aircl_jax.analysis import exact
from aircl_jax.analysis.entries import entries_of
from aircl_jax.analysis.episodes import LearnedTables, learned_tables
from aircl_jax.analysis.exact import Outcome, World
from aircl_jax.methods import Method
from aircl_jax.model.feasibility import FORBIDDEN_BELOW
from aircl_jax.model.networks import Networks
from aircl_jax.runs.result import Result
from aircl_jax.runs.spec import RunSpec
from aircl_jax.transfer.table_tests import Learned, measures
from aircl_jax.types import TrainState, Trajectory
from envs import Tabular
from envs.layouts import LAYOUTS
from envs.options import GridOptions
from envs.registry import options_of

Reward = Callable[[World], Float[np.ndarray, "X A"]]


def of_a_grid(spec: RunSpec, networks: Networks, states: TrainState) -> dict[str, Float[np.ndarray, " S"]]:
    """Measure every seed; empty where the run is not on a named grid whose states are seen, or it has no changed worlds.

    A seed whose networks give NaN has no measure.
    """
    options = grid_options(spec)
    if options is None or spec.env.tabular is None:
        return {}
    tables = learned_tables(networks, states, spec.env.tabular)
    try:
        with np.errstate(invalid="ignore"):
            rows = [measures(options, seed) for seed in learned(spec.method, tables)]
    except ValueError:  # a layout of one's own that leaves too few starts or walls
        return {}
    broken = np.array([any(np.isnan(leaf[seed]).any() for leaf in jax.tree.leaves(tables)) for seed in range(len(rows))])
    return {name: np.where(broken, np.nan, [row[name] for row in rows]) for name in rows[0]}


def maps_of_a_grid(
    spec: RunSpec, networks: Networks, states: TrainState, expert: Trajectory
) -> dict[str, Float[np.ndarray, "..."]]:
    """Make the maps of every seed of a run on a named grid, for recovered.npz; empty elsewhere.

    `reward` and `delta` [S, X, A] are what was learned, `entered` [S, X] how often D_E's actions aim at a cell from another,
    `tempted` [S, X] the method's own M where it has one: how often they would, were entering that cell alone ordinary;
    and `true_tempted` [S, X] the M of `exact.true_temptation` at D_E's states: how often they would, were the cell ordinary
    to the true expert. The last reads the truth; nothing that learns does.
    """
    if grid_options(spec) is None or spec.env.tabular is None:
        return {}
    world, tables = exact.world_of(spec.env.tabular), learned_tables(networks, states, spec.env.tabular)
    cells, actions = np.asarray(expert.obs).argmax(axis=-1), np.asarray(expert.action)  # [S, N, T]
    horizon, temperature = spec.env.horizon, spec.env.expert_temperature
    aimed = world.intended[cells, actions]
    entered = [np.bincount(to[to != at], minlength=len(world.start)) for to, at in zip(aimed, cells, strict=True)]
    tempted = [exact.true_temptation(world, horizon, states, temperature) for states in cells]
    learns = (spec.method.learns_reward, spec.method.tests_steps)
    known = {name: of for name, of, is_learned in zip(("reward", "delta"), tables[:2], learns, strict=True) if is_learned}
    if spec.method.tests_entries:
        known["tempted"] = entries_of(networks, states, expert, spec.env.tabular).expected
    return {**known, "entered": np.array(entered, float), "true_tempted": np.array(tempted)}


def grid_options(spec: RunSpec) -> GridOptions | None:
    """Return the settings of a run on a named grid; None for other worlds."""
    options: Any = options_of(spec.env.name, spec.env_settings) if spec.named else None
    return options if isinstance(options, GridOptions) else None


def named_grid(settings: Mapping[str, Any], named: Mapping[str, str]) -> dict[str, Any]:
    """Put a reward and a layout's obstacles into a grid's settings. Raises ValueError for a layout that has another size."""
    changed = {name: value for name, value in settings.items() if name != "constraint"}
    if "reward" in named:
        changed |= {"goal": "default", "horizon": "default", "reward_scale": GridOptions.reward_scale, "dislikes": ()}
    if "constraint" in named:
        sizes = {name: layout.size for name, layout in LAYOUTS.items()}
        fitting = [name for name, size in sizes.items() if size == settings["size"]]
        if named["constraint"] not in fitting:
            raise ValueError(f"unknown constraint {named['constraint']!r} of this grid; choose from {', '.join(fitting)}, none")
        changed["obstacles"] = LAYOUTS[named["constraint"]].obstacles
    return changed


def swap_table(
    result: Result, reward: Any, constraint: Any, table: Tabular, horizon: int
) -> tuple[Float[np.ndarray, "S T X A"], list[Outcome]]:
    """Plan greedily on a recombination in a finite world, for each learned seed; `reward` and `constraint` as in `swap`."""
    method, own = result.spec.method, result.spec.env.tabular
    if own is None or own.obs.shape != table.obs.shape:
        raise ValueError(f"env={result.spec.env.name} and the world to act in have not the same states; choose one that has")
    if reward is None and not method.learns_reward:
        raise ValueError(f"method={result.spec.method_name} learns no reward to swap; choose reward=NAME or a function")
    if constraint is None and not method.tests_steps:
        raise ValueError(f"method={result.spec.method_name} has no δ₁ to swap; choose constraint=NAME or a function")
    world, plans = exact.world_of(table), []
    for seed in learned(method, learned_tables(result.networks, result.states, own)):
        paid = seed.reward(world) if reward is None and seed.reward else _on_steps(reward, table, world.reward)
        if constraint is None and seed.forbids is not None:
            barred = exact.bar(world, seed.forbids, but_staying=True)
        elif constraint == "none":
            barred = None
        else:
            costly = _on_steps(constraint, table, world.barred.astype(float)) >= FORBIDDEN_BELOW
            cells = np.asarray(
                costly.all(axis=-1)
            )  # a function speaks of the cell one is in, a world's bar of the move into it
            barred = costly if isinstance(constraint, str) else exact.bar(world, cells, but_staying=True)
        plans.append(exact.hard_plan(world.transition, paid, horizon, barred))
    return np.array(plans), [exact.evaluate(*world, plan) for plan in plans]


def _on_steps(choice: Any, table: Tabular, known: Float[np.ndarray, "X A"]) -> Float[np.ndarray, "X A"]:
    """Evaluate a function of (obs, action) on every state and action; under a name it is the world's own, which is known."""
    if isinstance(choice, str):
        return known
    actions = jnp.arange(known.shape[1])
    return np.asarray(jax.vmap(jax.vmap(choice, (None, 0)), (0, None))(table.obs, actions), float)


def in_every_world(reward: Float[np.ndarray, "X A"]) -> Reward:
    """Pay the same for a step wherever it leads: f(s, a) does not see the successor."""
    return lambda world: reward


def of_states(state_reward: Float[np.ndarray, " X"], potential: Float[np.ndarray, " X"]) -> Reward:
    """Pay g(s) + E[h(s')] − h(s), with the successors of each world."""
    return lambda world: state_reward[:, None] + world.transition @ potential - potential[:, None]


def _reward_of(tables: LearnedTables, seed: int) -> Reward:
    if tables.state_reward is None or tables.potential is None:
        return in_every_world(tables.reward[seed].astype(float))
    return of_states(tables.state_reward[seed].astype(float), tables.potential[seed].astype(float))


def learned(method: Method, tables: LearnedTables) -> list[Learned]:
    """Take of each seed what its method learns. A cell is forbidden where δ₁ of every action in it is below ½."""
    policies = np.exp(tables.log_policy.astype(float))
    return [
        Learned(
            reward=_reward_of(tables, seed) if method.learns_reward else None,
            forbids=(tables.step_delta[seed] < FORBIDDEN_BELOW).all(axis=-1) if method.tests_steps else None,
            policy=policies[seed] / policies[seed].sum(axis=-1, keepdims=True),
        )
        for seed in range(len(tables.reward))
    ]
