"""Sweeps: a job that fails is named, whatever process it runs in, and an interrupted sweep goes on."""

import gc
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from experiments.cli import jobs
from experiments.run import main
from tests.tiny_runs import CHUNK, WORDS

ROOT = Path(__file__).parents[2]
LAUNCHERS = {
    "joblib": ("hydra_plugins.hydra_joblib_launcher", ["hydra/launcher=joblib", "hydra.launcher.n_jobs=2"]),
    "submitit_local": ("hydra_plugins.hydra_submitit_launcher", ["hydra/launcher=submitit_local"]),
}


JOBS = 20


@pytest.fixture(autouse=True)
def elsewhere(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)


def test_a_job_that_fails_is_named_and_costs_no_other_job(capsys):
    assert main(["-m", *WORDS, "train.hidden=[0],[]", "run_dir=${train.hidden}"]) == 2
    said = capsys.readouterr().err.splitlines()
    named = [line for line in said if line.startswith("error: job ")]
    assert len(said) == 4 and len(named) == 2
    for number, (line, hidden) in enumerate(zip(named, ("[0]", "[]"), strict=True)):
        assert line.startswith(f"error: job {number} (env=gridworld ") and line.endswith(") ended with exit code 2")
        assert f"train.hidden={hidden} " in line
    assert list(Path().iterdir()) == []


def test_notes_of_an_earlier_sweep_are_forgotten_and_a_job_without_an_end_is_a_failure(tmp_path):
    jobs.note(tmp_path, jobs.Job(7, ("a=1",), 0))
    jobs.note(tmp_path, jobs.Job(8, ("a=2",), None))
    assert jobs.failures(list(jobs.notes(tmp_path))) == ["job 8 (a=2) did not come to its end"]
    jobs.forget(tmp_path)
    assert list(jobs.notes(tmp_path)) == []


def sweep(launcher: str, run_dir: str, *words: str, heard: int = subprocess.PIPE) -> subprocess.Popen:
    command = [sys.executable, "-m", "experiments.run", "-m", *WORDS, f"iterations={CHUNK}", *LAUNCHERS[launcher][1]]
    command += ["hydra.sweep.dir=jobs", f"run_dir={run_dir}", *words]
    environment = os.environ | {"PYTHONPATH": str(ROOT)}
    return subprocess.Popen(command, env=environment, stdout=heard, stderr=heard, text=True, start_new_session=True)


@pytest.mark.slow
@pytest.mark.parametrize("launcher", LAUNCHERS)
def test_a_failed_job_of_a_launcher_is_named_and_a_killed_sweep_goes_on(launcher):
    pytest.importorskip(LAUNCHERS[launcher][0])
    words = ("run_${first_seed}", f"first_seed={','.join(map(str, range(JOBS)))}")
    killed = sweep(launcher, *words, heard=subprocess.DEVNULL)  # a pipe that nobody reads would be full before half is done
    while len(list(Path().glob("*/report.md"))) < JOBS // 2 and killed.poll() is None:
        time.sleep(0.05)
    os.killpg(killed.pid, signal.SIGKILL)
    killed.wait()
    time.sleep(5)  # until workers in sessions of their own have seen that nobody waits for them
    done = set(Path().glob("*/report.md"))
    assert JOBS // 2 <= len(done) < JOBS

    resumed = sweep(launcher, *words, "resume=true")
    said = resumed.communicate(timeout=3600)
    assert resumed.returncode == 0, said
    assert {path.parent.name for path in Path().glob("*/report.md")} == {f"run_{seed}" for seed in range(JOBS)}
    seed = next(seed for seed in range(JOBS) if Path(f"run_{seed}/report.md") not in done)
    alone = [*WORDS, f"iterations={CHUNK}", f"first_seed={seed}", "run_dir=alone"]
    subprocess.run([sys.executable, "-m", "experiments.run", *alone], env=os.environ | {"PYTHONPATH": str(ROOT)}, check=True)
    assert Path(f"run_{seed}/metrics.jsonl").read_bytes() == Path("alone/metrics.jsonl").read_bytes()

    failing = sweep(launcher, "hidden_${train.hidden}", "train.hidden=[0],[]")
    err = failing.communicate(timeout=3600)[1]
    assert failing.returncode == 2
    assert [
        f"train.hidden={hidden}" in err and f"error: job {number} " in err for number, hidden in enumerate(("[0]", "[]"))
    ] == [True, True]


@pytest.mark.slow
@pytest.mark.usefixtures("no_figures")
@pytest.mark.skipif(not Path("/proc/self/maps").exists(), reason="another system than Linux")
def test_a_process_of_a_hundred_jobs_keeps_its_memory_and_maps():
    measured = []
    for ten in range(10):
        seeds = ",".join(str(seed) for seed in range(10 * ten, 10 * ten + 10))
        assert main(["-m", *WORDS, f"iterations={CHUNK}", f"first_seed={seeds}", "run_dir=run_${first_seed}"]) == 0
        gc.collect()
        pages = int(Path("/proc/self/statm").read_text().split()[1])
        measured.append((pages * os.sysconf("SC_PAGE_SIZE") / 1e6, len(Path("/proc/self/maps").read_bytes().splitlines())))
    most = int(Path("/proc/sys/vm/max_map_count").read_bytes())
    memory, maps = zip(*measured, strict=True)
    assert max(maps) < 0.35 * most, measured
    assert max(memory[5:]) < 1.2 * max(memory[:5]), measured
