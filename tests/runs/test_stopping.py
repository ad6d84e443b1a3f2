"""Signals: the chunk under way is finished and saved, then the run stops with the signal's own code."""

import os
import signal
import subprocess
import sys
import threading
import time
from pathlib import Path

import pytest

from aircl_jax.runs.stopping import Terminated, signals_noted, termination_raised
from experiments.run import main
from tests.tiny_runs import CHUNK, WORDS

CODES = [("SIGINT", 130), ("SIGTERM", 143), ("SIGHUP", 129)]


@pytest.fixture(autouse=True)
def _nothing_is_ignored():
    """Handle signals as at a terminal, though the tests themselves may run under `nohup` or in the background of a shell."""
    handlers = {signal.SIGHUP: signal.SIG_DFL, signal.SIGINT: signal.default_int_handler}
    before = {number: signal.signal(number, handler) for number, handler in handlers.items()}
    yield
    for number, handler in before.items():
        signal.signal(number, handler)


def send(name: str) -> None:
    os.kill(os.getpid(), getattr(signal, name))
    time.sleep(0.01)


@pytest.mark.parametrize(("name", "code"), CODES)
def test_a_signal_is_noted_and_raised_when_asked(name, code):
    before = signal.getsignal(getattr(signal, name))
    with signals_noted() as stop:
        stop()
        send(name)
        with pytest.raises((KeyboardInterrupt, Terminated)) as raised:
            stop()
    assert getattr(raised.value, "code", 130) == code
    assert signal.getsignal(getattr(signal, name)) == before


def test_a_second_signal_acts_at_once():
    with signals_noted():
        send("SIGINT")
        with pytest.raises(KeyboardInterrupt):
            send("SIGINT")


def test_an_ignored_signal_stays_ignored():
    before = signal.signal(signal.SIGTERM, signal.SIG_IGN)
    try:
        with termination_raised(), signals_noted() as stop:
            send("SIGTERM")
            stop()
    finally:
        signal.signal(signal.SIGTERM, before)


def test_a_handler_of_the_callers_own_stays():
    seen = []
    before = signal.signal(signal.SIGTERM, lambda number, _: seen.append(number))
    try:
        with termination_raised(), signals_noted() as stop:
            send("SIGTERM")
            stop()
    finally:
        signal.signal(signal.SIGTERM, before)
    assert seen == [signal.SIGTERM]


def test_outside_the_main_thread_nothing_is_noted_and_all_goes_on():
    done = []

    def in_a_thread():
        with termination_raised(), signals_noted() as stop:
            stop()
            done.append(True)

    thread = threading.Thread(target=in_a_thread)
    thread.start()
    thread.join()
    assert done == [True]


class Signalling:
    """Sends the signal at the end of the first chunk, which the run's directory has kept by then."""

    def __init__(self, name: str) -> None:
        self.name = name

    def on_chunk(self, iteration, states, rows, timing):
        if iteration == CHUNK:
            send(self.name)

    def on_start(self, *_):
        pass

    def close(self):
        pass


@pytest.mark.parametrize(
    ("name", "code"), [pytest.param(*one, marks=[pytest.mark.slow] * (one[0] != "SIGTERM")) for one in CODES]
)
def test_a_command_ends_with_the_signals_code_one_line_and_its_state_saved(name, code, tmp_path, monkeypatch, capsys):
    monkeypatch.setattr("experiments.run.Reporter", lambda headline: Signalling(name))
    assert main([*WORDS, f"run_dir={tmp_path}"]) == code
    how = "interrupted" if name == "SIGINT" else f"ended by {name}"
    assert capsys.readouterr().err == f"{how}; the same command with resume=true continues\n"
    assert [path.name for path in (tmp_path / "state").iterdir()] == [f"{CHUNK:08d}"]


@pytest.mark.slow
def test_sigterm_at_twenty_moments_saves_and_says_so(tmp_path):
    """From the first line that the command prints: before it there is nothing to save."""
    root, run = Path(__file__).parents[2], tmp_path / "run"
    command = [sys.executable, "-u", "-m", "experiments.run", *WORDS, f"run_dir={run}", "resume=true"]
    whole = subprocess.run(
        [*command[:-2], f"run_dir={tmp_path / 'whole'}"], cwd=root, check=True, capture_output=True, text=True
    )
    assert whole.returncode == 0
    codes, said = [], []
    for moment in range(20):
        process = subprocess.Popen(command, cwd=root, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
        assert process.stdout is not None
        process.stdout.readline()
        time.sleep(0.4 * moment)
        process.send_signal(signal.SIGTERM)
        said.append(process.communicate(timeout=120)[1])
        codes.append(process.returncode)
        if process.returncode in (0, -signal.SIGTERM):  # it was done before; what is left of the process has no handler
            assert (run / "report.html").exists() and not said.pop()
            codes.pop()
            subprocess.run(["rm", "-r", run], check=True)
        elif moment % 5 == 4:
            subprocess.run(["rm", "-rf", run], check=True)
    assert set(codes) == {143} and len(codes) >= 10
    assert set(said) == {"ended by SIGTERM; the same command with resume=true continues\n"}
    subprocess.run(command, cwd=root, check=True, capture_output=True)
    assert (run / "metrics.jsonl").read_bytes() == (tmp_path / "whole" / "metrics.jsonl").read_bytes()
