"""One sitting of a run: chunks of iterations, and between them the host's work: measure, log, save, tell."""

import signal
import threading
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import jax
import numpy as np

from aircl_jax.runs.directory import RunDirectory
from aircl_jax.runs.seeds import Runner
from aircl_jax.types import TrainState, Trajectory

Row = Mapping[str, np.ndarray]  # one iteration's metrics, each [S]
Evaluate = Callable[[TrainState], Row]


class Progress(NamedTuple):
    """Where a run stands; speed and time left are unknown (None) until a chunk has run without compiling."""

    iteration: int
    iterations: int
    env_steps_per_s: float | None
    seconds_left: float | None
    metrics: Mapping[str, float]  # means over seeds


@dataclass
class Session:
    """What a sitting has done: the iteration reached, its metrics, one line of timing a chunk."""

    iteration: int
    rows: list[Row] = field(default_factory=list)
    timing: list[dict[str, Any]] = field(default_factory=list)
    evaluation: Row = field(default_factory=dict)


class Stopwatch:
    """Wall time, and the part of it that went into lowering and compiling, since the start or the last lap."""

    compiling: float = 0.0  # of this process; what jax reports is not tied to a stopwatch
    listening: bool = False

    def __init__(self) -> None:
        if not Stopwatch.listening:
            Stopwatch.listening = True
            jax.monitoring.register_event_duration_secs_listener(_note_compilation)
        self.now, self.compiled = time.perf_counter(), Stopwatch.compiling

    def lap(self) -> dict[str, float]:
        """The seconds since the last lap, and the compile seconds among them."""
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
    directory: RunDirectory | None,
    stopwatch: Stopwatch,
    on_progress: Callable[[Progress], None],
) -> tuple[TrainState, Session]:
    """Train from `start` to `iterations`; `env_steps` are those of one iteration of all seeds.

    The first chunk's time is that since `stopwatch` was started.

    Chunks end at multiples of `chunk` wherever the run starts or ends, so a resumed run compiles and computes the same.
    An interrupt waits for the chunk's end and its checkpoint; then KeyboardInterrupt is raised.
    """
    session = Session(start)
    on_progress(Progress(start, iterations, None, None, {}))
    with _noted_interrupts() as interrupts:
        while session.iteration < iterations:
            end = min(session.iteration - session.iteration % chunk + chunk, iterations)
            length = end - session.iteration
            states, metrics = runner.run_chunk(states, expert, length)
            metrics = jax.device_get(metrics)
            rows: list[Row] = [{name: values[i] for name, values in metrics.items()} for i in range(length)]
            session.evaluation = evaluate(states)
            if end % chunk == 0:
                rows[-1] = {**rows[-1], **session.evaluation}
            if directory:
                directory.append_metrics(rows)
                directory.save(states, end, chunk)
            timing = {
                "iteration": end,
                "env_steps": length * env_steps,
                "first": not session.timing,
                **stopwatch.lap(),
            }
            if directory:
                directory.append_timing(timing)
            session.iteration = end
            session.rows += rows
            session.timing.append(timing)
            on_progress(_progress(session, iterations))
            if interrupts:
                raise KeyboardInterrupt
    session.evaluation = session.evaluation or evaluate(states)
    return states, session


def _progress(session: Session, iterations: int) -> Progress:
    steady = [line for line in session.timing if not line["first"]]
    seconds, steps = sum(line["seconds"] - line["compile_s"] for line in steady), sum(line["env_steps"] for line in steady)
    done = session.iteration - session.timing[0]["iteration"]
    left = (iterations - session.iteration) * seconds / done if done else None
    last = {**session.rows[-1], **session.evaluation}
    return Progress(
        iteration=session.iteration,
        iterations=iterations,
        env_steps_per_s=steps / seconds if seconds else None,
        seconds_left=left,
        metrics={name: float(np.mean(values)) for name, values in last.items()},
    )


@contextmanager
def _noted_interrupts() -> Iterator[list[int]]:
    """The interrupts that arrive meanwhile, noted instead of raised; a second one is raised at once."""
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
