"""Loggers hand every iteration on, end no run, and a missing package is one line that names the extra."""

import importlib
import struct
import sys
from pathlib import Path
from types import SimpleNamespace
from typing import Any
from unittest.mock import MagicMock

import numpy as np
import pytest

from aircl_jax.recorders.logger import Logger, Run, summed_up
from aircl_jax.recorders.table import LOGGERS, make_loggers

ROWS = [{"return": np.array([1.0, 3.0]), "goal_rate": np.array([np.nan, np.nan])}, {"return": np.array([np.nan, 5.0])}]
TIMING = {"iteration": 7, "seconds": 2.0, "env_steps": 100, "compile_s": 0.5, "first": True}


class Written(Logger):
    """What a logger was told."""

    word = "written"

    def __init__(self, run: Run, broken: bool = False) -> None:
        super().__init__(run)
        self.broken, self.told = broken, []

    def begin(self) -> None:
        self.told.append("begun")

    def write(self, step, values) -> None:
        if self.broken:
            raise ConnectionError("no such host\nand more")
        self.told.append((step, dict(values)))

    def end(self) -> None:
        self.told.append("ended")


def test_iterations_count_to_the_end_of_the_chunk_and_its_timing_is_with_the_last():
    log = Written(Run("grid/bc", Path("nowhere")))
    log.close()
    assert log.told == []  # a run that never began leaves nothing
    log.on_chunk(7, None, ROWS, TIMING)
    log.close()
    assert log.told == [
        "begun",
        (6, {"return": 2.0, "return/std": pytest.approx(2**0.5)}),
        (7, {"return": 5.0, "time/seconds": 2.0, "time/env_steps": 100.0}),
        "ended",
    ]


def test_means_are_of_the_seeds_where_a_metric_is_finite():
    assert summed_up({"a": np.array([2.0, np.inf, 4.0]), "b": np.array([np.nan])}) == {"a": 3.0, "a/std": pytest.approx(2**0.5)}


def test_a_fault_of_a_logger_is_one_line_and_ends_no_run(capsys):
    log = Written(Run("grid/bc", Path("nowhere")), broken=True)
    for _ in range(2):
        log.on_chunk(7, None, ROWS, TIMING)
    log.close()
    said = capsys.readouterr().err
    assert said == "warning: log=written: no such host; nothing more is logged there, the run goes on\n"


@pytest.mark.parametrize("word", LOGGERS)
def test_a_missing_package_is_one_line_that_says_what_to_install(word, monkeypatch):
    monkeypatch.setitem(sys.modules, "tensorboardX" if word == "tensorboard" else word, None)
    extra = "trackio" if word == "trackio" else r"aircl-jax\[log\]"
    with pytest.raises(ValueError, match=rf"^log={word} needs the package \w+, which is not installed; install {extra}$"):
        make_loggers(word, Run("grid/bc", Path("nowhere")))


def test_loggers_are_a_comma_list_without_repeats_and_unknown_ones_are_refused(monkeypatch):
    for package in ("tensorboardX", "wandb"):
        monkeypatch.setitem(sys.modules, package, MagicMock())
    run = Run("grid/bc", Path("nowhere"))
    assert [log.word for log in make_loggers("tensorboard, wandb,tensorboard", run)] == ["tensorboard", "wandb"]
    assert make_loggers("none", run) == []
    with pytest.raises(ValueError, match="unknown log 'csv'; choose from tensorboard, wandb, trackio, mlflow, or none"):
        make_loggers("csv", run)


def of(word: str, package: Any, folder: Path, monkeypatch) -> Logger:
    monkeypatch.setitem(sys.modules, word, package)
    [log] = make_loggers(word, Run("grid/bc", folder, {"env.slip": 0.1}))
    return log


