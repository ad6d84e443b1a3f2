"""The settings of worlds that other libraries make, light enough to import without them."""

from dataclasses import dataclass
from typing import Literal

from envs.options import Options


@dataclass(frozen=True)
class GuestOptions(Options):
    """Which task, and what a step may not do there. Raises ValueError on a value that no world can have."""

    task: str = ""  # the library's own name of it
    constraint: str = "none"  # torque, position, speed, height, tilt, joint: those that the body has; none
    limit: float | Literal["default"] = "default"  # threshold of the constraint; it has none of its own
    side: Literal["default", "above", "below", "outside"] = "default"  # of the limit that violates
    joint: str = ""  # of constraint=joint: its name
    horizon: int = 500  # control steps

    def __post_init__(self) -> None:
        if self.horizon < 1:
            raise ValueError(f"wrong env.horizon {self.horizon!r}; choose a whole number above 0")


@dataclass(frozen=True)
class BraxOptions(GuestOptions):
    """A task of `brax.envs`."""

    task: str = "inverted_pendulum"  # ant, halfcheetah, hopper, walker2d, reacher, …
    backend: Literal["generalized", "spring", "positional", "mjx"] = "generalized"
    terminate: bool = False  # the task's early end instead of a fixed horizon


@dataclass(frozen=True)
class PlaygroundOptions(GuestOptions):
    """A task of MuJoCo Playground."""

    task: str = "CartpoleBalance"
    observation: str = ""  # which of its observations is seen, where it has several by name
    terminate: bool = False  # the task's early end instead of a fixed horizon


@dataclass(frozen=True)
class GymnasiumOptions(GuestOptions):
    """A registered environment of Gymnasium, which is not JAX: every step is a call of the host."""

    task: str = "Pendulum-v1"  # an ID that `gymnasium.make` takes; MODULE:ID imports the module first
    constraint: str = "none"  # torque, coordinate, info (its own info["cost"]), none; a MuJoCo body's also speed, height, …
    horizon: int = 200  # control steps; the environment's own time limit is set to it
    coordinate: int = 0  # of constraint=coordinate: the number of an observation's coordinate
