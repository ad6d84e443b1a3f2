"""The settings of every environment, light enough to import without the environment itself (MJX alone takes seconds)."""

from dataclasses import dataclass, field
from math import inf, isfinite
from typing import Literal

from envs.robots.factors import BodyOptions, PendulumBody, SwimmerBody, WalkerBody


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
    limit: float | str = "default"  # threshold of the constraint; the benchmark's where it says default
    noise: float = 0.001  # standard deviation of the noise on qpos and qvel after each control step
    terminate: bool = False  # Gymnasium's early end instead of a fixed horizon
    horizon: int = 500  # control steps; Table 2
    integrator: str = "euler"  # euler, rk4
    engine: str = "planar"  # planar: MuJoCo's equations for a plane; mjx: mjx.step itself, several times slower
    reward: str = "task"  # task, or a name in envs.robots.rewards.REWARDS: backwards, stand, target
    target: float = 1.0  # m, where reward=target draws to along x
    action_cost: float = 0.0  # w of an additional −w‖a‖² in the reward
    body: BodyOptions = field(default_factory=BodyOptions)  # factors of masses, lengths and motors; envs.robots.factors

    def __post_init__(self) -> None:
        is_number = isinstance(self.limit, (int, float)) and not isinstance(self.limit, bool) and isfinite(self.limit)
        _require(is_number or self.limit == "default", "env.limit", self.limit, "a number or default")
        is_number = isinstance(self.noise, (int, float)) and not isinstance(self.noise, bool)
        _require(is_number and 0 <= self.noise < inf, "env.noise", self.noise, "a number that is not negative")
        whole = isinstance(self.horizon, int) and not isinstance(self.horizon, bool)
        _require(whole and self.horizon > 0, "env.horizon", self.horizon, "a whole number above 0")
        _require(isinstance(self.terminate, bool), "env.terminate", self.terminate, "true or false")
        _require(self.integrator in ("euler", "rk4"), "env.integrator", self.integrator, "euler or rk4")
        _require(self.engine in ("planar", "mjx"), "env.engine", self.engine, "planar or mjx")
        is_number = isinstance(self.target, (int, float)) and not isinstance(self.target, bool) and isfinite(self.target)
        _require(is_number, "env.target", self.target, "a number")
        is_number = isinstance(self.action_cost, (int, float)) and not isinstance(self.action_cost, bool)
        _require(
            is_number and 0 <= self.action_cost < inf, "env.action_cost", self.action_cost, "a number that is not negative"
        )


def _require(holds: bool, setting: str, value: object, choices: str) -> None:
    if not holds:
        raise ValueError(f"wrong {setting} {value!r}; choose {choices}")


@dataclass(frozen=True)
class SwimmerOptions(RobotOptions):
    body: SwimmerBody = field(default_factory=SwimmerBody)


@dataclass(frozen=True)
class WalkerOptions(RobotOptions):
    body: WalkerBody = field(default_factory=WalkerBody)


@dataclass(frozen=True)
class PendulumOptions(RobotOptions):
    constraint: str = "position"
    horizon: int = 100
    target: float = 0.5
    body: PendulumBody = field(default_factory=PendulumBody)


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
