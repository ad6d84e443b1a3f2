"""The rewards of the grids: of the distance gained, of the goal, or of sites; less in cells that are disliked."""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int

from envs.grid_tables import distance, index, marked
from envs.layouts import LAYOUTS, Cell
from envs.options import STEP_PRICE, GridOptions
from envs.views import Grid

MUD = -1.5  # reward of a step in mud


class Reward(NamedTuple):
    """r(c, c') = scale (distance[c] − distance[c']) + here[c]."""

    scale: float
    distance: Int[np.ndarray, " C"]
    here: Float[np.ndarray, " C"]

    def expected(self, transition: Float[np.ndarray, "X A X"]) -> Float[np.ndarray, "X A"]:
        """E[r | x, a] over states that are the cells once or, with a memory, several times."""
        copies = len(transition) // len(self.distance)
        far, here = np.tile(self.distance, copies), np.tile(self.here, copies)
        return self.scale * (far[:, None] - transition @ far) + here[:, None]

    def of_steps(self) -> Float[np.ndarray, "C C"]:
        """r of every cell and successor."""
        return self.scale * (self.distance[:, None] - self.distance[None, :]) + self.here[:, None]


def of_distance(scale: float, size: int, goal: Cell) -> Reward:
    return Reward(scale, distance(size, goal), np.zeros(size**2))


def sites(size: int) -> dict[Cell, float]:
    """Three corners and what a step in them earns."""
    last = size - 1
    return {(last, last): 2.5, (0, last): 1.5, (last, 0): 1.0}


def of_options(options: GridOptions, view: Grid) -> Reward:
    """The reward that the options name, in their grid's places."""
    here = -options.dislike * marked(options.dislikes, view.size)
    match options.reward, view.goal:
        case "distance", (_, _) as goal:
            return Reward(options.reward_scale, distance(view.size, goal), here)
        case "goal", (_, _) as goal:
            here = here + STEP_PRICE * ~marked([goal], view.size)
        case _:
            here = here + MUD * marked(LAYOUTS[options.layout].mud, view.size)
            for cell, value in view.sites.items():
                here[index(cell, view.size)] += value
    return Reward(0.0, np.zeros(view.size**2, int), here)


def success_return(options: GridOptions, view: Grid) -> float | None:
    """The return that means the goal was reached; None where no return tells it.

    The distances gained telescope, so that the whole distance means the goal. A step's price is not paid in the goal: one
    price less means that it was reached before the last step.
    """
    if options.dislikes or view.goal is None:
        return None
    if options.reward == "goal":
        return STEP_PRICE * (int(options.horizon) - 1)
    return None if view.start is None else whole_distance(options.reward_scale, view.start, view.goal)


def whole_distance(scale: float, start: Cell, goal: Cell) -> float:
    return scale * float(np.abs(np.subtract(start, goal)).sum())
