"""A disk that is full, read-only or gone, and a standard output that takes nothing: one line, and the run can go on."""

import errno
import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from aircl_jax import storage
from experiments.run import main
from tests.tiny_runs import CHUNK, WORDS

pytestmark = pytest.mark.usefixtures("no_figures")

ROOT = Path(__file__).parents[2]


@pytest.fixture(scope="module")
def whole(tmp_path_factory) -> Path:
    path = tmp_path_factory.mktemp("runs") / "whole"
    assert main([*WORDS, f"run_dir={path}"]) == 0
    return path


def ends_equal(run: Path, whole: Path) -> bool:
    """Whether the same command with resume=true ends as if nothing had happened."""
    assert main([*WORDS, f"run_dir={run}", "resume=true"]) == 0
    return (run / "metrics.jsonl").read_bytes() == (whole / "metrics.jsonl").read_bytes()


def one_line(text: str) -> str:
    assert text.startswith("error: ") and text.count("\n") == 1, text
    return text


@pytest.mark.parametrize(
    ("call", "code"),
    [
        (12, errno.EROFS),
        *(pytest.param(call, errno.ENOSPC, marks=pytest.mark.slow) for call in (1, 3, 5, 8, 20, 30, 40)),
    ],
)
def test_a_disk_that_refuses_is_one_line_and_74_and_the_run_goes_on(call, code, whole, tmp_path, monkeypatch, capsys):
    calls = []

    def refusing(handle, fsync=os.fsync):
        calls.append(handle)
        if len(calls) >= call:
            raise OSError(code, os.strerror(code))
        fsync(handle)

    with monkeypatch.context() as patched:
        patched.setattr(storage.os, "fsync", refusing)
        assert main([*WORDS, f"run_dir={tmp_path / 'run'}"]) == 74
    said = one_line(capsys.readouterr().err)
    assert f"cannot be written: {os.strerror(code)}; once it can be, the same command with resume=true goes on" in said
    assert ends_equal(tmp_path / "run", whole)


class Vanishing:
    """Takes the run's directory away after its first chunk."""

    def __init__(self, run: Path) -> None:
        self.run = run

    def on_chunk(self, iteration, states, rows, timing):
        if iteration == CHUNK:
            self.run.rename(self.run.with_name("away"))

    def close(self):
        pass


def test_a_directory_that_vanishes_is_one_line_and_the_run_goes_on_when_it_is_back(whole, tmp_path, monkeypatch, capsys):
    run = tmp_path / "run"
    with monkeypatch.context() as patched:
        patched.setattr("experiments.run.Reporter", lambda headline: Vanishing(run))
        assert main([*WORDS, f"run_dir={run}"]) == 74
    assert f"{run}/metrics.jsonl cannot be written: No such file or directory; once" in one_line(capsys.readouterr().err)
    (tmp_path / "away").rename(run)
    assert ends_equal(run, whole)


@pytest.mark.parametrize(
    "stream", ["closed", *(pytest.param(one, marks=pytest.mark.slow) for one in ("full", "a pipe that nobody reads"))]
)
def test_a_standard_output_that_takes_nothing_does_not_end_a_run(stream, whole, tmp_path):
    words = " ".join(f"'{word}'" for word in [*WORDS, f"run_dir={tmp_path / 'run'}"])
    where = {"full": ">/dev/full", "closed": ">&-", "a pipe that nobody reads": "| true"}[stream]
    shell = f"set -o pipefail; {sys.executable} -m experiments.run {words} {where}"
    done = subprocess.run(["bash", "-c", shell], cwd=ROOT, capture_output=True, text=True, check=False)
    assert done.returncode == 0 and done.stderr == ""
    assert (tmp_path / "run" / "metrics.jsonl").read_bytes() == (whole / "metrics.jsonl").read_bytes()


@pytest.mark.slow
@pytest.mark.skipif(shutil.which("unshare") is None or os.geteuid() != 0, reason="only root mounts a small disk")
def test_a_real_small_disk_that_is_full(whole, tmp_path):
    small = tmp_path / "small"
    small.mkdir()
    words = " ".join(f"'{word}'" for word in [*WORDS, f"run_dir={small / 'run'}"])
    command = f"{sys.executable} -m experiments.run {words}"
    fill = f"mount -t tmpfs -o size=16M none {small}; head -c 100M /dev/zero > {small}/filler 2>/dev/null"
    go_on = f"{command}; echo $?; rm {small}/filler; {command} resume=true"
    kept = f"cp {small}/run/metrics.jsonl {tmp_path}/metrics.jsonl; umount {small}"
    script = f"{fill}; {go_on}; {kept}"
    done = subprocess.run(["unshare", "-m", "bash", "-c", script], cwd=ROOT, capture_output=True, text=True, check=False)
    assert "\n74\n" in f"\n{done.stdout}"
    assert one_line(done.stderr)
    assert (tmp_path / "metrics.jsonl").read_bytes() == (whole / "metrics.jsonl").read_bytes()
