"""How far a run is: a bar on a terminal, a plain line now and then elsewhere."""

import math
import sys
import time
from typing import TYPE_CHECKING

from tqdm import tqdm

if TYPE_CHECKING:
    from aircl_jax.runs.loop import Progress

LIVE = ("violation_rate", "goal_rate", "return", "balanced_acc")  # the first three of these that a run measures
SECONDS_BETWEEN_LINES = 10.0


class Reporter:
    """Callable with each `Progress` of one run."""

    def __init__(self, headline: str) -> None:
        self.headline = headline
        self.bar: tqdm | None = None
        self.last_line = float("-inf")

    def __call__(self, progress: "Progress") -> None:
        if not progress.metrics:
            print(self.headline)
            print("compiling; the first start takes the longest, later ones use the cache", flush=True)
        if sys.stdout.isatty():
            self._draw(progress)
        elif progress.metrics:
            self._print(progress)

    def close(self) -> None:
        if self.bar:
            self.bar.close()

    def _draw(self, progress: "Progress") -> None:
        if self.bar is None:
            form = "{n_fmt}/{total_fmt} |{bar}| {desc}"
            self.bar = tqdm(total=progress.iterations, initial=progress.iteration, bar_format=form, file=sys.stdout)
        self.bar.set_description_str(_details(progress), refresh=False)
        self.bar.update(progress.iteration - self.bar.n)
        self.bar.refresh()

    def _print(self, progress: "Progress") -> None:
        now = time.monotonic()
        if now - self.last_line >= SECONDS_BETWEEN_LINES or progress.iteration == progress.iterations:
            self.last_line = now
            print(f"iteration {progress.iteration}/{progress.iterations}  {_details(progress)}", flush=True)


def _details(progress: "Progress") -> str:
    parts = []
    if progress.env_steps_per_s is not None and progress.seconds_left is not None:
        minutes, seconds = divmod(round(progress.seconds_left), 60)
        parts += [f"{progress.env_steps_per_s:,.0f} env steps/s", f"{minutes}:{seconds:02d} left"]
    measured = [name for name in LIVE if math.isfinite(progress.metrics.get(name, math.nan))][:3]
    return "  ".join([*parts, *(f"{name} {progress.metrics[name]:.3g}" for name in measured)])
