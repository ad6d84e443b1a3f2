"""Plan on what a run on a grid has learned: on both parts, on each alone and for another goal, with paths to show."""

from collections.abc import Iterator
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int

from aircl_jax.analysis import exact
from aircl_jax.analysis.changed_grids import other_rewards
from aircl_jax.analysis.episodes import learned_tables
from aircl_jax.runs.result import Result
from aircl_jax.transfer.grid import grid_options, learned
from aircl_jax.transfer.table_tests import Case, Learned, case
from envs.grid_tables import index
from envs.gridworld import make_gridworld
from envs.options import GridOptions
from envs.views import Grid

PATHS = 24  # drawn of each plan
DRAWN = 0  # seed of the draws


class Part(NamedTuple):
    """What a plan is made of: a reward and a bar on a world of its own, and words for it."""

    name: str
    title: str
    about: str
    options: GridOptions
    reward: Float[np.ndarray, "X A"]
    forbids: Bool[np.ndarray, " X"] | None


def plans_of(result: Result) -> dict[str, Any] | None:
    """Make the plans of the first seed, as plans.json holds them.

    None where the run is not on a named grid whose states are seen, where it has learned neither a reward nor a δ₁ of states,
    or where one of them is not finite. Violations are by the true constraint, and so is nothing of the plans on what was
    learned.
    """
    spec, options = result.spec, grid_options(result.spec)
    if options is None or spec.env.tabular is None:
        return None
    tables = learned_tables(result.networks, result.states, spec.env.tabular)
    if not (np.isfinite(tables.reward[0]).all() and np.isfinite(tables.step_delta[0]).all()):
        return None
    seed = learned(spec.method, tables)[0]
    plans = [_planned(part, case(part.options)) for part in _parts(seed, options.resolved())]
    return {"seed": spec.seeds[0], "size": int(options.resolved().size), "plans": plans} if plans else None


def _parts(seed: Learned, options: GridOptions) -> Iterator[Part]:
    world = case(options).world
    nothing = np.zeros_like(world.reward)
    if seed.reward is not None:
        reward = seed.reward(world)
        if seed.forbids is not None:
            yield Part("both", "Both", "the learned reward under the learned constraint", options, reward, seed.forbids)
        yield Part("reward", "Reward alone", "the learned reward, nothing forbidden", options, reward, None)
    if seed.forbids is not None:
        about = "no reward, the learned constraint: any way is as good that keeps out of the cells flagged"
        yield Part("constraint", "Constraint alone", about, options, nothing, seed.forbids)
        if (other := _another_goal(options)) is not None:
            about = "a known reward for another goal under the learned constraint"
            yield Part("goal", "Another goal", about, other, case(other).world.reward, seed.forbids)


def _another_goal(options: GridOptions) -> GridOptions | None:
    """Take the first other task of the swap tests, from the own start where that leaves a clean way; None without any."""
    try:
        other = next(iter(other_rewards(options).values()))
    except ValueError:
        return None
    moved = replace(other, start=options.start)
    try:
        make_gridworld(moved)
    except ValueError:
        return other
    return moved


def _planned(part: Part, at: Case) -> dict[str, Any]:
    """Plan greedily, evaluate exactly, and draw paths."""
    world, view = at.world, make_gridworld(part.options).view
    if not isinstance(view, Grid):
        raise TypeError(f"{part.name}: its world is no grid")
    barred = None if part.forbids is None else exact.bar(world, part.forbids, but_staying=True)
    policy = exact.hard_plan(world.transition, part.reward, at.horizon, barred)
    outcome = exact.evaluate(*world, policy)
    paths = draw_paths(world, policy)
    goal = None if view.goal is None else index(view.goal, view.size)
    arrives = None if goal is None else float(exact.occupancy(world.transition, world.start, policy)[-1, goal])
    flagged = [] if part.forbids is None else np.flatnonzero(part.forbids & ~world.absorbing).tolist()
    return {
        "name": part.name,
        "title": part.title,
        "about": part.about,
        "start": None if view.start is None else index(view.start, view.size),
        "ends": [index(cell, view.size) for cell in view.absorbing],
        "flagged": flagged,
        "forbidden": np.flatnonzero(world.forbidden).tolist(),
        "walls": [index(cell, view.size) for cell in view.walls],
        "paths": paths.tolist(),
        "violating": world.forbidden[paths].any(axis=1).tolist(),
        "arrives": arrives,
        "violates": outcome.violating_episodes,
    }


def draw_paths(world: exact.World, policy: Float[np.ndarray, "T X A"]) -> Int[np.ndarray, "N T1"]:
    """Draw paths of states s_0 … s_T, always the same ones."""
    random = np.random.default_rng(DRAWN)
    states = [random.choice(len(world.start), PATHS, p=world.start)]
    for step in policy:
        following = np.einsum("na,nax->nx", step[states[-1]], world.transition[states[-1]])
        states.append(np.array([random.choice(len(row), p=row / row.sum()) for row in following]))
    return np.stack(states, axis=1)
