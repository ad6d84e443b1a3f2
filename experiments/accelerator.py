"""Train on whatever accelerator is here and check its numbers against the CPU's: `python -m experiments.accelerator`.

Settings, as NAME=VALUE (bad input prints one line on standard error and exits with 2):

cases  all, or some of gridworld, swimmer, swimmer_mjx, walker and walker_mjx, with commas between
seeds  numbers of seeds with commas between; the first is trained on the CPU too
scale  full, or smoke: seconds each, which tests the machinery
alone  one case in this process, with one number of seeds; its numbers are printed as JSON
"""

import json
import os
import subprocess
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np

from aircl_jax.messages import say, tell
from aircl_jax.reports import markdown
from experiments.cli.command import DEFECT, DONE, run_command
from experiments.cli.words import listed, smoke_budget
from experiments.shared.memory import most_memory

CASES: dict[str, tuple[str, dict[str, str]]] = {
    "gridworld": ("gridworld", {}),
    "swimmer": ("swimmer", {"engine": "planar"}),
    "swimmer_mjx": ("swimmer", {"engine": "mjx"}),
    "walker": ("walker", {"engine": "planar"}),
    "walker_mjx": ("walker", {"engine": "mjx"}),
}
CHUNK, ITERATIONS = 2, 6  # the first chunk compiles and is not timed
ABSOLUTE, RELATIVE = 0.01, 0.02  # tolerance of the mean over seeds of every metric of the first iteration
HEAD = ("case", "seeds", "on", "env steps/s", "memory, GB", "compile, s", "greatest difference, in tolerances", "from")

Numbers = Mapping[str, Any]  # "devices", "env_steps_per_s", "memory", "compile_s", and "first" {metric: [S]}


@dataclass(frozen=True)
class Settings:
    cases: str = "all"
    seeds: str = "10,1000"
    scale: Literal["full", "smoke"] = "full"
    alone: str = ""


def main(argv: Sequence[str] | None = None) -> int:
    return run_command(check, argv, Settings(), __doc__)


def check(settings: Settings, _: Sequence[str]) -> int:
    """Print a row a case and number of seeds, then the faster engine; return DEFECT where a number is off or a run fails."""
    sizes = _sizes(settings.seeds)
    if settings.alone:
        say(json.dumps(measured(listed("case", settings.alone, tuple(CASES))[0], sizes[0], settings.scale)))
        return DONE
    cases = listed("case", settings.cases, tuple(CASES))
    say(markdown.table(HEAD, []))
    found: dict[tuple[str, int], Numbers] = {}
    good = True
    for case in cases:
        right, whose = in_a_process(case, sizes[0], settings.scale, {"JAX_PLATFORMS": "cpu"}), "the CPU"
        for size in sizes:
            here = in_a_process(case, size, settings.scale, {})
            if right is None or here is None:
                good = False
                continue
            found[case, size] = here
            off, metric = difference(here["first"], right["first"])
            good &= off <= 1
            speed, memory = f"{here['env_steps_per_s'] or 0:,.0f}", f"{here['memory'] / 1e9:.2f}"
            say(
                markdown.row(
                    (case, size, here["devices"], speed, memory, f"{here['compile_s']:.0f}", f"{off:.2g} ({metric})", whose)
                )
            )
            right, whose = here, f"the same with {size} seeds"
    for line in faster(found):
        say(line)
    return DONE if good else DEFECT


def in_a_process(case: str, seeds: int, scale: str, variables: Mapping[str, str]) -> Numbers | None:
    """Measure a case in a process of its own, whose memory is its own; print why where it fails."""
    command = [sys.executable, "-m", "experiments.accelerator", f"alone={case}", f"seeds={seeds}", f"scale={scale}"]
    done = subprocess.run(command, env={**os.environ, **variables}, capture_output=True, text=True, check=False)
    if done.returncode == DONE:
        return json.loads(done.stdout.splitlines()[-1])
    tell(
        f"error: {case} with {seeds} seeds ended with {done.returncode}: {(done.stderr.splitlines() or ['without a word'])[-1]}"
    )
    return None


def measured(case: str, seeds: int, scale: str) -> Numbers:
    """Train a case in this process for a few iterations of its default method."""
    from aircl_jax import train

    name, env_settings = CASES[case]
    config = {**(smoke_budget()["train"] if scale == "smoke" else {}), "checkpoint_every": CHUNK}
    result = train(env=name, seeds=seeds, iterations=ITERATIONS, env_settings=env_settings, config=config)
    return {
        "devices": result.summary["versions"]["devices"],
        "env_steps_per_s": result.summary["env_steps_per_s"],
        "memory": memory(),
        "compile_s": result.summary["compile_s"],
        "first": {metric: values[0].tolist() for metric, values in result.history.items() if np.isfinite(values[0]).all()},
    }


def memory() -> int:
    """Return the greatest memory so far in bytes: of the first device, or of this process where that is a CPU; 0: unknown."""
    import jax

    if stats := jax.local_devices()[0].memory_stats():
        return stats["peak_bytes_in_use"]
    return most_memory()


def difference(here: Mapping[str, Sequence[float]], right: Mapping[str, Sequence[float]]) -> tuple[float, str]:
    """Return the greatest difference of the mean over the seeds that both have, in tolerances, and its metric."""
    off = {}
    for metric in here.keys() & right.keys():
        shared = min(len(here[metric]), len(right[metric]))
        ours, theirs = np.mean(here[metric][:shared]), np.mean(right[metric][:shared])
        off[metric] = float(abs(ours - theirs) / (ABSOLUTE + RELATIVE * abs(theirs)))
    worst = max(sorted(off), key=off.__getitem__)
    return off[worst], worst


def faster(found: Mapping[tuple[str, int], Numbers]) -> list[str]:
    """Say of each body and number of seeds which engine is faster."""
    lines = []
    for (case, size), numbers in found.items():
        mjx = found.get((f"{case}_mjx", size))
        if mjx and mjx["env_steps_per_s"] and numbers["env_steps_per_s"]:
            ratio = numbers["env_steps_per_s"] / mjx["env_steps_per_s"]
            which = "planar" if ratio >= 1 else "MJX"
            lines.append(f"{case}, {size} seeds: {which} is faster, {max(ratio, 1 / ratio):.1f} times")
    return lines


def _sizes(words: str) -> list[int]:
    sizes = words.split(",")
    if not all(size.isascii() and size.isdigit() and int(size) for size in sizes):
        raise ValueError(f"seeds={words} is no list of numbers above 0; choose some as in 10,1000")
    return sorted(map(int, sizes))


if __name__ == "__main__":
    sys.exit(main())
