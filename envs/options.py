"""The settings of every environment, light enough to import without the environment itself (MJX alone takes seconds)."""

from dataclasses import dataclass, field, replace
from typing import Literal

from envs.layouts import LAYOUTS
from envs.robots.factors import BodyOptions, HalfCheetahBody, HopperBody, PendulumBody, SwimmerBody, WalkerBody

LONGEST = 100_000  # steps of an episode: rounds of longer ones fit into no memory
STEP_PRICE = -3.0  # of a step outside the goal, where the reward is of the goal
HORIZONS = {"goal": 20, "sites": 15}  # steps; of the distance: the way across the layout and back, Table 2's 10 at 6×6


class Options:
    """Settings of a world."""

    def resolved(self) -> "Options":
        """The same settings with what "default" stands for, where that follows from others. Raises ValueError."""
        return self


@dataclass(frozen=True)
class GridOptions(Options):
    """A grid with obstacles that may be entered; cells are [row, column]. What is given replaces the layout's own."""

    layout: str = "default"  # default: the paper's Section 7.1; second, third: other obstacles; wall: 7×7 with corridors
    reward: str = "distance"  # distance: gained; goal: −3 a step outside it; sites: three that absorb, and mud
    size: int | Literal["default"] = "default"  # default: the layout's
    start: tuple[int, int] | Literal["any"] = (0, 0)  # any: each clean cell that does not absorb is as likely
    goal: tuple[int, int] | Literal["default"] = "default"  # default: the layout's last cell; none where there are sites
    obstacles: tuple[tuple[int, int], ...] | Literal["default"] = "default"  # default: the layout's
    walls: tuple[tuple[int, int], ...] = ()  # cells that cannot be entered: the move stays where it was
    dislikes: tuple[tuple[int, int], ...] = ()  # allowed cells in which a step's reward is lowered: a taste, no constraint
    dislike: float = 3.0  # by how much
    slip: float = 0.01  # probability that a uniformly random action replaces the chosen one; Section 7.1
    wind: float = 0.0  # probability that the move down replaces the one that would be made
    horizon: int | Literal["default"] = "default"  # steps; default: the reward's, HORIZONS
    reward_scale: float = 5.0  # true reward per unit of Manhattan distance gained
    temperature: float = 1.0  # of the expert's MaxEnt policy
    lapse: float = 0.0  # share of the expert's actions that are uniformly random, into obstacles too

    def resolved(self) -> "GridOptions":
        _require(self.layout in LAYOUTS, "env.layout", self.layout, ", ".join(LAYOUTS))
        _require(self.reward in ("distance", *HORIZONS), "env.reward", self.reward, "distance, goal or sites")
        layout, has_sites = LAYOUTS[self.layout], self.reward == "sites"
        if has_sites and self.goal != "default":
            raise ValueError(f"env.goal={list(self.goal)}: reward=sites has three sites in its place; choose goal=default")
        if self.reward != "distance" and self.reward_scale != GridOptions.reward_scale:
            raise ValueError(f"env.reward_scale={self.reward_scale} is of reward=distance; choose it, or leave the scale")
        across = 2 * (layout.size - 1)
        return replace(
            self,
            size=layout.size if self.size == "default" else self.size,
            goal=layout.goal if self.goal == "default" and not has_sites else self.goal,
            obstacles=layout.obstacles if self.obstacles == "default" else self.obstacles,
            horizon=HORIZONS.get(self.reward, across) if self.horizon == "default" else self.horizon,
        )


@dataclass(frozen=True)
class NonMarkovOptions(Options):
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
class RobotOptions(Options):
    """Settings shared by the MuJoCo bodies. Raises ValueError on a value that no body can have."""

    constraint: str = "torque"  # torque, position, none or a row of your own (CONSTRAINTS); speed, height, tilt, joint
    limit: float | Literal["default"] = "default"  # threshold of the constraint; the benchmark's where it says default
    side: Literal["default", "above", "below", "outside"] = "default"  # of the limit that violates (speed, height, tilt, joint)
    joint: str = ""  # of constraint=joint: its name
    noise: float = 0.001  # standard deviation of the noise on qpos and qvel after each control step
    terminate: bool = False  # Gymnasium's early end instead of a fixed horizon
    horizon: int = 500  # control steps; Table 2
    integrator: Literal["euler", "rk4"] = "euler"
    engine: Literal["planar", "mjx"] = "planar"  # planar: MuJoCo's equations for a plane; mjx: slower
    reward: str = "task"  # task, or a name in envs.robots.rewards.REWARDS: backwards, stand, target
    target: float = 1.0  # m, where reward=target draws to along x
    action_cost: float = 0.0  # w of an additional −w‖a‖² in the reward
    body: BodyOptions = field(default_factory=BodyOptions)  # factors of masses, lengths and motors; envs.robots.factors

    def __post_init__(self) -> None:
        _require(self.noise >= 0, "env.noise", self.noise, "a number that is not negative")
        _require(self.horizon > 0, "env.horizon", self.horizon, "a whole number above 0")
        _require(self.action_cost >= 0, "env.action_cost", self.action_cost, "a number that is not negative")


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
class HalfCheetahOptions(RobotOptions):
    body: HalfCheetahBody = field(default_factory=HalfCheetahBody)


@dataclass(frozen=True)
class HopperOptions(RobotOptions):
    body: HopperBody = field(default_factory=HopperBody)


@dataclass(frozen=True)
class PendulumOptions(RobotOptions):
    constraint: str = "position"
    horizon: int = 100
    target: float = 0.5
    body: PendulumBody = field(default_factory=PendulumBody)


@dataclass(frozen=True)
class MeerkatOptions(Options):
    """Tables of meerkat tracks, or of any animal with a mapping; the simulated mob where there are none."""

    data: str = "default"  # folder of tables; default: that of the variable AIRCL_DATA, else simulated; simulated
    mapping: str = "meerkat"  # which column is which: a name in envs/animals/mappings, or a YAML file
    coding: Literal["bout", "step"] = "bout"  # what becomes "moving to a place"; envs.animals.windows.code_rows
    # place: the place and the counts of close and distant neighbours; full: all that the behaviour model sees; default: code,
    # and full where the method is fitted by likelihood
    state: Literal["default", "code", "place", "full"] = "default"
    pups: bool = False  # also the animals whose behaviour was not annotated, with a code of their own
    horizon: int = 30  # steps of one row (1 s); Table 2
    split: Literal["all", "train", "held_out"] = "all"  # of the recordings: what is learned from
    fold: int = 0  # which two recordings are held out of the split "train"

    def resolved(self) -> "MeerkatOptions":
        return replace(self, state="code") if self.state == "default" else self


@dataclass(frozen=True)
class LabyrinthOptions(Options):
    """Mice in a labyrinth of 127 nodes (Rosenberg et al. 2021), or simulated ones in the same kind of maze."""

    data: str = "default"  # folder with emissions.npy and trans_probs.npy; as for MeerkatOptions
    horizon: int = 50  # steps from node to node: to the water port and back
    split: Literal["all", "train", "held_out"] = "all"  # of the recordings: what is learned from
    fold: int = 0  # which tenth of the recordings is held out of the split "train"
