"""Grid worlds of the paper's Section 7.1 as tables: cells are [row, column], a move off the grid stays, the goal absorbs."""

from collections.abc import Iterable

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int, PRNGKeyArray

from envs.base import Discrete, Env, Step, Tabular
from envs.options import GridOptions, NonMarkovOptions
from envs.views import Grid

MOVES = np.array([[-1, 0], [0, 1], [1, 0], [0, -1]])  # up, right, down, left

Cell = tuple[int, int]


def make_gridworld(options: GridOptions) -> Env:
    """The grid with obstacles that can be entered: cost 1 in every step whose state is an obstacle.

    Raises ValueError for cells off the grid, obstacles on start or goal, or a goal that no clean path reaches in time.
    """
    _check_common(options)
    _check_cells("env.obstacles", options.obstacles, options.size)
    for name, cell in (("start", options.start), ("goal", options.goal)):
        if cell in options.obstacles:
            raise ValueError(f"env.obstacles={_show(options.obstacles)} covers the {name} {list(cell)}")
    transition, reward = _dynamics(options)
    blocked = np.zeros(options.size**2)
    blocked[[_index(cell, options.size) for cell in options.obstacles]] = 1.0
    cells = np.eye(options.size**2)
    table = _table(options, transition, reward, cost=blocked, forbidden=blocked, obs=cells)
    _check_reachable(options, table, f"env.obstacles={_show(options.obstacles)}")
    return _env("gridworld", options, table, {"obstacle": options.obstacles})


def make_nonmarkov(options: NonMarkovOptions) -> Env:
    """The grid whose constraint has memory: cost 1 in every step in zone B after an earlier visit to zone A.

    The world's Markov state is (cell, zone A seen); the observation shows the cell alone. Raises ValueError as the grid does.
    """
    _check_common(options)
    _check_cells("env.zone_a", options.zone_a, options.size)
    _check_cells("env.zone_b", options.zone_b, options.size)
    if shared := set(options.zone_a) & set(options.zone_b):
        raise ValueError(f"env.zone_a and env.zone_b share {_show(shared)}; the zones must be apart")
    cell_transition, cell_reward = _dynamics(options)
    cells = options.size**2
    in_a, in_b = np.zeros(cells, bool), np.zeros(cells, bool)
    in_a[[_index(cell, options.size) for cell in options.zone_a]] = True
    in_b[[_index(cell, options.size) for cell in options.zone_b]] = True

    # State index: cell + cells × (zone A seen, the present cell included).
    transition = np.zeros((2 * cells, 4, 2 * cells))
    transition[:cells, :, :cells] = np.where(in_a, 0.0, cell_transition)
    transition[:cells, :, cells:] = np.where(in_a, cell_transition, 0.0)
    transition[cells:, :, cells:] = cell_transition
    forbidden = np.concatenate([np.zeros(cells), in_b.astype(float)])
    table = _table(
        options,
        transition,
        np.tile(cell_reward, (2, 1)),
        cost=forbidden,
        forbidden=forbidden,
        obs=np.tile(np.eye(cells), (2, 1)),
        start=_index(options.start, options.size) + cells * int(in_a[_index(options.start, options.size)]),
    )
    _check_reachable(options, table, f"env.zone_a={_show(options.zone_a)} env.zone_b={_show(options.zone_b)}")
    return _env("nonmarkov", options, table, {"A": options.zone_a, "B": options.zone_b})


def _index(cell: Cell, size: int) -> int:
    return cell[0] * size + cell[1]


def _dynamics(options: GridOptions | NonMarkovOptions) -> tuple[np.ndarray, np.ndarray]:
    """P(c'|c, a) over cells and E[r|c, a], r = scale × (decrease of the Manhattan distance to the goal)."""
    size, goal = options.size, np.array(options.goal)
    cell = np.stack(np.divmod(np.arange(size**2), size), axis=1)
    moved = np.clip(cell[:, None] + MOVES, 0, size - 1)
    target = moved @ np.array([size, 1])
    target[_index(options.goal, size)] = _index(options.goal, size)
    chosen = np.eye(size**2)[target]
    transition = (1 - options.slip) * chosen + options.slip * chosen.mean(axis=1, keepdims=True)
    distance = np.abs(cell - goal).sum(axis=1)
    reward = options.reward_scale * (distance[:, None] - transition @ distance)
    return transition, reward


