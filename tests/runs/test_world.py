"""Several processes of one run: the numbers of one process with as many devices, one directory, and every refusal in a line."""

import json
import os
import pickle
import shutil
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import jax
import numpy as np
import pytest

from aircl_jax.runs import checkpoint, world
from aircl_jax.runs.metrics_log import read_metrics
from aircl_jax.runs.seeds import spread
from aircl_jax.runs.stopping import Terminated
from tests.tiny_runs import CHUNK, ITERATIONS, WORDS

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


def test_a_process_that_no_longer_answers_is_one_line(monkeypatch):
    monkeypatch.setattr(jax, "process_count", lambda: 2)

    def lost(_):
        raise ValueError("UNKNOWN: Gloo AllGather failed:\nConnection closed by peer")

    monkeypatch.setattr(world.multihost_utils, "process_allgather", lost)
    with pytest.raises(ConnectionError, match=r"another process .* \(ValueError: UNKNOWN: Gloo .*\); .* resume=true goes on$"):
        world.most(1)


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


# What the processes of a world tell each other, without a training.
SCRIPT = """
import os, signal
from aircl_jax import runtime
runtime.prepare(devices=1)
from aircl_jax.runs import world
world.join()
import jax, numpy as np
from aircl_jax.runs.seeds import seed_keys, spread
from aircl_jax.runs.stopping import signals_noted
from experiments.cli.command import ending

place = spread(2)[1]
mine = {"keys": seed_keys([0, 1]), "x": np.arange(4.0)}
back = world.gathered(place(mine))
assert (jax.random.key_data(back["keys"]) == jax.random.key_data(mine["keys"])).all() and (back["x"] == mine["x"]).all()
first = jax.process_index() == 0
tree = world.tree_of_first(lambda: back, jax.eval_shape(lambda: back))
assert (jax.random.key_data(tree["keys"]) == jax.random.key_data(mine["keys"])).all()
assert world.by_first(lambda: {"pid": os.getpid()} if first else 1 / 0)["pid"] and world.most(3 if first else 7) == 7

def refuse():
    raise ValueError(f"refused by {os.getpid()}")

try:
    world.in_first(refuse)
except ValueError as error:
    print(error)

def task():
    with signals_noted() as stop:
        if not first:
            os.kill(os.getpid(), signal.SIGTERM)
        stop(world.most)

raise SystemExit(ending(task))
"""


def start(words: list[str], namespace: str = "", **variables: str) -> subprocess.Popen:
    return begun(["-m", "experiments.run", *words], namespace, **variables)


def begun(arguments: list[str], namespace: str = "", **variables: str) -> subprocess.Popen:
    environment = os.environ | {"PYTHONPATH": str(ROOT), **variables}
    command = [*(["ip", "netns", "exec", namespace] if namespace else []), sys.executable, *arguments]
    return subprocess.Popen(command, cwd=ROOT, env=environment, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)


def free_port() -> int:
    with socket.socket() as found:
        found.bind(("127.0.0.1", 0))
        return found.getsockname()[1]


@pytest.mark.slow
def test_processes_share_arrays_refusals_and_signals():
    port = free_port()
    variables = [{world.ADDRESS: f"127.0.0.1:{port}", world.NUMBER: "2", world.INDEX: index} for index in ("0", "1")]
    started = [begun(["-c", SCRIPT], JAX_NUM_CPU_DEVICES="1", **each) for each in variables]
    said = [process.communicate(timeout=600) for process in started]
    assert [process.returncode for process in started] == [143, 143], said
    assert all(f"refused by {started[0].pid}" in out and "ended by SIGTERM" in err for out, err in said), said


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


@pytest.fixture
def namespaces() -> Iterator[list[str]]:
    """Two network namespaces with a cable between them: what each calls 127.0.0.1 the other cannot reach."""
    ends = [f"{end}{os.getpid()}" for end in "ab"]
    commands = [f"netns add {end}" for end in ends]
    commands.append(f"link add {ends[0]} netns {ends[0]} type veth peer name {ends[1]} netns {ends[1]}")
    for number, end in enumerate(ends, 1):
        commands += [
            f"-n {end} addr add 10.99.0.{number}/24 dev {end}",
            f"-n {end} link set {end} up",
            f"-n {end} link set lo up",
        ]
    try:
        for words in commands:
            subprocess.run(["ip", *words.split()], check=True, capture_output=True)
    except (OSError, subprocess.CalledProcessError):
        pytest.skip("network namespaces cannot be made here")
    else:
        yield ends
    finally:
        for end in ends:
            subprocess.run(["ip", "netns", "delete", end], check=False, capture_output=True)


@pytest.mark.slow
@pytest.mark.skipif(shutil.which("ip") is None, reason="no ip")
def test_two_processes_in_two_network_namespaces_write_what_one_with_two_devices_does(tmp_path, namespaces):
    words = [*WORDS, f"run_dir={tmp_path / 'two'}", "distributed=true"]
    variables = {world.ADDRESS: "10.99.0.1:23456", world.NUMBER: "2", "JAX_NUM_CPU_DEVICES": "1"}
    started = [start(words, end, **variables, **{world.INDEX: str(index)}) for index, end in enumerate(namespaces)]
    said = [process.communicate(timeout=1800) for process in started]
    assert [process.returncode for process in started] == [0, 0], said
    one = start([*WORDS, f"run_dir={tmp_path / 'one'}"], JAX_NUM_CPU_DEVICES="2")
    assert one.communicate(timeout=1800)[1] == "" and one.returncode == 0
    assert (tmp_path / "two" / "metrics.jsonl").read_bytes() == (tmp_path / "one" / "metrics.jsonl").read_bytes()


@pytest.mark.slow
def test_one_two_four_and_eight_devices_train_the_same_and_a_resume_on_others_says_so(tmp_path):
    found = {}
    for number in (1, 2, 4, 8):
        words = [*WORDS, "seeds=8", f"iterations={CHUNK}", f"run_dir={tmp_path / str(number)}"]
        process = start(words, JAX_NUM_CPU_DEVICES=str(number))
        assert process.communicate(timeout=1800)[1] == "" and process.returncode == 0
        notes = checkpoint.notes_of(tmp_path / str(number) / "state" / f"{CHUNK:08d}")
        assert notes["devices"] == f"{number} × cpu"
        found[number] = read_metrics(tmp_path / str(number))
    for number in (2, 4, 8):
        for name, values in found[1].items():
            np.testing.assert_allclose(found[number][name], values, rtol=1e-4, atol=1e-4, err_msg=f"{number} {name}")

    longer = [*WORDS, "seeds=8", f"iterations={2 * CHUNK}", f"run_dir={tmp_path / '2'}", "resume=true"]
    said = start(longer, JAX_NUM_CPU_DEVICES="4").communicate(timeout=1800)[1]
    line = "was computed on 2 × cpu and goes on on 4 × cpu: its numbers may differ in their last digits"
    assert said == f"warning: run_dir={tmp_path / '2'} {line}\n"
