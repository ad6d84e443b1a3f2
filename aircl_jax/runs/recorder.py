"""Define recorders, which a run calls after each chunk: its directory, a progress bar, or the user's own."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Protocol, runtime_checkable

import numpy as np

from aircl_jax.runs.metrics_log import stack

Row = Mapping[str, np.ndarray]  # one iteration's metrics, each [S]


@runtime_checkable
class Recorder(Protocol):
    """Any object with `on_chunk`. An exception from it ends the run, after the recorders before it were called."""

    def on_chunk(self, iteration: int, states: Any, rows: Sequence[Row], timing: Mapping[str, Any]) -> None:
        """Note a chunk: the iteration reached, the states of all seeds, the chunk's rows and its line of timing.

        The next chunk reuses the states' memory. Copy the states to keep them, for instance with `jax.device_get`.
        """
        ...


@runtime_checkable
class StartRecorder(Protocol):
    """A recorder whose `on_start` is called before anything is compiled."""

    def on_start(self, iteration: int, iterations: int) -> None:
        """Note the iteration at which the run starts and the one at which it ends."""
        ...


@runtime_checkable
class DataRecorder(Protocol):
    """A recorder whose `on_data` is called before training where demonstrations are recorded."""

    def on_data(self, account: Sequence[str], warnings: Sequence[str]) -> None:
        """Note what was read and what was left out of it, and what to know of it before training."""
        ...


@dataclass
class Memory:
    """Keep rows and timing of a run without a directory."""

    rows: list[Row] = field(default_factory=list)
    lines: list[Mapping[str, Any]] = field(default_factory=list)

    def on_chunk(self, iteration: int, states: Any, rows: Sequence[Row], timing: Mapping[str, Any]) -> None:
        self.rows += rows
        self.lines.append(timing)

    def history(self) -> dict[str, np.ndarray]:
        """Stack the metrics: {metric: [iterations, S]}."""
        return stack(self.rows)

    def timing(self) -> list[Mapping[str, Any]]:
        return self.lines
