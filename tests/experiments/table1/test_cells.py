"""Cells of Table 1: what they are made with, their curves, and what is read from them."""

from dataclasses import replace
from typing import Any
from unittest import mock

import numpy as np
import pytest

from aircl_jax.settings.train_config import TrainConfig
from experiments.shared.paper import PAPER
from experiments.table1 import cells, report
from experiments.table1.cells import COLUMNS, ROWS
from tests.finished_runs import FULL, finished_cell, study_of


def test_papers_table_is_read_by_column():
    assert PAPER["gridworld"]["airl"] == {"rc_acc": (0.625, 0.078), "violation_rate": (0.095, 0.026)}
    assert PAPER["pendulum"]["aircl"] == {"rc_acc": (0.851, 0.131), "violation_rate": (0.214, 0.244)}
    assert PAPER["walker"]["icrl_prior"] == {"violation_rate": (0.940, 0.003)}
    assert [len(rows) for rows in PAPER.values()] == [8] * 4


@pytest.mark.parametrize(("iterations", "chunk"), [(250, 10), (100, 5), (20, 1), (4, 1), (37, 1)])
def test_evaluations_divide_the_training_into_twenty_parts_or_more(iterations, chunk):
    assert cells.chunk_of(iterations) == chunk


@pytest.mark.parametrize("env", COLUMNS)
def test_all_rows_of_an_environment_but_the_contrast_row_have_the_same_iterations_and_seeds(env):
    others = [cells.arguments(FULL, env, method) for method in ROWS if method != "aircl_contrast"]
    assert len({given["iterations"] for given in others}) == 1
    assert {given["first_seed"] for given in others} == {0}


@pytest.mark.parametrize(
    ("env", "iterations", "first"),
    [("gridworld", 300, 1000), ("swimmer", 300, 140), ("walker", 500, 170), ("pendulum", 300, 130)],
)
def test_the_contrast_row_has_its_own_iterations_and_fresh_seeds(env, iterations, first, tmp_path):
    job, asked = replace(FULL, out=tmp_path, runs=tmp_path), []

    def train(**given):
        asked.append(given)
        raise ValueError("asked")

    with mock.patch.object(cells, "train", train), pytest.raises(ValueError, match="asked"):
        cells.make_cell(job, env, "aircl_contrast", "abc1234")
    told = {name: asked[0][name] for name in ("env", "method", "seeds", "first_seed", "iterations")}
    assert told == {"env": env, "method": "aircl_contrast", "seeds": 10, "first_seed": first, "iterations": iterations}
    assert f" seeds=10 first_seed={first} iterations={iterations} " in asked[0]["command"]
    assert cells.spec_of(job, env, "aircl_contrast").seeds == tuple(range(first, first + 10))


def test_curves_are_the_evaluations_and_the_untrained_policy():
    history = {
        "violation_rate": np.arange(12.0).reshape(6, 2) / 3,
        "rc_acc": np.where(np.arange(6) % 3 == 2, 0.5, np.nan)[:, None],
    }
    assert cells.curves(history, chunk=3) == {
        "iteration": [0, 3, 6],
        "violation_rate": [[0.0, 0.3333], [1.333, 1.667], [3.333, 3.667]],
        "rc_acc": [[None], [0.5], [0.5]],
    }


def test_return_ratio_is_undefined_where_the_expert_earns_nothing():
    returns: dict[str, Any] = {"return": [1.0, 2.0, 3.0], "expert_return": [2.0, 0.0, -1.0]}
    cell = finished_cell(seeds=3, **returns)
    assert cells.values(cell, "return_ratio") == {0: 0.5, 1: None, 2: None}


def test_a_kept_cell_reads_back_the_same(tmp_path):
    job = replace(FULL, out=tmp_path)
    cell = finished_cell(violation_rate=0.1)
    cells.keep(job.path("gridworld", "aircl"), cell)
    assert cells.load(job) == {("gridworld", "aircl"): cell}


def test_a_value_is_that_of_its_seed():
    cell = finished_cell(seeds=3, violation_rate=[0.1, 0.2, np.nan]) | {"seeds": [7, 8, 9]}
    assert cells.values(cell, "violation_rate") == {7: 0.1, 8: 0.2, 9: None}
    assert study_of(cell).column("gridworld", "violation_rate", ["aircl", "bc"]) == {"aircl": {7: 0.1, 8: 0.2, 9: None}}


def test_a_row_is_trained_as_long_as_the_longer_of_the_two_shared_settings_or_as_its_own(monkeypatch):
    iterations = {"paper": 100, "tuned": 300, "contrast": 700}
    monkeypatch.setattr(cells, "default_config", lambda env, settings: TrainConfig(iterations=iterations[settings]))
    asked = {method: cells.iterations_of(FULL, "gridworld", method) for method in ("aircl", "bc", "aircl_contrast")}
    assert asked == {"aircl": 300, "bc": 300, "aircl_contrast": 700}
    assert {cells.iterations_of(replace(FULL, iterations=7), "gridworld", method) for method in asked} == {7}


def with_settings(method: str) -> dict[str, Any]:
    settings = cells.settings_of(cells.spec_of(FULL, "gridworld", method))
    return finished_cell(method=method, violation_rate=0.1) | {"settings": settings}


def test_a_contrast_cell_of_its_own_seeds_has_no_other_settings_and_one_of_the_others_seeds_has():
    cell = with_settings("aircl_contrast")
    place = "gridworld", "aircl_contrast"
    assert cells.other_settings(FULL, {place: cell}) == {}
    cell["settings"]["first_seed"] = 0
    assert cells.other_settings(FULL, {place: cell}) == {"first_seed is 0 there and 1000 here": ["gridworld/aircl_contrast"]}


def test_a_cell_made_with_other_settings_or_code_is_named():
    cell = with_settings("aircl")
    cell["settings"]["train"]["ppo"]["learning_rate"] = 0.1
    del cell["settings"]["env"]["slip"]  # the same of a world's setting
    del cell["settings"]["train"]["pool_factor"]  # as if pools were younger than the cell: without one is with one of 1
    with mock.patch.object(report, "changed_since", {"abc1234": True}.get):
        text = report.markdown(study_of(cell, with_settings("bc")))
    assert "train.ppo.learning_rate is 0.1 there and 0.0005 here: gridworld/aircl" in text
    assert "train.pool_factor" not in text
    assert "env.slip" not in text
    assert "commit `abc1234` (the library has changed since): gridworld: aircl, bc" in text
