"""The settings of every environment, light enough to import without the environment itself (MJX alone takes seconds)."""

from dataclasses import dataclass
from typing import Literal


@dataclass(frozen=True)
class GridOptions:
    """The 6×6 grid of the paper's Section 7.1; cells are [row, column]."""

    size: int = 6
    start: tuple[int, int] = (0, 0)
    goal: tuple[int, int] = (5, 5)
    obstacles: tuple[tuple[int, int], ...] = ((1, 1), (0, 4), (2, 3), (4, 1), (4, 4))
    slip: float = 0.01  # probability that a uniformly random action replaces the chosen one; Section 7.1
    horizon: int = 10  # steps; Table 2
    reward_scale: float = 5.0  # true reward per unit of Manhattan distance gained
    temperature: float = 1.0  # of the expert's MaxEnt policy


@dataclass(frozen=True)
class NonMarkovOptions:
    """The grid without obstacles: infeasible are the trajectories that visit zone A and later zone B; each alone is allowed."""

    size: int = 6
    start: tuple[int, int] = (0, 0)
    goal: tuple[int, int] = (5, 5)
    zone_a: tuple[tuple[int, int], ...] = ((1, 2), (2, 1))
    zone_b: tuple[tuple[int, int], ...] = ((3, 4), (4, 3))
    slip: float = 0.01
    horizon: int = 10
    reward_scale: float = 5.0
    temperature: float = 1.0


@dataclass(frozen=True)
class RobotOptions:
    """Settings shared by the MuJoCo bodies. Raises ValueError on a value that no body can have."""

    constraint: str = "torque"  # a name in envs.robots.constraints.CONSTRAINTS: torque, position, none, or one of your own
    limit: float | Literal["default"] = "default"  # threshold of the constraint; the benchmark's where it says default
    noise: float = 0.001  # standard deviation of the noise on qpos and qvel after each control step
    terminate: bool = False  # Gymnasium's early end instead of a fixed horizon
    horizon: int = 500  # control steps; Table 2
    integrator: Literal["euler", "rk4"] = "euler"
    engine: Literal["planar", "mjx"] = "planar"  # planar: MuJoCo's equations for a plane; mjx: slower

    def __post_init__(self) -> None:
        _require(self.noise >= 0, "env.noise", self.noise, "a number that is not negative")
        _require(self.horizon > 0, "env.horizon", self.horizon, "a whole number above 0")


def _require(holds: bool, setting: str, value: object, choices: str) -> None:
    if not holds:
        raise ValueError(f"wrong {setting} {value!r}; choose {choices}")


@dataclass(frozen=True)
class PendulumOptions(RobotOptions):
    constraint: str = "position"
    horizon: int = 100


@dataclass(frozen=True)
class MeerkatOptions:
    """Tables of meerkat tracks, or of any animal with a mapping; the simulated mob where there are none."""

    data: str = "default"  # folder of tables; default: that of the variable AIRCL_DATA, else simulated; simulated
    mapping: str = "meerkat"  # which column is which: a name in envs/animals/mappings, or a YAML file
    coding: Literal["bout", "step"] = "bout"  # what becomes "moving to a place"; envs.animals.windows.code_rows
    state: Literal["code", "place"] = "code"  # place: the place and the counts of close and distant neighbours
    pups: bool = False  # also the animals whose behaviour was not annotated, with a code of their own
    horizon: int = 30  # steps of one row (1 s); Table 2
    split: Literal["all", "train", "held_out"] = "all"  # of the recordings: what is learned from
    fold: int = 0  # which two recordings are held out of the split "train"


@dataclass(frozen=True)
class LabyrinthOptions:
    """Mice in a labyrinth of 127 nodes (Rosenberg et al. 2021), or simulated ones in the same kind of maze."""

    data: str = "default"  # folder with emissions.npy and trans_probs.npy; as for MeerkatOptions
    horizon: int = 50  # steps from node to node: to the water port and back
    split: Literal["all", "train", "held_out"] = "all"  # of the recordings: what is learned from
    fold: int = 0  # which tenth of the recordings is held out of the split "train"
