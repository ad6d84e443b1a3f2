"""Define what all loggers do: means over seeds, an iteration at a time, and no fault of theirs ends a run."""

import importlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from aircl_jax.messages import warn

Row = Mapping[str, np.ndarray]  # one iteration's metrics, each [S]


@dataclass(frozen=True)
class Run:
    """What a logger is told of a run."""

    name: str  # such as "gridworld/aircl_contrast"
    folder: Path  # of the run; a logger writes into a folder of its own in there
    settings: Mapping[str, Any] = field(default_factory=dict)  # by full name, as in env.slip


class Logger:
    """A recorder that hands each iteration's numbers on. A logger fills in `begin`, `write` and `end`."""

    word = ""  # of `log=…`

    def __init__(self, run: Run) -> None:
        self.run = run
        self._begun = self._failed = False

    def begin(self) -> None:
        """Open whatever is written to; called once, when the run's folder is there."""
        raise NotImplementedError

    def write(self, step: int, values: Mapping[str, float]) -> None:
        """Write the finite numbers of one iteration."""
        raise NotImplementedError

    def end(self) -> None:
        """Write what is left and close."""

    def on_chunk(self, iteration: int, states: Any, rows: Sequence[Row], timing: Mapping[str, Any]) -> None:
        """Write the rows of a chunk, and its timing with the last of them."""
        first = iteration - len(rows) + 1
        for place, row in enumerate(rows):
            values = summed_up(row)
            if place == len(rows) - 1:
                values |= {f"time/{name}": float(timing[name]) for name in ("seconds", "env_steps") if name in timing}
            self._try(lambda step=first + place, values=values: self.write(step, values))

    def close(self) -> None:
        """End the log, if it was begun."""
        if self._begun:
            self._try(self.end)

    def _try(self, task: Any) -> None:
        if self._failed:
            return
        try:
            if not self._begun:
                self.begin()
                self._begun = True
            task()
        except Exception as error:  # of any kind: it is another's code, and often a network's
            self._failed = True
            reason = (str(error) or type(error).__name__).splitlines()[0]
            warn(f"log={self.word}: {reason}; nothing more is logged there, the run goes on")


def summed_up(row: Row) -> dict[str, float]:
    """The mean of each metric over the seeds where it is finite, NAME/std of several; nothing of what is nowhere finite."""
    values: dict[str, float] = {}
    for name, of_seeds in row.items():
        finite = np.asarray(of_seeds, np.float64)[np.isfinite(of_seeds)]
        if len(finite):
            values[name] = float(finite.mean())
        if len(finite) > 1:
            values[f"{name}/std"] = float(finite.std(ddof=1))
    return values


def imported(word: str, package: str, extra: str = "aircl-jax[log]") -> Any:
    """Import a logger's package. Raises ValueError, in one line, where it is not installed."""
    try:
        return importlib.import_module(package)
    except ImportError as error:
        raise ValueError(f"log={word} needs the package {package}, which is not installed; install {extra}") from error
