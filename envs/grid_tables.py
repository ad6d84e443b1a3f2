"""What the grids of `envs.gridworld` share: moves, transitions, distances and checks, over cells by their index."""

from collections.abc import Iterable, Sequence

import numpy as np
from jaxtyping import Bool, Float, Int

from envs.layouts import Cell

MOVES = np.array([[-1, 0], [0, 1], [1, 0], [0, -1]])  # up, right, down, left
DOWN = 2


def index(cell: Cell, size: int) -> int:
    return cell[0] * size + cell[1]


def marked(cells: Iterable[Cell], size: int) -> Bool[np.ndarray, " C"]:
    """Say of every cell whether it is one of these."""
    found = np.zeros(size**2, bool)
    found[[index(cell, size) for cell in cells]] = True
    return found


def coordinates(size: int) -> Int[np.ndarray, "C 2"]:
    """Row and column of every cell."""
    return np.stack(np.divmod(np.arange(size**2), size), axis=1)


def successors(
    size: int, absorbing: Bool[np.ndarray, " C"], walls: Bool[np.ndarray, " C"] | None = None
) -> Int[np.ndarray, "C A"]:
    """The cell that each move aims at: itself where the move leads off the grid, into a wall or out of what absorbs."""
    here = np.arange(size**2)[:, None]
    moved = np.clip(coordinates(size)[:, None] + MOVES, 0, size - 1)
    target = moved @ np.array([size, 1])
    if walls is not None:
        target = np.where(walls[target], here, target)
    return np.where(absorbing[:, None], here, target)


def transitions(target: Int[np.ndarray, "C A"], slip: float, wind: float = 0.0) -> Float[np.ndarray, "C A C"]:
    """P(c'|c, a) = (1 − wind) ((1 − slip) chosen + slip · mean over moves) + wind · down."""
    chosen = np.eye(len(target))[target]
    slipping = (1 - slip) * chosen + slip * chosen.mean(axis=1, keepdims=True)
    return (1 - wind) * slipping + wind * chosen[:, [DOWN]]


def distance(size: int, goal: Cell) -> Int[np.ndarray, " C"]:
    """Manhattan distance of every cell to the goal."""
    return np.abs(coordinates(size) - np.array(goal)).sum(axis=1)


def cells_to(
    target: Int[np.ndarray, "C A"], ends: Bool[np.ndarray, " C"], allowed: Bool[np.ndarray, " C"], steps: int
) -> Bool[np.ndarray, " C"]:
    """Mark the cells from which some moves through allowed cells lead to one of `ends` in so many steps."""
    reached = ends & allowed
    for _ in range(steps):
        reached = reached | (reached[target].any(axis=1) & allowed)
    return reached


def show(cells: Iterable[Cell]) -> str:
    return "[" + ",".join(f"[{row},{column}]" for row, column in cells) + "]"


def check_cells(name: str, cells: Sequence[Cell], size: int) -> None:
    """Raises ValueError unless each is [row, column] on the grid."""
    for cell in cells:
        if len(cell) != 2 or not all(isinstance(part, int) and 0 <= part < size for part in cell):
            raise ValueError(
                f"{name}: {list(cell)} is not a cell of the {size}×{size} grid; rows and columns are 0 to {size - 1}"
            )


def check_share(name: str, share: float, what: str = "a probability") -> None:
    """Raises ValueError unless it is between 0 and 1."""
    if not 0 <= share <= 1:
        raise ValueError(f"{name}={share} is not {what}; choose from 0 to 1")
