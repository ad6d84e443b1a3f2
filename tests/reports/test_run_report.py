"""What a run prints of itself while it goes and when it is done: speed, time left, tables of measures, effort."""

from typing import Any

import numpy as np
import pytest

from aircl_jax.reports import run_report
from aircl_jax.reports.summary import summarise
from experiments.cli import progress
from experiments.cli.progress import Reporter
from tests.finished_runs import untrained

TIMING = [
    {"iteration": 1, "env_steps": 100, "first": True, "seconds": 9.0, "compile_s": 8.0},
    {"iteration": 2, "env_steps": 100, "first": False, "seconds": 2.0, "compile_s": 0.5},
    {"iteration": 3, "env_steps": 300, "first": False, "seconds": 3.0, "compile_s": 0.5},
]


def summary(timing: list[dict[str, Any]] = TIMING) -> dict[str, Any]:
    final = {"return": np.array([1.0, 3.0]), "violation_rate": np.array([0.5, np.nan]), "rc_acc": np.array([np.nan] * 2)}
    return summarise(untrained("airl").spec, final, timing)


def test_the_speed_is_that_of_the_chunks_after_the_first_without_compiling():
    found = summary()
    assert found["env_steps_per_s"] == 100.0  # 400 in 1.5 s and 2.5 s
    assert (found["wall_s"], found["compile_s"]) == (14.0, 9.0)
    assert summary(TIMING[:1])["env_steps_per_s"] is None


@pytest.mark.parametrize(("method", "pools"), [("airl", 1), ("aircl_corrected", 2)])
def test_the_steps_are_those_of_all_iterations_and_seeds(method, pools):
    found = summarise(untrained(method).spec, {"return": np.array([1.0, 3.0])}, TIMING)
    assert found["env_steps"] == 4 * 2 * 6 * pools * 5  # iterations, seeds, episodes, pools where q draws from them, steps


def test_the_table_has_mean_and_deviation_beside_what_a_measure_is():
    lines = run_report.table(summary()).splitlines()
    rows = {line.split("|")[1].strip(): [part.strip() for part in line.split("|")[2:4]] for line in lines}
    assert rows["return"] == ["2 ± 1.41", "true return of the policy"]
    assert rows["violation_rate"] == ["null", "share of timesteps that violate, samples of q (the paper's)"]
    assert "rc_acc" not in rows


def test_every_seed_has_its_column():
    head, _, *rows = [
        [part.strip() for part in line.strip("|").split("|")] for line in run_report.seed_table(summary()).splitlines()
    ]
    assert head == ["metric", "seed 0", "seed 1"]
    assert rows == [["violation_rate", "0.5", "null"], ["return", "1", "3"]]


def test_the_end_says_how_long_it_took_and_how_fast_it_was():
    text = run_report.closing(summary() | {"env_steps": 12_345, "env_steps_per_s": 6789.4}, ["it rang"], "runs/one")
    assert "4 iterations, 2 seeds, 12,345 env steps in 14 s, 9 s of it compiling; 6,789 env steps/s." in text
    assert "Alarms:\n- it rang" in text
    assert "Undefined here: rc_acc." in text


def lines_of(chunks: int, row: dict[str, np.ndarray]) -> Reporter:
    """A run of ten iterations a chunk, each chunk 500 steps in 11 s, one of which compiles."""
    reporter = Reporter("a run")
    reporter.on_start(0, 30)
    for chunk in range(1, chunks + 1):
        reporter.on_chunk(10 * chunk, None, [row], {"env_steps": 500, "seconds": 11.0, "compile_s": 1.0})
    return reporter


def test_a_line_of_progress_has_speed_time_left_and_the_first_three_measures(capsys, monkeypatch):
    monkeypatch.setattr(progress, "SECONDS_BETWEEN_LINES", 0.0)
    both = {"balanced_acc": [0.5, 1.0], "return": [12.0, 13.0], "goal_rate": [np.nan, 1.0], "violation_rate": [0.0, 0.0246]}
    lines_of(2, {name: np.array(seeds) for name, seeds in both.items()} | {"entropy": np.ones(2)})
    assert capsys.readouterr().out.splitlines()[-1] == (
        "iteration 20/30  50 env steps/s  0:10 left  violation_rate 0.0123  return 12.5  balanced_acc 0.75"
    )


def test_speed_and_time_left_are_not_said_before_a_chunk_has_run_without_compiling(capsys):
    lines_of(1, {"return": np.array([1.0])})
    assert capsys.readouterr().out.splitlines()[-1] == "iteration 10/30  return 1"
