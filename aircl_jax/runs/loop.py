"""Train a run in chunks of iterations; after each chunk, evaluate and call the recorders."""

import signal
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from typing import Any

import jax

from aircl_jax.runs.recorder import Recorder, Row, StartRecorder
from aircl_jax.runs.seeds import Runner
from aircl_jax.types import TrainState, Trajectory

Evaluate = Callable[[TrainState], Row]


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
) -> tuple[TrainState, Row]:
    """Train from `start` to `iterations`, and return the states and their evaluation.

    `env_steps` counts the steps of one iteration over all seeds. The first chunk's time runs from the start of
    `stopwatch`, a later chunk's from the end of the chunk before, so that it includes the recorders' time between them.

    Chunks end at multiples of `chunk` wherever the run starts or ends, so a resumed run compiles and computes the same.
    An interrupt waits for the chunk's end and all recorders; then KeyboardInterrupt is raised.
    """
    for recorder in recorders:
        if isinstance(recorder, StartRecorder):
            recorder.on_start(start, iterations)
    iteration, evaluation = start, None
    with _noted_interrupts() as interrupts:
        while iteration < iterations:
            end = min(iteration - iteration % chunk + chunk, iterations)
            length = end - iteration
            with defects_apart():
                states, metrics = runner.run_chunk(states, expert, length)
                metrics = jax.device_get(metrics)
                evaluation = evaluate(states)
            rows: list[Row] = [{name: values[i] for name, values in metrics.items()} for i in range(length)]
            if end % chunk == 0:
                rows[-1] = {**rows[-1], **evaluation}
            timing = {"iteration": end, "env_steps": length * env_steps, "first": iteration == start, **stopwatch.lap()}
            for recorder in recorders:
                recorder.on_chunk(end, states, rows, timing)
            iteration = end
            if interrupts:
                raise KeyboardInterrupt
    if evaluation is None:
        with defects_apart():
            evaluation = evaluate(states)
    return states, evaluation


@contextmanager
def defects_apart() -> Iterator[None]:
    """Re-raise a ValueError from inside training as RuntimeError, so that callers can treat ValueError as bad input."""
    try:
        yield
    except ValueError as error:
        raise RuntimeError("training failed") from error


@contextmanager
def _noted_interrupts() -> Iterator[list[int]]:
    """Collect interrupts in the yielded list instead of raising them; a second interrupt is raised at once."""
    noted: list[int] = []
    if threading.current_thread() is not threading.main_thread():
        yield noted
        return

    def note(number: int, _: Any) -> None:
        noted.append(number)
        signal.signal(signal.SIGINT, previous)

    previous = signal.signal(signal.SIGINT, note)
    try:
        yield noted
    finally:
        signal.signal(signal.SIGINT, previous)
