"""Grids by name: their size, the cells that are forbidden, and those that are unpleasant where the reward is of sites."""

from collections.abc import Mapping
from typing import NamedTuple

Cell = tuple[int, int]  # row, column


class Layout(NamedTuple):
    size: int
    obstacles: tuple[Cell, ...]
    mud: tuple[Cell, ...]

    @property
    def goal(self) -> Cell:
        return (self.size - 1, self.size - 1)


_MUD = ((2, 1), (3, 3))

# The obstacles of second, third and fourth were drawn once by numpy.random.default_rng(1), (2) and (3): five cells other than
# start and goal, redrawn until a clean path of ten steps is left.
LAYOUTS: Mapping[str, Layout] = {
    "default": Layout(6, ((1, 1), (0, 4), (2, 3), (4, 1), (4, 4)), _MUD),
    "second": Layout(6, ((0, 2), (2, 3), (2, 4), (4, 1), (5, 2)), _MUD),
    "third": Layout(6, ((0, 4), (1, 3), (1, 4), (2, 3), (4, 2)), _MUD),
    "fourth": Layout(6, ((0, 3), (1, 5), (2, 2), (2, 5), (3, 3)), ((2, 1), (4, 3))),
    "wall": Layout(
        7,
        ((1, 2), (2, 2), (3, 2), (3, 4), (4, 4), (5, 4), (5, 1), (1, 5)),
        ((2, 0), (4, 2), (3, 5)),
    ),
}
