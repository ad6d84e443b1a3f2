import json
from dataclasses import dataclass
from typing import Literal

import numpy as np
import pytest

from aircl_jax.reports.summary import statistics
from aircl_jax.runs import directory as runs
from aircl_jax.runs import opening
from aircl_jax.runs.metrics_log import stack
from envs.settings import updated

SETTINGS = {"env": {"name": "gridworld", "slip": 0.01}, "iterations": 4}


def open_run(path, existing: Literal["refuse", "resume", "overwrite"] = "refuse", **changes):
    return opening.open_run(path, SETTINGS | changes, chunk=2, existing=existing)


def test_undefined_numbers_are_null_and_others_read_back_to_the_same_float32():
    values = np.array([np.nan, np.inf, 0.1, 1 / 3], np.float32)
    line = json.loads(runs.to_json({"x": values}))
    assert line["x"][:2] == [None, None]
    assert np.array_equal(np.array(line["x"][2:], np.float32), values[2:])


def test_looking_at_a_directory_writes_nothing(tmp_path):
    open_run(tmp_path / "new")
    assert list(tmp_path.iterdir()) == []


def test_a_directory_with_a_run_is_refused_unless_one_says_what_to_do(tmp_path):
    with open_run(tmp_path).held():
        pass
    with pytest.raises(ValueError, match="already holds a run; choose resume=true, overwrite=true"):
        open_run(tmp_path)
    assert open_run(tmp_path, "resume").start == 0


def test_overwriting_removes_the_old_run_and_nothing_else(tmp_path):
    with open_run(tmp_path).held():
        (tmp_path / runs.SUMMARY).write_text("{}")
        (tmp_path / "notes.txt").write_text("mine")
    with open_run(tmp_path, "overwrite").held():
        assert not (tmp_path / runs.SUMMARY).exists()
        assert (tmp_path / "notes.txt").read_text() == "mine"


def test_a_directory_with_other_files_is_refused(tmp_path):
    (tmp_path / "thesis.tex").write_text("")
    with pytest.raises(ValueError, match=r"holds files \(thesis.tex, …\) and no config.yaml; choose another directory"):
        open_run(tmp_path, "overwrite")


def test_two_runs_cannot_hold_one_directory(tmp_path):
    with (
        open_run(tmp_path).held(),
        pytest.raises(ValueError, match="in use by another run"),
        open_run(tmp_path, "overwrite").held(),
    ):
        pass


def test_a_changed_setting_is_listed(tmp_path):
    with open_run(tmp_path).held():
        pass
    with pytest.raises(ValueError, match=r"env.slip is 0.01 there and 0.5 here"):
        open_run(tmp_path, "resume", env={"name": "gridworld", "slip": 0.5})


def test_a_run_that_is_older_than_a_setting_of_its_world_resumes_where_that_has_its_default(tmp_path):
    with open_run(tmp_path, env={"name": "swimmer", "noise": 0.001}).held():
        pass
    today = {"name": "swimmer", "noise": 0.001, "reward": "task", "body": {"mass": 1.0, "gears": {"front": 1.0}}}
    assert open_run(tmp_path, "resume", env=today).start == 0
    with pytest.raises(ValueError, match=r"settings: env.body.gears.front is 1.0 there and -1.0 here; choose"):
        open_run(tmp_path, "resume", env=today | {"body": {"mass": 1.0, "gears": {"front": -1.0}}})


def test_rows_without_a_metric_count_as_undefined():
    stacked = stack([{"a": [1.0, 2.0]}, {"a": [3.0, None], "b": [0.0, 1.0]}])
    assert np.array_equal(stacked["a"], [[1, 2], [3, np.nan]], equal_nan=True)
    assert np.array_equal(stacked["b"], [[np.nan, np.nan], [0, 1]], equal_nan=True)


def test_statistics_are_those_of_a_sample_and_undefined_with_one_seed_undefined():
    assert statistics([1.0, 3.0]) == {"mean": 2.0, "std": pytest.approx(2**0.5), "per_seed": [1.0, 3.0]}
    assert statistics([2.0])["std"] is None
    assert statistics([1.0, np.nan]) == {"mean": None, "std": None, "per_seed": [1.0, None]}


@dataclass(frozen=True)
class Inner:
    rate: float = 0.5


@dataclass(frozen=True)
class Outer:
    size: int = 1
    kind: Literal["a", "b"] = "a"
    limit: float | Literal["default"] = "default"
    cells: tuple[tuple[int, int], ...] = ()
    inner: Inner = Inner()


def test_settings_are_converted_to_the_types_of_the_dataclass():
    made = updated(Outer(), {"limit": 2, "cells": [[1, 2]], "inner": {"rate": 1}})
    assert made == Outer(limit=2.0, cells=((1, 2),), inner=Inner(1.0))
    assert updated(Outer(), {"inner": Inner(2.0)}).inner == Inner(2.0)


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({"size": 2.5}, "env.size=2.5 is not an integer"),
        ({"size": True}, "env.size=true is not an integer"),
        ({"kind": "c"}, "env.kind=c is not one of a, b"),
        ({"limit": "high"}, "env.limit=high is not a number or 'default'"),
        ({"limit": float("nan")}, "env.limit=nan is not a number"),
        ({"cells": [[1, 2, 3]]}, r"env.cells=\[\[1, 2, 3\]\] is not a list"),
        ({"inner": 3}, "env.inner=3 is not a group of settings"),
        ({"inner": {"rte": 3}}, "unknown setting env.inner.rte; choose from rate"),
        ({"size": None}, "env.size=null is not an integer"),
    ],
)
def test_a_wrong_setting_names_itself_its_value_and_the_choices(values, message):
    with pytest.raises(ValueError, match=message):
        updated(Outer(), values, "env")
