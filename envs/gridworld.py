"""Grid worlds as tables (the paper's Section 7.1): cells are [row, column], a move off the grid stays, the goal absorbs."""

from typing import cast

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int, PRNGKeyArray

from envs import grid_rewards
from envs.base import Discrete, Env, Step, Tabular
from envs.grid_rewards import Reward
from envs.grid_tables import (
    MOVES,
    cells_to,
    check_cells,
    check_share,
    coordinates,
    index,
    marked,
    show,
    successors,
    transitions,
)
from envs.layouts import LAYOUTS, Cell
from envs.options import GridOptions, NonMarkovOptions
from envs.views import Grid

__all__ = ["MOVES", "make_gridworld", "make_nonmarkov"]


def make_gridworld(options: GridOptions) -> Env:
    """The grid with obstacles that can be entered: cost 1 in every step whose state is an obstacle.

    Raises ValueError for cells off the grid, for what covers start, goal or sites, and where no clean path leads to the
    goal, or to a site: from the start in time, or from any start at all.
    """
    options = options.resolved()
    view = _view(options)
    size = view.size
    _check(options, view)
    forbidden, walls = (marked(cells, size) for cells in (view.zones["obstacle"], view.walls))
    absorbing = marked(view.absorbing, size)
    start = ~(forbidden | walls | absorbing) if view.start is None else marked([view.start], size)
    target = successors(size, absorbing, walls)
    _check_paths(options, view, target, allowed=~forbidden, start=start)

    reward = grid_rewards.of_options(options, view)
    transition = transitions(target, options.slip, options.wind)
    goal = np.zeros(size**2) if view.goal is None else marked([view.goal], size)
    table = _table(transition, reward, forbidden, start / start.sum(), obs=np.eye(size**2), goal=goal)
    success_return = grid_rewards.success_return(options, view)
    return _env("gridworld", options, table, reward, view, success_return, options.lapse)


def make_nonmarkov(options: NonMarkovOptions) -> Env:
    """The grid whose constraint has memory: cost 1 in every step in zone B after an earlier visit to zone A.

    The world's Markov state is (cell, zone A seen); the observation shows the cell alone. Raises ValueError as the grid does.
    """
    view = Grid(options.size, options.start, options.goal, {"A": options.zone_a, "B": options.zone_b})
    _check_common(options, view)
    check_cells("env.zone_a", options.zone_a, options.size)
    check_cells("env.zone_b", options.zone_b, options.size)
    if shared := set(options.zone_a) & set(options.zone_b):
        raise ValueError(f"env.zone_a and env.zone_b share {show(shared)}; the zones must be apart")
    cells = options.size**2
    goal = marked([options.goal], options.size)
    target = successors(options.size, goal)
    cell_transition = transitions(target, options.slip)
    in_a, in_b = marked(options.zone_a, options.size), marked(options.zone_b, options.size)

    # State index: cell + cells × (zone A seen, the present cell included).
    transition = np.zeros((2 * cells, 4, 2 * cells))
    transition[:cells, :, :cells] = np.where(in_a, 0.0, cell_transition)
    transition[:cells, :, cells:] = np.where(in_a, cell_transition, 0.0)
    transition[cells:, :, cells:] = cell_transition
    forbidden = np.concatenate([np.zeros(cells, bool), in_b])
    first = index(options.start, options.size)
    start = np.eye(2 * cells)[first + cells * int(in_a[first])]
    reward = grid_rewards.of_distance(options.reward_scale, options.size, options.goal)
    seen = np.concatenate([target + cells * in_a[target], target + cells])
    clean = cells_to(seen, np.tile(goal, 2), ~forbidden, options.horizon)
    if not clean[start > 0].all():
        zones = f"env.zone_a={show(options.zone_a)} env.zone_b={show(options.zone_b)}"
        raise ValueError(_no_path(zones, options.start, str(list(options.goal)), options.horizon))
    table = _table(transition, reward, forbidden, start, obs=np.tile(np.eye(cells), (2, 1)), goal=np.tile(goal, 2))
    whole = grid_rewards.whole_distance(options.reward_scale, options.start, options.goal)
    return _env("nonmarkov", options, table, reward, view, whole)


def _view(options: GridOptions) -> Grid:
    """The places of a resolved grid, as figures draw them too."""
    size, has_sites = int(options.size), options.reward == "sites"
    mud = LAYOUTS[options.layout].mud if has_sites else ()
    return Grid(
        size=size,
        start=None if options.start == "any" else options.start,
        goal=None if options.goal == "default" else options.goal,
        zones={"obstacle": cast(tuple[Cell, ...], options.obstacles)},
        sites=grid_rewards.sites(size) if has_sites else {},
        tastes=(*mud, *options.dislikes),
        walls=options.walls,
    )


def _table(
    transition: np.ndarray, reward: Reward, forbidden: np.ndarray, start: np.ndarray, *, obs: np.ndarray, goal: np.ndarray
) -> Tabular:
    """The world's tables over its states, which are the cells once or, with a memory, several times."""
    arrays = (transition, reward.expected(transition), forbidden, forbidden, start, obs, goal)
    return Tabular(*(jnp.asarray(array, jnp.float32) for array in arrays))


