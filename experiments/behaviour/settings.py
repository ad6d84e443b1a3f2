"""The settings of `python -m experiments.behaviour`, and where its results go."""

from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from envs.animals.data_folder import data_folder
from envs.settings import at_least

RESULTS = "results/behaviour"  # of the recordings that this project reports
ELSEWHERE = "runs/behaviour"  # of anybody else's


@dataclass(frozen=True)
class Settings:
    env: Literal["meerkat", "labyrinth", "mobs"] = "meerkat"
    data: str = "default"  # folder of tables, simulated, or default: the folder of the variable AIRCL_DATA
    mapping: str = "meerkat"
    coding: Literal["bout", "step"] = "bout"
    halves: int = 6
    nested: bool = False
    mobs: int = 10
    out: str = "default"

    def __post_init__(self) -> None:
        at_least("halves", self.halves, 0)
        at_least("mobs", self.mobs, 1)
        if self.env != "meerkat" and self.mapping != "meerkat":
            raise ValueError(
                f"env={self.env} mapping={self.mapping}: a mapping is of env=meerkat, whatever the animal; leave env out"
            )

    @property
    def simulated(self) -> bool:
        return self.env == "mobs" or data_folder(self.data, self.env) is None

    @property
    def reported(self) -> bool:
        """Whether these are the recordings and settings of the project's own results."""
        own = self.mapping == "meerkat" and self.coding == "bout" and (not self.simulated or self.env == "mobs")
        return own and self.data == self.out == "default"

    @property
    def folder(self) -> Path:
        """Return where report, figures and arrays go."""
        if self.out != "default":
            return Path(self.out)
        if self.reported:
            return Path(RESULTS) / self.env
        name = Path(self.mapping).stem if self.mapping != "meerkat" else f"{self.env}_simulated" if self.simulated else self.env
        return Path(ELSEWHERE) / (name if self.coding == "bout" else f"{name}_{self.coding}")
