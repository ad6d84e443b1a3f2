"""Show the progress of a run: a bar on a terminal, a line every few seconds elsewhere."""

import math
import sys
import time
from collections.abc import Mapping, Sequence
from contextlib import suppress
from typing import TYPE_CHECKING, Any

from tqdm import tqdm

from aircl_jax.messages import say

if TYPE_CHECKING:
    from aircl_jax.runs.recorder import Row

LIVE = ("violation_rate", "goal_rate", "return", "balanced_acc")  # the first three that a run measures are shown
SECONDS_BETWEEN_LINES = 10.0


class Reporter:
    """Record one run by printing its progress.

    Speed and time left appear after the first chunk, whose time includes compiling.
    """

    def __init__(self, headline: str) -> None:
        self.headline = headline
        self.data: list[str] = []  # what was read, where something was
        self.iterations = 0
        self.first_chunk: int | None = None  # iteration at which the first chunk ended
        self.steps = self.seconds = 0.0  # sums over the later chunks, without compiling
        self.bar: tqdm | None = None
        self.last_line = float("-inf")

    def on_data(self, account: Sequence[str], warnings: Sequence[str]) -> None:
        self.data = [*account, *(f"warning: {warning}" for warning in warnings)]

    def on_start(self, iteration: int, iterations: int) -> None:
        self.iterations = iterations
        say(self.headline)
        for line in self.data:
            say(f"  {line}")
        say("compiling; the first start takes the longest, later ones use the cache")
        if sys.stdout is not None and sys.stdout.isatty():
            form = "{n_fmt}/{total_fmt} |{bar}| {desc}"
            self.bar = tqdm(total=iterations, initial=iteration, bar_format=form, file=sys.stdout)
            self._draw(iteration, "")

    def on_chunk(self, iteration: int, states: Any, rows: Sequence["Row"], timing: Mapping[str, Any]) -> None:
        if self.first_chunk is None:
            self.first_chunk = iteration
        else:
            self.steps += timing["env_steps"]
            self.seconds += timing["seconds"] - timing["compile_s"]
        details = "  ".join(self._speed(iteration) + _measured(rows[-1]))
        if self.bar:
            self._draw(iteration, details)
        else:
            self._print(iteration, details)

    def close(self) -> None:
        if self.bar:
            with suppress(OSError, ValueError):
                self.bar.close()

    def _draw(self, iteration: int, details: str) -> None:
        if self.bar is None:
            return
        with suppress(OSError, ValueError):  # a terminal that was closed
            self.bar.set_description_str(details, refresh=False)
            self.bar.update(iteration - self.bar.n)
            self.bar.refresh()

    def _print(self, iteration: int, details: str) -> None:
        now = time.monotonic()
        if now - self.last_line >= SECONDS_BETWEEN_LINES or iteration == self.iterations:
            self.last_line = now
            say(f"iteration {iteration}/{self.iterations}  {details}")

    def _speed(self, iteration: int) -> list[str]:
        if self.first_chunk is None or self.seconds <= 0:
            return []
        left = (self.iterations - iteration) * self.seconds / (iteration - self.first_chunk)
        minutes, seconds = divmod(round(left), 60)
        return [f"{self.steps / self.seconds:,.0f} env steps/s", f"{minutes}:{seconds:02d} left"]


def _measured(row: "Row") -> list[str]:
    """Format the means over seeds."""
    means = {name: float(row[name].mean()) for name in LIVE if name in row}
    return [f"{name} {mean:.3g}" for name, mean in means.items() if math.isfinite(mean)][:3]