def _env(
    name: str,
    options: GridOptions | NonMarkovOptions,
    table: Tabular,
    reward: Reward,
    view: Grid,
    success_return: float | None,
    lapse: float = 0.0,
) -> Env:
    cells = view.size**2
    step_reward = jnp.asarray(reward.of_steps(), jnp.float32)

    def reset(key: PRNGKeyArray) -> tuple[Int[Array, ""], Float[Array, " O"]]:
        several = view.start is None
        state = jax.random.categorical(key, jnp.log(table.start)) if several else jnp.argmax(table.start)
        return state, table.obs[state]

    # The rows of P(x'|x, a) as cumulative sums: one comparison draws the successor.
    cumulative = jnp.cumsum(table.transition, axis=-1)

    def step(key: PRNGKeyArray, state: Int[Array, ""], action: Int[Array, ""]) -> tuple[Int[Array, ""], Step]:
        draw = jax.random.uniform(key) * cumulative[state, action, -1]
        successor = jnp.sum(cumulative[state, action] <= draw)
        earned = step_reward[state % cells, successor % cells]
        return successor, Step(table.obs[successor], earned, table.cost[state], jnp.zeros(()))

    where = coordinates(view.size)
    row, column = where.T
    smooth = jnp.asarray(np.concatenate([np.eye(view.size)[row], np.eye(view.size)[column]], axis=1), jnp.float32)
    return Env(
        name=name,
        horizon=int(options.horizon),
        obs_size=cells,
        action_space=Discrete(4),
        reset=reset,
        step=step,
        finite_horizon=True,
        reward_view=lambda obs: obs @ smooth,
        reward_view_size=2 * view.size,
        position=lambda obs: obs @ jnp.asarray(where, jnp.float32),
        restore=None if len(table.start) > cells else jnp.argmax,
        tabular=table,
        expert_temperature=options.temperature,
        expert_lapse=lapse,
        success_return=success_return,
        view=view,
    )


def _check(options: GridOptions, view: Grid) -> None:
    """Raises ValueError for numbers out of bounds, cells off the grid, and what covers start, goal, sites or each other."""
    _check_common(options, view)
    check_share("env.wind", options.wind)
    check_share("env.lapse", options.lapse, "a share of the actions")
    if not 0 <= options.dislike < np.inf:
        raise ValueError(f"env.dislike={options.dislike}: how much less a step earns; choose a number of at least 0")
    obstacles = view.zones["obstacle"]
    named = {"start": [] if view.start is None else [view.start], "goal": [] if view.goal is None else [view.goal]}
    named["site"] = list(view.sites)
    for setting, cells in (("env.obstacles", obstacles), ("env.walls", view.walls)):
        check_cells(setting, cells, view.size)
        for name, places in named.items():
            if covered := [cell for cell in places if cell in cells]:
                raise ValueError(f"{setting}={show(cells)} covers the {name} {list(covered[0])}")
    check_cells("env.dislikes", options.dislikes, view.size)
    check_cells(f"env.size={view.size}: mud of layout={options.layout}", view.tastes, view.size)
    if shared := set(view.walls) & set(obstacles):
        raise ValueError(f"env.walls and env.obstacles share {show(shared)}; a wall cannot be entered, choose either")


def _check_common(options: GridOptions | NonMarkovOptions, view: Grid) -> None:
    if view.size < 2:
        raise ValueError(f"env.size={view.size}: a grid needs at least 2 rows")
    if int(options.horizon) < 1:
        raise ValueError(f"env.horizon={options.horizon}: an episode needs at least 1 step")
    check_share("env.slip", options.slip)
    if options.temperature <= 0:
        raise ValueError(f"env.temperature={options.temperature}: the expert's temperature must be above 0")
    for name, cell in (("env.start", view.start), ("env.goal", view.goal)):
        check_cells(name, [] if cell is None else [cell], view.size)
    if view.start in view.absorbing:
        what = "the goal" if view.start == view.goal else "a site"
        raise ValueError(f"env.start={list(view.start or ())} is {what}; choose two different cells")


def _check_paths(
    options: GridOptions,
    view: Grid,
    target: Int[np.ndarray, "C A"],
    *,
    allowed: Bool[np.ndarray, " C"],
    start: Bool[np.ndarray, " C"],
) -> None:
    """Raises ValueError where the start has no clean path to what absorbs in time; where any cell is one, no path at all."""
    steps = view.size**2 if view.start is None else int(options.horizon)
    clean = cells_to(target, marked(view.absorbing, view.size), allowed, steps)
    if start.any() and clean[start].all():
        return
    away = divmod(int(np.flatnonzero(start & ~clean)[0]), view.size) if start.any() else ()
    where = show(view.absorbing) if view.goal is None else str(list(view.goal))
    covers = f"env.obstacles={show(view.zones['obstacle'])}" + (f" env.walls={show(view.walls)}" if view.walls else "")
    raise ValueError(_no_path(covers, away, where, steps))


def _no_path(layout: str, start: tuple[int, ...], end: str, steps: int) -> str:
    return f"{layout} leaves no clean path from {list(start)} to {end} in {steps} steps"
