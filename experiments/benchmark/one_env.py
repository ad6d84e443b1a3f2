"""Report the speed of one environment: steps per second, start-up, memory, and the time of each part of an iteration."""

import json
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from statistics import median
from typing import Any

import jax

from aircl_jax.messages import say
from experiments.benchmark.parts import MJX, PHYSICS, ROLLOUT, WHOLE, Part, parts_of, world_and_row
from experiments.benchmark.products import arithmetic, bare_seconds
from experiments.benchmark.settings import Settings
from experiments.shared.memory import most_memory

REPEATS = 5  # repeats of each timing; the median is printed
AS_WHOLE = {MJX: "bare physics by engine mjx"}
CHUNKS = 2  # chunks of a timed run; the first one compiles and is left out


def report(settings: Settings) -> None:
    """Measure and print the report. Raises ValueError, before anything runs, for a row that it does not know."""
    world_and_row(settings)
    rows = measure(settings)
    say(f"{settings.world}, {settings.method}, {len(jax.devices())} devices on {os.cpu_count()} cores, jax {jax.__version__}")
    for name, value in rows.items():
        say(f"  {name:<58} {value}")


def measure(settings: Settings) -> dict[str, str]:
    """Measure each line of the report and return {line: value as text}."""
    rows = {}
    for seeds in dict.fromkeys((settings.seeds, 1)):
        steps, compiling = throughput(settings, seeds)
        rows[f"whole training, {seeds} seed(s), env steps/s"] = f"{steps:,.0f}"
        rows[f"  tracing and compiling, {seeds} seed(s), s"] = f"{compiling:.1f}"
    memory = peak_memory()
    rows |= parts(settings)
    rows["second start until the first iteration is on disk, s"] = f"{second_start(settings):.1f}"
    rows["peak memory of this process after both trainings, GiB"] = memory
    return rows


def peak_memory() -> str:
    """Return the most memory that this process held, in GiB; unknown on systems that do not say."""
    most = most_memory()
    return f"{most / 2**30:.2f}" if most else "unknown"


def throughput(settings: Settings, seeds: int) -> tuple[float, float]:
    """Run with checkpoints and metrics; return `env_steps_per_s` and `compile_s` of the summary."""
    from aircl_jax import train
    from aircl_jax.methods import get_method
    from aircl_jax.settings.env_defaults import default_config

    chunk = settings.chunk or default_config(settings.world, get_method(settings.method).settings).checkpoint_every
    with tempfile.TemporaryDirectory() as place:
        result = train(
            settings.world,
            settings.method,
            seeds=seeds,
            iterations=CHUNKS * chunk,
            run_dir=Path(place) / "run",
            env_settings=settings.env_settings,
            config=settings.training,
        )
    return result.summary["env_steps_per_s"], result.summary["compile_s"]


def parts(settings: Settings) -> dict[str, str]:
    """Time one iteration's parts, for one seed on one device, each compiled alone, and what their products need alone.

    The ratios divide the whole step's time by a part's.
    """
    made = parts_of(settings)
    seconds = {name: _timed(part.run, *part.inputs)[1] for name, part in made.items()}
    whole = seconds[WHOLE]
    rows = {f"{name}, ms": f"{1e3 * each:.1f}" for name, each in seconds.items()}
    compared = {name: seconds[name] * factor for name, factor in ((PHYSICS, 1), (ROLLOUT, 1), (MJX, 10)) if name in seconds}
    rows |= {f"whole step / {AS_WHOLE.get(name, name)}": f"{whole / each:.2f}" for name, each in compared.items()}
    inside = {name: part for name, part in made.items() if part.times}
    rows |= {f"limits of {name}": limit(part, seconds[name], whole) for name, part in inside.items()}
    between = whole - sum(seconds[name] * part.times for name, part in inside.items() if name != WHOLE)
    rows["all between the parts, ms"] = f"{1e3 * between:.1f}"
    return {f"one seed, one device: {name}": value for name, value in rows.items()}


def limit(part: Part, seconds: float, whole: float) -> str:
    """Say how much of the step a part takes, its arithmetic, and what share of its time its matrix products need alone."""
    work = arithmetic(part.run, *part.inputs)
    products = sum(product.operations * times for product, times in work.products.items())
    bare = bare_seconds(work.products, _timed)
    alone = (
        f"products alone {1e3 * bare:.1f} ms ({bare / seconds:.0%}), {products / bare / 1e9:.1f} GFLOP/s"
        if bare
        else "no products"
    )
    times = f"{part.times} × " if part.times > 1 else ""
    share = f"{times}{seconds / whole:.0%} of the step"
    return (
        f"{share}; {products / 1e9:.3f} + {work.others / 1e9:.3f} GFLOP, {work.operations / seconds / 1e9:.1f} GFLOP/s; {alone}"
    )


def _timed(function: Callable[..., Any], *inputs: Any) -> tuple[Any, float]:
    compiled = jax.jit(function)
    result = jax.block_until_ready(compiled(*inputs))
    seconds = []
    for _ in range(REPEATS):
        start = time.perf_counter()
        jax.block_until_ready(compiled(*inputs))
        seconds.append(time.perf_counter() - start)
    return result, median(seconds)


def second_start(settings: Settings) -> float:
    """Measure the seconds from the command to its first iteration's metrics on disk, with a warm compilation cache."""
    seconds = 0.0
    for _ in range(2):
        with tempfile.TemporaryDirectory() as place:
            metrics = Path(place) / "run" / "metrics.jsonl"
            words = [
                f"env={settings.world}",
                f"method={settings.method}",
                f"seeds={settings.seeds}",
                "iterations=1",
                "train.checkpoint_every=1",
            ]
            command = [sys.executable, "-m", "experiments.run", *words, f"run_dir={metrics.parent}"]
            start = time.perf_counter()
            with subprocess.Popen(command, stdout=subprocess.DEVNULL) as process:
                while process.poll() is None and not (metrics.exists() and _has_line(metrics)):
                    time.sleep(0.05)
                seconds = time.perf_counter() - start
                process.kill()
    return seconds


def _has_line(path: Path) -> bool:
    text = path.read_text(encoding="utf-8")
    return text.endswith("\n") and bool(json.loads(text.splitlines()[0]))
