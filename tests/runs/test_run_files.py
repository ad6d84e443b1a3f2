"""Files of a run that were damaged: named in one line, mended where that is possible, and never taken for whole."""

import json
import random
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import TypeVar

import numpy as np
import pytest

from aircl_jax import load, train
from aircl_jax.runs.metrics_log import read_metrics
from aircl_jax.runs.opening import open_run, open_saved
from aircl_jax.runs.readers import read_config, read_timing
from aircl_jax.runs.spec import read_spec
from aircl_jax.settings.env_defaults import unnamed_settings
from envs.settings import flatten
from tests.tiny_runs import CHUNK
from tests.tiny_runs import FAST as SETTINGS

pytestmark = pytest.mark.usefixtures("no_figures")

T = TypeVar("T")


@pytest.fixture(scope="module")
def finished(tmp_path_factory) -> Path:
    path = tmp_path_factory.mktemp("runs") / "finished"
    train(**SETTINGS, iterations=2 * CHUNK, run_dir=path)
    return path


@pytest.fixture
def copied(finished, tmp_path) -> Path:
    return Path(shutil.copytree(finished, tmp_path / "copy"))


@pytest.mark.parametrize("text", ["", "{", "[]", '{"seeds": [0, 1]}', "\x00", '{"metrics": NaN}'])
def test_a_damaged_summary_is_made_again_and_said(text, copied, capsys):
    before = json.loads((copied / "summary.json").read_text())
    (copied / "summary.json").write_text(text)
    assert load(copied).summary["metrics"] == before["metrics"]
    assert (copied / "summary.json").read_text() == text  # reading writes nothing
    train(**SETTINGS, iterations=2 * CHUNK, run_dir=copied, resume=True)
    assert json.loads((copied / "summary.json").read_text()) == before
    said = f"warning: {copied}/summary.json is damaged; its numbers are measured again\n"
    assert capsys.readouterr().err == 2 * said


@pytest.mark.parametrize("line", ["{}", "[1]", '{"iteration": "six"}', '{"iteration": 6, "seconds": null}', "garbage", "\xff"])
def test_a_damaged_line_of_timing_is_named(line, copied):
    lines = (copied / "timing.jsonl").read_text().splitlines()
    (copied / "timing.jsonl").write_text("\n".join([lines[0], line]) + "\n")
    metrics = (copied / "metrics.jsonl").read_bytes()
    with pytest.raises(ValueError, match=rf"{copied}/timing.jsonl, line 2, is not what a run writes there"):
        train(**SETTINGS, iterations=3 * CHUNK, run_dir=copied, resume=True)
    assert (copied / "metrics.jsonl").read_bytes() == metrics


@pytest.mark.parametrize("line", ["[]", '{"a": 1}', '{"a": ["x"]}', '{"a": [1e999]}', '{"a": [true]}', "{", '{"a": [NaN]}'])
def test_a_damaged_line_of_metrics_is_named(line, tmp_path):
    (tmp_path / "metrics.jsonl").write_text(f'{{"a": [0.5]}}\n{line}\n')
    with pytest.raises(ValueError, match=rf"{tmp_path}/metrics.jsonl, line 2, is not what a run writes there"):
        read_metrics(tmp_path)


def test_rows_of_different_numbers_of_seeds_are_refused(tmp_path):
    (tmp_path / "metrics.jsonl").write_text('{"a": [0.5]}\n{"a": [0.5, 0.25]}\n')
    with pytest.raises(ValueError, match="has lines of different numbers of seeds"):
        read_metrics(tmp_path)


@pytest.mark.parametrize("text", ["", "- 1", "a: [", "1: 2", "!!python/object:os.system {}", "\x00"])
def test_damaged_settings_are_named(text, copied):
    (copied / "config.yaml").write_text(text)
    for read in (lambda: load(copied), lambda: train(**SETTINGS, iterations=2 * CHUNK, run_dir=copied, resume=True)):
        with pytest.raises(ValueError, match=rf"^{copied}/config.yaml (cannot be read|holds no settings); restore it, or"):
            read()


def completed(settings):
    """Settings by name, with the default of each that is not named, as older runs have it."""
    return {**unnamed_settings(settings["env"]["name"]), **flatten(settings)}


def garbled(data: bytes, draw: random.Random) -> bytes:
    """Cut, flipped, repeated, filled or mixed up, as disks and editors leave a file."""
    if not data:
        return draw.randbytes(9)
    at, length = draw.randrange(len(data)), draw.randrange(1, 40)
    lines = data.splitlines(keepends=True)
    chosen = draw.randrange(len(lines))
    return draw.choice(
        [
            data[:at],
            data[at:],
            data[:at] + bytes([data[at] ^ (1 << draw.randrange(8))]) + data[at + 1 :],
            data[:at] + draw.randbytes(length) + data[at:],
            data[:at] + data[at + length :],
            data[:at] + b"\x00" * length + data[at + length :],
            data.replace(b"0", b"null", draw.randrange(1, 9)),
            data.replace(b'"', b"'", draw.randrange(1, 9)),
            data.replace(b"[", b"{", 1),
            data.replace(b":", b"", 1),
            b"".join(lines[:chosen] + lines[chosen : chosen + 1] + lines[chosen:]),
            b"".join(lines[:chosen] + lines[chosen + 1 :]),
            "\ufeff".encode() + data,
            data.decode().encode("utf-16"),
        ]
    )


def outcome(read: Callable[[], T]) -> tuple[T | None, str]:
    """Return what is read and nothing, or nothing and why it is refused."""
    try:
        return read(), ""
    except ValueError as error:
        return None, str(error)


FILES = ("config.yaml", "metrics.jsonl", "timing.jsonl", "summary.json")


@pytest.mark.parametrize("count", [10, pytest.param(80, marks=pytest.mark.slow)])
@pytest.mark.parametrize("name", FILES)
def test_garbled_files_end_in_one_line_or_in_what_was_written(name, count, finished, tmp_path):
    """Everything that looks at a run reads it: what it accepts must be right, and what it refuses must be named."""
    draw, settings = random.Random(name), read_config(finished)
    right, rows = (finished / name).read_bytes(), (finished / "metrics.jsonl").read_bytes().splitlines()
    run = Path(shutil.copytree(finished, tmp_path / "copy"))
    for _ in range(count):
        (run / name).write_bytes(garbled(right, draw))
        resumed, refusal = outcome(lambda: open_run(run, settings, CHUNK, "resume"))
        if resumed is None:
            assert "\n" not in refusal and str(run) in refusal
        else:
            kept = (run / "metrics.jsonl").read_bytes().splitlines()[: resumed.start]
            assert kept == rows[: resumed.start] and resumed.start in (CHUNK, 2 * CHUNK)
            assert name != "config.yaml" or completed(read_config(run)) == completed(settings)
        for read in (lambda: read_spec(open_saved(run).settings), lambda: read_timing(run), lambda: read_metrics(run)):
            assert "\n" not in outcome(read)[1]


def test_a_run_reads_what_it_wrote(finished):
    assert np.array_equal(load(finished).history["return"], read_metrics(finished)["return"], equal_nan=True)
