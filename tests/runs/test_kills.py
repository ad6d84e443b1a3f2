"""Bare commands killed with -9 from their start to their report: the same bytes as a run that nobody touched."""

import json
import random
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from aircl_jax.runs.directory import checkpoint_path
from aircl_jax.runs.readers import read_summary
from tests.tiny_runs import CHUNK, ITERATIONS, WORDS

ROOT = Path(__file__).parents[2]


def files_of(checkpoint: Path) -> dict[str, bytes]:
    """Numbers that a checkpoint holds, by name."""
    import orbax.checkpoint

    with orbax.checkpoint.StandardCheckpointer() as checkpointer:
        return {name: leaf.tobytes() for name, leaf in checkpointer.restore(checkpoint / "arrays").items()}


@pytest.mark.slow
@pytest.mark.parametrize("kills", [50])
def test_killed_at_any_moment_a_run_ends_with_the_same_bytes(kills, tmp_path):
    whole = tmp_path / "whole"
    command = [sys.executable, "-m", "experiments.run", *WORDS]
    started = time.monotonic()
    subprocess.run([*command, f"run_dir={whole}"], cwd=ROOT, check=True, capture_output=True)
    duration = time.monotonic() - started
    draw, done, run = random.Random(0), 0, tmp_path / "run0"
    for _ in range(kills):
        process = subprocess.Popen([*command, f"run_dir={run}", "resume=true"], cwd=ROOT, stdout=subprocess.DEVNULL)
        time.sleep(draw.uniform(0.0, 1.1 * duration))
        process.send_signal(signal.SIGKILL)
        if process.wait() == 0:
            same(run, whole)
            done += 1
            run = tmp_path / f"run{done}"
    subprocess.run([*command, f"run_dir={run}", "resume=true"], cwd=ROOT, check=True, capture_output=True)
    same(run, whole)


def same(run: Path, whole: Path) -> None:
    assert (run / "metrics.jsonl").read_bytes() == (whole / "metrics.jsonl").read_bytes()
    assert files_of(checkpoint_path(run, ITERATIONS)) == files_of(checkpoint_path(whole, ITERATIONS))
    found, right = read_summary(run), read_summary(whole)
    assert found is not None and right is not None and found["metrics"] == right["metrics"]
    chunks = [json.loads(line)["iteration"] for line in (run / "timing.jsonl").read_text().splitlines()]
    assert chunks == list(range(CHUNK, ITERATIONS + 1, CHUNK))
    assert sorted(path.name for path in run.iterdir()) == sorted(path.name for path in whole.iterdir())
