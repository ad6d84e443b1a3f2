"""How a world is drawn and what its observations and actions are called: `Env.view` is one of these."""

from collections.abc import Mapping
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int

from envs.layouts import Cell

if TYPE_CHECKING:
    from envs.animals.full.steps import Recordings


class Coordinates(NamedTuple):
    """A world of numbers: the names of an observation's coordinates and of a Box action's motors. Empty: by number."""

    names: tuple[str, ...] = ()
    motors: tuple[str, ...] = ()
    units: tuple[str, ...] = ()  # of the coordinates; empty: not known


class Grid(NamedTuple):
    """A square grid: cells are [row, column], and observation i is one-hot of [i // size, i % size]."""

    size: int
    start: Cell | None  # None: several cells
    goal: Cell | None  # None: there is none
    zones: dict[str, tuple[Cell, ...]]  # the cells that the constraint speaks of, by name
    sites: Mapping[Cell, float] = {}  # cells that absorb as a goal does, and their reward
    tastes: tuple[Cell, ...] = ()  # allowed cells that the reward speaks against
    walls: tuple[Cell, ...] = ()  # cells that cannot be entered

    @property
    def absorbing(self) -> tuple[Cell, ...]:
        return (*self.sites, *([] if self.goal is None else [self.goal]))


class Codes(NamedTuple):
    """A world of codes: observation i is one-hot of code i, and action j makes j the next code."""

    names: tuple[str, ...]
    impossible: Bool[np.ndarray, "C C"]  # [from, to] that recording and coding rule out, whatever the animals want


class Maze(NamedTuple):
    """A world of nodes: observation i is one-hot of node i."""

    position: Float[np.ndarray, "X 2"]  # where to draw each node
    successor: Int[np.ndarray, "X A"]
    marks: dict[str, int]  # the nodes that have a name


class Activities(NamedTuple):
    """A world of activities at places: `envs.animals.full.observation` reads what an observation holds of an animal."""

    coordinates: tuple[str, ...]
    recordings: "Recordings"


BY_NUMBER = Coordinates()

View = Coordinates | Grid | Codes | Maze | Activities