@pytest.mark.parametrize("word", ["wandb", "trackio"])
def test_weights_and_biases_and_trackio_get_settings_steps_and_an_end(word, tmp_path, monkeypatch):
    monkeypatch.delenv("WANDB_MODE", raising=False)
    fake = MagicMock()
    log = of(word, fake, tmp_path, monkeypatch)
    log.on_chunk(7, None, ROWS, TIMING)
    log.close()
    given = fake.init.call_args.kwargs
    assert (given["project"], given["name"], given["config"]) == ("aircl-jax", "grid/bc", {"env.slip": 0.1})
    if word == "wandb":
        assert (given["mode"], given["dir"], given["resume"]) == ("offline", str(tmp_path), "allow")
        again = of(word, fake, tmp_path, monkeypatch)
        again.on_chunk(9, None, ROWS, TIMING)
        assert fake.init.call_args.kwargs["id"] == given["id"]  # a resumed run is the same run
    assert fake.log.call_args_list[1].kwargs == {"step": 7}
    assert fake.log.call_args_list[1].args[0]["return"] == 5.0
    fake.finish.assert_called_once()


def test_mlflow_writes_into_the_runs_folder_unless_a_server_is_named_and_names_as_it_takes_them(tmp_path, monkeypatch):
    monkeypatch.delenv("MLFLOW_TRACKING_URI", raising=False)
    fake = MagicMock()
    log = of("mlflow", fake, tmp_path, monkeypatch)
    log.on_chunk(7, None, [{"f(δ)/x": np.ones(1)}], TIMING)
    log.close()
    assert "f_δ_/x" in fake.log_metrics.call_args.args[0]
    fake.set_tracking_uri.assert_called_once_with(f"sqlite:///{(tmp_path / 'mlflow.db').as_posix()}")
    fake.log_params.assert_called_once_with({"env.slip": "0.1"})
    assert fake.log_metrics.call_args.kwargs == {"step": 7}
    fake.end_run.assert_called_once()
    monkeypatch.setenv("MLFLOW_TRACKING_URI", "http://localhost:1")
    other = MagicMock()
    of("mlflow", other, tmp_path, monkeypatch).on_chunk(7, None, ROWS, TIMING)
    other.set_tracking_uri.assert_not_called()


def test_tensorboard_reads_what_was_logged(tmp_path):
    tensorboardx = pytest.importorskip("tensorboardX", reason="tensorboardX is not installed")
    assert tensorboardx
    [log] = make_loggers("tensorboard", Run("grid/bc", tmp_path, {"env.slip": 0.1}))
    log.on_chunk(7, None, ROWS, TIMING)
    log.close()
    [file] = (tmp_path / "tensorboard").iterdir()
    found = {(value.tag, event.step): value.simple_value for event in events(file) for value in event.summary.value}
    assert found["return", 6] == 2.0 and found["return", 7] == 5.0
    assert found["time/env_steps", 7] == 100.0
    assert any(tag.startswith("settings") for tag, _ in found)


def events(file: Path) -> list[Any]:
    """The events of a file: length, checksum, event, checksum, one after the other."""
    kind: Any = importlib.import_module("tensorboardX.proto.event_pb2")
    content, place, found = file.read_bytes(), 0, []
    while place < len(content):
        [length] = struct.unpack("<Q", content[place : place + 8])
        found.append(kind.Event.FromString(content[place + 12 : place + 12 + length]))
        place += 16 + length
    return found


def test_the_command_hands_its_words_on_and_closes_the_loggers(monkeypatch, tmp_path):
    import aircl_jax
    from experiments import run

    told: dict[str, Any] = {}
    logger = SimpleNamespace(close=lambda: told.update(closed=True))
    monkeypatch.setattr(run, "make_loggers", lambda words, about: told.update(words=words, run=about) or [logger])

    def train(**given):
        told.update(given)
        raise ValueError("enough")

    monkeypatch.setattr(aircl_jax, "train", train, raising=False)
    assert run.main(["env=gridworld", "log=tensorboard,wandb", f"run_dir={tmp_path / 'new'}", "env.slip=0.3"]) == 2
    assert told["words"] == "tensorboard,wandb"
    assert (told["run"].name, told["run"].folder) == ("gridworld/aircl_contrast", tmp_path / "new")
    assert told["run"].settings["env.slip"] == 0.3
    assert told["recorders"][1] is logger and told["closed"] and "log" not in told
    assert not (tmp_path / "new").exists()
