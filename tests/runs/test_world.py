"""Several processes of one run: the numbers of one process with as many devices, one directory, and every refusal in a line."""

import json
import os
import pickle
import signal
import socket
import subprocess
import sys
import time
from pathlib import Path

import jax
import numpy as np
import pytest

from aircl_jax.runs import world
from aircl_jax.runs.seeds import spread
from aircl_jax.runs.stopping import Terminated
from tests.tiny_runs import ITERATIONS, WORDS

ROOT = Path(__file__).parents[2]


def test_a_process_alone_calls_and_returns_what_it_is_given():
    tree = {"key": jax.random.key(1), "x": np.arange(3)}
    assert world.by_first(lambda: 3) == 3 and world.most(2) == 2 and world.is_first()
    assert world.gathered(tree) is tree and world.tree_of_first(lambda: tree, tree) is tree
    with pytest.raises(ValueError, match="refused"):
        world.in_first(refuse)


def refuse():
    raise ValueError("refused")


class NotSentError(Exception):
    def __init__(self, a, b):
        super().__init__(a)


@pytest.mark.parametrize("error", [ValueError("a"), KeyboardInterrupt(), Terminated(15)])
def test_an_error_is_the_same_in_another_process(error):
    there = pickle.loads(pickle.dumps(world._portable(error)))
    assert type(there) is type(error) and there.args == error.args


def test_an_error_that_cannot_be_sent_is_described():
    assert str(world._portable(NotSentError("what", "else"))) == "NotSentError: what"


@pytest.mark.parametrize(
    ("variables", "said"),
    [
        ({"SLURM_STEP_NUM_TASKS": "4"}, "this is one of 4 processes of Slurm (SLURM_STEP_NUM_TASKS), each of which trains all"),
        ({"OMPI_COMM_WORLD_SIZE": "2"}, "this is one of 2 processes of Open MPI"),
        ({"SLURM_STEP_NUM_TASKS": "1"}, ""),
        ({}, ""),
    ],
)
def test_processes_that_know_nothing_of_each_other_are_told(variables, said, monkeypatch):
    for name in world.STARTED_BY:
        monkeypatch.delenv(name, raising=False)
    for name, value in variables.items():
        monkeypatch.setenv(name, value)
    assert world.strangers().startswith(said) and bool(world.strangers()) == bool(said)


def test_a_world_that_cannot_be_joined_is_one_line():
    with pytest.raises(ValueError, match=r"^distributed=true: RuntimeError: .*; start the processes by srun or mpirun, or set"):
        world.join()


def test_seeds_that_processes_cannot_share_are_refused(monkeypatch):
    monkeypatch.setattr(jax, "process_count", lambda: 2)
    with pytest.raises(ValueError, match="seeds=3: 2 processes cannot share them evenly; choose a multiple of 2"):
        spread(3)


def start(words: list[str], **variables: str) -> subprocess.Popen:
    environment = os.environ | {"PYTHONPATH": str(ROOT), **variables}
    command = [sys.executable, "-m", "experiments.run", *words]
    return subprocess.Popen(command, cwd=ROOT, env=environment, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)


def free_port() -> int:
    with socket.socket() as found:
        found.bind(("127.0.0.1", 0))
        return found.getsockname()[1]


def two_processes(words: list[str], of_slurm: bool) -> list[subprocess.Popen]:
    """Two processes of one device each, in a world by Slurm's variables or by JAX's own."""
    port, started = str(free_port()), []
    for index in ("0", "1"):
        slurm = {"SLURM_JOB_ID": "1", "SLURM_STEP_NODELIST": "127.0.0.1", "SLURM_NTASKS": "2", "SLURM_PROCID": index}
        slurm |= {"SLURM_LOCALID": index, "SLURM_STEP_NUM_NODES": "1", "JAX_COORDINATOR_PORT": port}
        by_hand = {world.ADDRESS: f"127.0.0.1:{port}", world.NUMBER: "2", world.INDEX: index}
        variables = {"JAX_NUM_CPU_DEVICES": "1", **(slurm if of_slurm else by_hand)}
        started.append(start([*words, "distributed=true"], **variables))
    return started


@pytest.mark.slow
def test_two_processes_killed_and_resumed_write_what_one_with_two_devices_does(tmp_path):
    words = [*WORDS, f"run_dir={tmp_path / 'two'}"]
    started = two_processes(words, of_slurm=True)
    while not (tmp_path / "two" / "timing.jsonl").exists() and started[0].poll() is None:
        time.sleep(0.05)
    for process in started:
        process.send_signal(signal.SIGKILL)
        process.communicate()
    assert len((tmp_path / "two" / "metrics.jsonl").read_bytes().splitlines()) < ITERATIONS

    said = [process.communicate(timeout=1800) for process in two_processes([*words, "resume=true"], of_slurm=False)]
    one = start([*WORDS, f"run_dir={tmp_path / 'one'}"], JAX_NUM_CPU_DEVICES="2")
    assert one.communicate(timeout=1800)[1] == "" and one.returncode == 0
    assert "What it wants" in said[0][0] and "What it wants" not in said[1][0], said

    for name in ("metrics.jsonl", "config.yaml"):
        assert (tmp_path / "two" / name).read_bytes() == (tmp_path / "one" / name).read_bytes()
    summaries = [json.loads((tmp_path / name / "summary.json").read_text()) for name in ("two", "one")]
    assert summaries[0]["metrics"] == summaries[1]["metrics"]
    assert summaries[0]["versions"] == summaries[1]["versions"]
    assert sorted(path.name for path in (tmp_path / "two").iterdir()) == sorted(p.name for p in (tmp_path / "one").iterdir())

    refused = two_processes(words, of_slurm=False)
    for process in refused:
        assert "already holds a run; choose resume=true" in process.communicate(timeout=1800)[1]
        assert process.returncode == 2
