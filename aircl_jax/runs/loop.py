"""Train a run in chunks of iterations; after each chunk, evaluate and call the recorders."""

import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from functools import partial
from typing import Any

import jax
import numpy as np

from aircl_jax.algorithm.trainer import FINITE
from aircl_jax.runs import world
from aircl_jax.runs.recorder import Recorder, Row, StartRecorder
from aircl_jax.runs.seeds import Runner
from aircl_jax.types import TrainState, Trajectory

Evaluate = Callable[[TrainState], Row]
Since = list[int | None]  # for each seed the first iteration in which a number was not finite; None where all are


class Stopwatch:
    """Measure wall time since the start or the last lap, and the part of it that lowering and compiling took."""

    compiling: float = 0.0  # seconds of this process, because JAX's reports belong to no single stopwatch
    listening: bool = False

    def __init__(self) -> None:
        if not Stopwatch.listening:
            Stopwatch.listening = True
            jax.monitoring.register_event_duration_secs_listener(_note_compilation)
        self.now, self.compiled = time.perf_counter(), Stopwatch.compiling

    def lap(self) -> dict[str, float]:
        """Return the seconds since the last lap, and the compile seconds among them."""
        now, compiled = time.perf_counter(), Stopwatch.compiling
        seconds, compile_s = now - self.now, compiled - self.compiled
        self.now, self.compiled = now, compiled
        return {"seconds": round(seconds, 4), "compile_s": round(compile_s, 4)}


def _note_compilation(event: str, duration_secs: float, **_: Any) -> None:
    if event in ("/jax/core/compile/jaxpr_to_mlir_module_duration", "/jax/core/compile/backend_compile_duration"):
        Stopwatch.compiling += duration_secs


def run_session(
    runner: Runner,
    states: TrainState,
    expert: Trajectory,
    *,
    start: int,
    iterations: int,
    chunk: int,
    evaluate: Evaluate,
    env_steps: int,
    stopwatch: Stopwatch,
    recorders: Sequence[Recorder],
    since: Since | None = None,
    stop: Callable[[], None] = lambda: None,
) -> tuple[TrainState, Row]:
    """Train from `start` to `iterations`, and return the states and their evaluation.

    `env_steps` counts the steps of one iteration over all seeds. The first chunk's time runs from the start of
    `stopwatch`, a later chunk's from the end of the chunk before, so that it includes the recorders' time between them.

    Chunks end at multiples of `chunk` wherever the run starts or ends, so a resumed run compiles and computes the same.
    `stop` is called before the first chunk, and after each one and all recorders; what it raises ends the session. A seed
    in which a number was not finite, in this session or `since` an earlier one, has no measures from then on. In a world of
    processes the first one's recorders are called.
    """
    world.in_first(lambda: _started(recorders, start, iterations))
    iteration, evaluation = start, None
    stop()
    while iteration < iterations:
        end = min(iteration - iteration % chunk + chunk, iterations)
        length = end - iteration
        with defects_apart():
            states, metrics = runner.run_chunk(states, expert, length)
            metrics = jax.device_get(world.gathered(metrics))
            evaluation = evaluate(states)
        since = _not_finite_since(since, metrics.pop(FINITE, None), iteration)
        rows: list[Row] = [{name: values[i] for name, values in metrics.items()} for i in range(length)]
        if end % chunk == 0:
            rows[-1] = {**rows[-1], **evaluation}
        timing = {"iteration": end, "env_steps": length * env_steps, "first": iteration == start, **stopwatch.lap()}
        if since:
            rows = [without(row, since, iteration + i) for i, row in enumerate(rows, 1)]
            timing["not_finite"] = since
        everyones = world.gathered(states)
        world.in_first(partial(_recorded, recorders, end, everyones, rows, timing))
        iteration = end
        stop()
    if evaluation is None:
        with defects_apart():
            evaluation = evaluate(states)
    return world.gathered(states), evaluation


def _started(recorders: Sequence[Recorder], start: int, iterations: int) -> None:
    for recorder in recorders:
        if isinstance(recorder, StartRecorder):
            recorder.on_start(start, iterations)


def _recorded(
    recorders: Sequence[Recorder], end: int, states: TrainState, rows: Sequence[Row], timing: Mapping[str, Any]
) -> None:
    for recorder in recorders:
        recorder.on_chunk(end, states, rows, timing)


def _not_finite_since(since: Since | None, finite: np.ndarray | None, done: int) -> Since | None:
    """Update `since` by what [length, S] iterations after the first `done` say; None while every number was finite."""
    if finite is None or (since is None and finite.all()):
        return since
    found = [None if seed.all() else done + 1 + int(seed.argmin()) for seed in finite.T]
    return [earlier or now for earlier, now in zip(since or [None] * len(found), found, strict=True)]


def without(row: Row, since: Since, iteration: int) -> Row:
    """Return a row of measures, [S] or [S, …], undefined for the seeds that are not finite in that iteration."""
    lost = np.array([first is not None and first <= iteration for first in since])
    return {name: np.where(lost.reshape(-1, *[1] * (np.ndim(values) - 1)), np.nan, values) for name, values in row.items()}


def since_of(timing: Sequence[Mapping[str, Any]]) -> Since | None:
    """Read from the lines of timing since when each seed is not finite."""
    return timing[-1].get("not_finite") if timing else None


@contextmanager
def defects_apart() -> Iterator[None]:
    """Re-raise a ValueError from inside training as RuntimeError, so that callers can treat ValueError as bad input."""
    try:
        yield
    except ValueError as error:
        raise RuntimeError(f"training failed: {error}") from error