def _table(
    options: GridOptions | NonMarkovOptions,
    transition: np.ndarray,
    reward: np.ndarray,
    *,
    cost: np.ndarray,
    forbidden: np.ndarray,
    obs: np.ndarray,
    start: int | None = None,
) -> Tabular:
    start_index = _index(options.start, options.size) if start is None else start
    at_goal = obs[:, _index(options.goal, options.size)]
    arrays = (transition, reward, cost, forbidden, np.eye(len(transition))[start_index], obs, at_goal)
    return Tabular(*(jnp.asarray(array, jnp.float32) for array in arrays))


def _env(name: str, options: GridOptions | NonMarkovOptions, table: Tabular, zones: dict[str, tuple[Cell, ...]]) -> Env:
    distance_gain = options.reward_scale * _distance_gain(options)

    def reset(key: PRNGKeyArray) -> tuple[Int[Array, ""], Float[Array, " O"]]:
        state = jnp.argmax(table.start)
        return state, table.obs[state]

    # The rows of P(x'|x, a) as cumulative sums: one comparison draws the successor.
    cumulative = jnp.cumsum(table.transition, axis=-1)

    def step(key: PRNGKeyArray, state: Int[Array, ""], action: Int[Array, ""]) -> tuple[Int[Array, ""], Step]:
        draw = jax.random.uniform(key) * cumulative[state, action, -1]
        successor = jnp.sum(cumulative[state, action] <= draw)
        reward = distance_gain[state % len(distance_gain), successor % len(distance_gain)]
        return successor, Step(table.obs[successor], reward, table.cost[state], jnp.zeros(()))

    row, column = np.divmod(np.arange(options.size**2), options.size)
    view = jnp.asarray(np.concatenate([np.eye(options.size)[row], np.eye(options.size)[column]], axis=1), jnp.float32)
    return Env(
        name=name,
        horizon=options.horizon,
        obs_size=options.size**2,
        action_space=Discrete(4),
        reset=reset,
        step=step,
        finite_horizon=True,
        reward_view=lambda obs: obs @ view,
        reward_view_size=2 * options.size,
        tabular=table,
        expert_temperature=options.temperature,
        # The rewards telescope to scale × the distance covered, so the whole distance means the goal.
        success_return=options.reward_scale * float(np.abs(np.subtract(options.start, options.goal)).sum()),
        view=Grid(options.size, options.start, options.goal, zones),
    )


def _distance_gain(options: GridOptions | NonMarkovOptions) -> Float[Array, "C C"]:
    cell = np.stack(np.divmod(np.arange(options.size**2), options.size), axis=1)
    distance = np.abs(cell - np.array(options.goal)).sum(axis=1)
    return jnp.asarray(distance[:, None] - distance[None, :], jnp.float32)


def _show(cells: Iterable[Cell]) -> str:
    return "[" + ",".join(f"[{row},{column}]" for row, column in cells) + "]"


def _check_common(options: GridOptions | NonMarkovOptions) -> None:
    if options.size < 2:
        raise ValueError(f"env.size={options.size}: a grid needs at least 2 rows")
    if options.horizon < 1:
        raise ValueError(f"env.horizon={options.horizon}: an episode needs at least 1 step")
    if not 0 <= options.slip <= 1:
        raise ValueError(f"env.slip={options.slip} is not a probability; choose from 0 to 1")
    if options.temperature <= 0:
        raise ValueError(f"env.temperature={options.temperature}: the expert's temperature must be above 0")
    _check_cells("env.start", (options.start,), options.size)
    _check_cells("env.goal", (options.goal,), options.size)
    if options.start == options.goal:
        raise ValueError(f"env.start={list(options.start)} is the goal; choose two different cells")


def _check_cells(name: str, cells: tuple[Cell, ...], size: int) -> None:
    for cell in cells:
        if len(cell) != 2 or not all(isinstance(part, int) and 0 <= part < size for part in cell):
            raise ValueError(
                f"{name}: {list(cell)} is not a cell of the {size}×{size} grid; rows and columns are 0 to {size - 1}"
            )


def _check_reachable(options: GridOptions | NonMarkovOptions, table: Tabular, layout: str) -> None:
    allowed = np.asarray(table.forbidden) == 0
    can_step = (np.asarray(table.transition) > options.slip / 4).any(axis=1)
    reached = np.asarray(table.start) > 0
    for _ in range(options.horizon):
        reached = reached | ((reached @ can_step) & allowed)
    if not (reached & (np.asarray(table.goal) > 0)).any():
        raise ValueError(
            f"{layout} leaves no clean path from {list(options.start)} to {list(options.goal)} in {options.horizon} steps"
        )
