"""Hold the benchmark's settings, and refuse those that do not go together."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

from envs.settings import at_least
from experiments.cli.words import listed, refuse_short_runs, smoke_budget
from experiments.physics import BODIES

RESULTS = "results/speed"  # cells; the page is beside the folder
WORLDS = ("gridworld", "swimmer", "pendulum", "walker")  # of the comparison: those of the kept cells of Table 1
PEER_PYTHON = Path(".venv-peer/bin/python")
OF_ONE = ("method", "chunk", "epochs", "integrator")  # settings that peer=true does not have
OF_PEER = ("scale", "out")  # settings that it alone has


@dataclass(frozen=True)
class Settings:
    env: str = "default"
    method: str = "aircl_corrected"
    seeds: int = 10
    chunk: int = 0
    epochs: int = 0
    integrator: Literal["euler", "rk4"] = "euler"
    peer: bool = False
    scale: Literal["full", "smoke"] = "full"
    out: str = "default"

    def __post_init__(self) -> None:
        at_least("seeds", self.seeds, 1)
        for name in OF_ONE if self.peer else OF_PEER:
            value = getattr(self, name)
            if value != type(self).__dataclass_fields__[name].default:
                instead = "leave it out" if self.peer else "add peer=true, or leave it out"
                raise ValueError(f"{name}={value} {'is not' if self.peer else 'is'} of peer=true; {instead}")
        if self.integrator != "euler" and self.world not in BODIES:
            raise ValueError(f"integrator={self.integrator}: env={self.world} has none; choose from {', '.join(BODIES)}")

    @property
    def world(self) -> str:
        """The environment of the report of one."""
        return "gridworld" if self.env == "default" else self.env

    @property
    def worlds(self) -> tuple[str, ...]:
        """The environments that are compared. Raises ValueError for one without a comparison."""
        return listed("env", "all" if self.env == "default" else self.env, WORLDS)

    @property
    def folder(self) -> Path:
        """The folder of the comparison's cells. Raises ValueError where these are not the ones that belong there."""
        default = RESULTS if self.scale == "full" else "runs/speed_smoke"
        out = default if self.out == "default" else self.out
        refuse_short_runs(self.seeds, int(self.scale == "smoke"), out, RESULTS)
        return Path(out)

    @property
    def seeds_here(self) -> int:
        return self.seeds if self.scale == "full" else min(self.seeds, smoke_budget()["seeds"])

    @property
    def env_settings(self) -> dict[str, Any]:
        return {"integrator": self.integrator} if self.world in BODIES else {}

    @property
    def training(self) -> dict[str, Any]:
        own = {"checkpoint_every": self.chunk} if self.chunk else {}
        return own | ({"ppo": {"num_epochs": self.epochs}} if self.epochs else {})


@dataclass(frozen=True)
class Effort:
    """How much of the comparison is run."""

    repeats: int  # of each timing
    steps: int  # of all seeds together in each timing of training, about
    search_s: float  # seconds for which imitation trains by its own settings
    episodes: int  # by which it is judged after each of its rounds; ten times as many where they are short
    physics: tuple[int, int]  # environments and control steps of bare physics


EFFORTS = {"full": Effort(5, 160_000, 45.0, 10, (500, 40)), "smoke": Effort(2, 1, 0.0, 10, (4, 5))}
