"""Runs that are really killed, at several moments, and continued: the same bytes as the run that nobody touched."""

import json
import os
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import jax
import numpy as np
import pytest

from aircl_jax import train
from aircl_jax.runs.directory import METRICS, STATE, SUMMARY, TIMING
from tests.tiny_runs import CHUNK, FAST, ITERATIONS
from tests.tiny_runs import WHOLE as SETTINGS

pytestmark = pytest.mark.usefixtures("no_figures")

# A process that trains and kills itself at a moment of its own: nothing is flushed, nothing is cleaned up.
SCRIPT = """
import json, os, signal, sys
from aircl_jax import runtime
runtime.prepare(devices=2)
from aircl_jax import train
from aircl_jax.runs import checkpoint, directory as runs

moment, settings = sys.argv[1], json.loads(sys.argv[2])

def die(*_):
    os.kill(os.getpid(), signal.SIGKILL)

append_metrics, appended = runs.RunDirectory.append_metrics, []

def half_a_line(self, rows):
    if not appended:
        appended.append(True)
        return append_metrics(self, rows)
    with (self.path / runs.METRICS).open("a", encoding="utf-8") as file:
        file.write('{"half": [1.')
    die()

class Dying:
    on_start, on_chunk = (die, None) if moment == "compiling" else (lambda *_: None, die)

if moment in ("compiling", "between_chunks"):
    settings["recorders"] = [Dying()]
elif moment == "while_logging":
    runs.RunDirectory.append_metrics = half_a_line
elif moment == "before_the_rename":
    checkpoint._crc32 = die
elif moment == "before_the_timing":
    runs.RunDirectory.append_timing = die
elif moment == "before_the_older_goes":
    runs.checkpoints = die
train(**settings)
"""
MOMENTS = ("compiling", "while_logging", "between_chunks", "before_the_timing", "before_the_rename", "before_the_older_goes")


@pytest.fixture(scope="module")
def uninterrupted(tmp_path_factory) -> Path:
    path = tmp_path_factory.mktemp("runs") / "uninterrupted"
    train(**SETTINGS, iterations=ITERATIONS, run_dir=path)
    return path


@pytest.mark.parametrize("moments", [("while_logging",), pytest.param(MOMENTS, marks=pytest.mark.slow)], ids=["one", "six"])
def test_a_run_killed_at_several_moments_ends_with_the_same_bytes(uninterrupted, tmp_path, moments):
    settings = {**SETTINGS, "iterations": ITERATIONS, "run_dir": str(tmp_path / "run"), "resume": True}
    for moment in moments:
        killed = subprocess.run([sys.executable, "-c", SCRIPT, moment, json.dumps(settings)], check=False)
        assert killed.returncode == -signal.SIGKILL, moment
        assert not (tmp_path / "run" / SUMMARY).exists()

    result = train(**settings)

    assert (tmp_path / "run" / METRICS).read_bytes() == (uninterrupted / METRICS).read_bytes()
    assert result.summary["metrics"] == json.loads((uninterrupted / SUMMARY).read_text())["metrics"]
    chunks = [json.loads(line)["iteration"] for line in (tmp_path / "run" / TIMING).read_text().splitlines()]
    assert chunks == [2, 4, 6, 8, 10]  # none lost, none twice


@pytest.mark.parametrize("settings", [FAST, pytest.param(SETTINGS, marks=pytest.mark.slow)], ids=["fast", "whole"])
def test_a_longer_run_has_the_bytes_of_one_that_was_meant_to_be_longer(settings, tmp_path):
    train(**settings, iterations=2 * CHUNK, run_dir=tmp_path / "whole")
    train(**settings, iterations=CHUNK + 1, run_dir=tmp_path / "run")
    train(**settings, iterations=2 * CHUNK, run_dir=tmp_path / "run", resume=True)
    assert (tmp_path / "run" / METRICS).read_bytes() == (tmp_path / "whole" / METRICS).read_bytes()


def test_an_interrupt_waits_for_the_chunk_and_saves_it(tmp_path):
    class Interrupting:
        def on_chunk(self, iteration, states, rows, timing):
            if iteration == CHUNK:
                os.kill(os.getpid(), signal.SIGINT)
                time.sleep(0.01)

    with pytest.raises(KeyboardInterrupt):
        train(**FAST, iterations=ITERATIONS, run_dir=tmp_path, recorders=[Interrupting()])
    assert [path.name for path in (tmp_path / STATE).iterdir()] == [f"{CHUNK:08d}"]


@pytest.fixture
def finished(uninterrupted, tmp_path) -> Path:
    return Path(shutil.copytree(uninterrupted, tmp_path / "copy"))


def test_a_finished_run_is_read_and_not_touched(finished):
    before = {path: path.stat().st_mtime_ns for path in finished.rglob("*")}
    result = train(**SETTINGS, iterations=ITERATIONS, run_dir=finished, resume=True)
    assert {path: path.stat().st_mtime_ns for path in finished.rglob("*")} == before
    assert result.summary["iterations"] == ITERATIONS
    assert np.array_equal(result.states.step, [ITERATIONS, ITERATIONS])


def test_a_changed_setting_is_refused_with_the_difference(finished):
    changed: dict[str, Any] = {**SETTINGS, "method": "airl"}
    with pytest.raises(ValueError, match=r"method is aircl_corrected there and airl here"):
        train(**changed, iterations=ITERATIONS, run_dir=finished, resume=True)


def test_a_shorter_run_is_refused(finished):
    with pytest.raises(ValueError, match=r"at iteration 10 already; iterations=2 would shorten it"):
        train(**SETTINGS, iterations=CHUNK, run_dir=finished, resume=True)


@pytest.mark.slow
@pytest.mark.parametrize("method", ["aircl_contrast", "airl_tuned", "icrl_tuned"])
def test_a_robots_row_that_practises_goes_on_bit_for_bit(tmp_path, method):
    settings: dict[str, Any] = {
        "env": "swimmer",
        "method": method,
        "seeds": 2,
        "config": {"checkpoint_every": 2, "num_trajectories": 4, "feasibility_delay": 1, "num_evaluation": 2},
    }
    whole = train(**settings, iterations=4, run_dir=tmp_path / "whole")
    train(**settings, iterations=2, run_dir=tmp_path / "cut")
    resumed = train(**settings, iterations=4, run_dir=tmp_path / "cut", resume=True)
    assert (tmp_path / "cut" / METRICS).read_bytes() == (tmp_path / "whole" / METRICS).read_bytes()
    for one, two in zip(*(jax.tree.leaves(run.states.params) for run in (whole, resumed)), strict=True):
        np.testing.assert_array_equal(one, two)
