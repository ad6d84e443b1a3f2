"""What is told of a run as it goes: the run's directory, a progress bar, and recorders of one's own."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Protocol, runtime_checkable

import numpy as np

from aircl_jax.runs.metrics_log import stack

Row = Mapping[str, np.ndarray]  # one iteration's metrics, each [S]


@runtime_checkable
class Recorder(Protocol):
    """Whatever has `on_chunk`. What it raises ends the run; recorders before it have been told by then."""

    def on_chunk(self, iteration: int, states: Any, rows: Sequence[Row], timing: Mapping[str, Any]) -> None:
        """Note a chunk: the iteration reached, the states of all seeds, the chunk's rows and its line of timing.

        The next chunk uses the states' memory again: copy what is to be kept, as with `jax.device_get`.
        """
        ...


@runtime_checkable
class StartRecorder(Protocol):
    """A recorder that also has `on_start` is told of the start, before anything is compiled."""

    def on_start(self, iteration: int, iterations: int) -> None:
        """Note where the run starts and how far it is to go."""
        ...


@dataclass
class Memory:
    """Keeps rows and timing of a run that has no directory."""

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
