"""Grids in which what was learned on one of them is tried: with other starts, dynamics, walls and horizons, and other tasks."""

from collections.abc import Iterable, Iterator
from dataclasses import replace
from itertools import islice
from typing import TypeVar

import numpy as np
from jaxtyping import Float, Int

from aircl_jax.analysis import exact
from envs import Grid, SoftOptimalExpert
from envs.grid_tables import coordinates, index
from envs.gridworld import make_gridworld
from envs.layouts import Cell
from envs.options import GridOptions

T = TypeVar("T")

MOVED, WALLED = 3, 2  # how many other starts and new walls there are
DISTURBED = 0.2  # wind and slip of the changed worlds


def changed_worlds(options: GridOptions) -> dict[str, GridOptions]:
    """The same task elsewhere, by rule: three starts, wind, slip, two walls, twice the horizon, and three of these at once.

    Raises ValueError where a layout leaves too few starts or cells for walls.
    """
    base = options.resolved()
    starts = _other_starts(base)
    walls = (*base.walls, *_walls_in_the_way(base, starts))
    longer = 2 * int(base.horizon)
    moved = {f"start {number}": replace(base, start=cell) for number, cell in enumerate(starts, 1)}
    return {
        **moved,
        "wind": replace(base, wind=DISTURBED),
        "slip": replace(base, slip=DISTURBED),
        "walls": replace(base, walls=walls),
        "horizon": replace(base, horizon=longer),
        "start 1, walls, horizon": replace(base, start=starts[0], walls=walls, horizon=longer),
    }


def other_rewards(options: GridOptions) -> dict[str, GridOptions]:
    """Three other tasks under the same constraint and dynamics: another goal and start each, two by distance, one by steps.

    Raises ValueError where obstacles leave fewer.
    """
    base = options.resolved()
    last = int(base.size) - 1
    rows = sorted(range(last + 1), key=lambda row: abs(row - last / 2))
    free = [(row, last) for row in rows if (row, last) not in (*base.obstacles, *base.walls)]
    tasks = {
        "right": ("distance", (0, 0), free[0] if free else (0, last)),
        "back": ("distance", (last, last), (0, 0)),
        "across": ("goal", (last, 0), (0, last)),
        "down": ("distance", (0, last), (last, 0)),
        "along": ("goal", (0, 0), (last, 0)),
        "forth": ("goal", (0, 0), (last, last)),
    }
    own = (base.reward, base.start, base.goal)
    possible = {
        name: replace(
            base,
            reward=reward,
            start=start,
            goal=goal,
            horizon="default" if reward == "goal" else 2 * (last + 1),
            reward_scale=GridOptions.reward_scale,
            dislikes=(),
        )
        for name, (reward, start, goal) in tasks.items()
        if own != (reward, start, goal)
    }
    found = _first(MOVED, ((name, world) for name, world in possible.items() if _is_possible(world)), "other tasks", base)
    return {name: world.resolved() for name, world in found}


def _other_starts(base: GridOptions) -> list[Cell]:
    """Corners, then the cells nearest the middle; where starts are any or there are sites, the cells farthest from those."""
    view, _ = _places_and_expert(base)
    cells = coordinates(view.size)
    if view.start is not None and not view.sites:
        from_middle = np.abs(cells - (view.size - 1) / 2).sum(axis=1)
        is_corner = np.isin(cells, (0, view.size - 1)).all(axis=1)
        order = np.lexsort((cells[:, 1], -cells[:, 0], from_middle, ~is_corner))
        candidates = (_cell(cells[place]) for place in order)
    else:
        candidates = _spread(cells, [index(cell, view.size) for cell in view.absorbing])
    avoided = {*view.absorbing, *view.tastes, view.start}
    possible = (cell for cell in candidates if cell not in avoided and _is_possible(replace(base, start=cell)))
    return _first(MOVED, possible, "other starts", base)


def _spread(cells: Int[np.ndarray, "C 2"], ends: list[int]) -> Iterator[Cell]:
    """The cells by their distance from the nearest end; of equals the one farthest from those before it comes first."""
    apart = np.abs(cells[:, None] - cells).sum(axis=-1)
    from_ends, from_others = apart[ends].min(axis=0), np.full(len(cells), 2 * len(cells))
    left = list(range(len(cells)))
    while left:
        best = max(left, key=lambda place: (from_ends[place], from_others[place]))
        left.remove(best)
        from_others = np.minimum(from_others, apart[best])
        yield _cell(cells[best])


def _walls_in_the_way(base: GridOptions, starts: list[Cell]) -> list[Cell]:
    """The cells where the expert is most, such that a clean path remains: no start, nothing that absorbs or is forbidden."""
    view, planner = _places_and_expert(base)
    visits = _expert_visits(planner, int(base.horizon))
    taken = {*view.absorbing, *view.zones["obstacle"], *view.walls, *starts, view.start}
    walls: list[Cell] = []
    for place in np.argsort(-visits, kind="stable"):
        cell = _cell(coordinates(view.size)[place])
        walled = replace(base, walls=(*base.walls, *walls, cell))
        if len(walls) < WALLED and cell not in taken and _is_possible(walled, replace(walled, start=starts[0])):
            walls.append(cell)
    return _first(WALLED, walls, "walls", base)


def _expert_visits(planner: SoftOptimalExpert, horizon: int) -> Float[np.ndarray, " C"]:
    """How often the exact expert, without its lapses, is in each cell before its last step."""
    world = exact.world_of(planner.table)
    plan = exact.soft_plan(world.transition, world.reward, horizon, world.barred, planner.temperature)
    return exact.occupancy(world.transition, world.start, plan)[:-1].sum(axis=0)


def _places_and_expert(base: GridOptions) -> tuple[Grid, SoftOptimalExpert]:
    env = make_gridworld(base)
    match env.view, env.expert:
        case Grid() as view, SoftOptimalExpert() as planner:
            return view, planner
    raise TypeError(f"{env.name} is no grid with an exact expert")


def _cell(place: Int[np.ndarray, "2"]) -> Cell:
    return int(place[0]), int(place[1])


def _is_possible(*worlds: GridOptions) -> bool:
    """Whether every one of them can be made."""
    try:
        for world in worlds:
            make_gridworld(world)
    except ValueError:
        return False
    return True


def _first(number: int, found: Iterable[T], what: str, base: GridOptions) -> list[T]:
    first = list(islice(found, number))
    if len(first) < number:
        raise ValueError(f"env.layout={base.layout}: its cells leave {len(first)} {what}; choose one that leaves {number}")
    return first
