"""Controls on robots: what their experts are made of, and what is counted of the limits drawn."""

from types import SimpleNamespace
from typing import Any, cast

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from aircl_jax.analysis.recovered_limits import Limits
from aircl_jax.demonstrations import files
from aircl_jax.transfer.fresh import Fresh
from envs import make_env
from experiments.swap import robot_controls
from experiments.swap.robot_cells import Study
from experiments.swap.robot_controls import CONTROLS, demonstrate, drawn, lines

WORLD, KEY = make_env("swimmer"), jax.random.key(0)
CELL = {
    "env": "swimmer",
    "row": "aircl_contrast",
    "test": "lapses of 1 %",
    "seeds": [100, 101],
    "demonstrated": {"return": 90.0, "violation_rate": 0.005, "least": [-1.0, -0.5], "greatest": [0.5, 1.0]},
    "actions": ["front", "rear"],
    "lower": [[None, -0.5], [None, -0.4]],
    "upper": [[None, None], [0.48, None]],
    "metrics": {"return": [80.0, 100.0], "violation_rate_policy": [0.0, 0.01], "step_feasibility_auroc": [1.0, 1.0]},
}


def test_a_line_counts_the_seeds_of_each_limit():
    (line,) = lines({("swimmer", "lapses of 1 %", "aircl_contrast"): CELL}, "swimmer", ["aircl_contrast"])
    assert line == (
        "lapses of 1 %",
        "90.0; 0.50 %; -1.00 to 0.50, -0.50 to 1.00",
        "front +0.48 (1), rear -0.45 (2)",
        "2 of 2",
        "90.0; 0.50 %",
    )


def test_without_limits_none_is_said():
    free = {**CELL, "lower": [[None, None]] * 2, "upper": [[None, None]] * 2}
    (line,) = lines({("swimmer", "lapses of 1 %", "aircl_contrast"): free}, "swimmer", ["aircl_contrast"])
    assert line[2:4] == ("none", "0 of 2")


def test_limits_are_those_of_the_run_with_none_where_there_is_none(monkeypatch):
    limits = Limits(("front",), np.array([[np.nan], [-0.5]]), np.array([[0.5], [np.nan]]), np.array([-0.5]), np.array([0.5]))
    monkeypatch.setattr(robot_controls, "recovered_limits", lambda result: limits)
    measures = {name: {"per_seed": [1.0, 2.0]} for name in ("return", "violation_rate_policy", "step_feasibility_auroc")}
    kept = drawn(cast(Any, SimpleNamespace(summary={"metrics": measures})))
    assert (kept["lower"], kept["upper"]) == ([[None], [-0.5]], [[0.5], [None]])
    assert kept["metrics"]["return"] == [1.0, 2.0]


@pytest.mark.parametrize("name", ["action cost .1", "lapses of 5 %"])
def test_the_expert_is_paid_the_true_reward_less_its_taste_and_lapses_at_random(name, monkeypatch, tmp_path):
    asked = {}

    def recombined(world, objective, seeds, config, constrained):
        asked.update(cost=world.step(KEY, world.reset(KEY)[0], jnp.full(2, 0.5))[1].reward, constrained=constrained)
        return SimpleNamespace(made=Fresh(cast(Any, None), cast(Any, {"step": jnp.zeros(1)}), None, {}))

    still = SimpleNamespace(policy=lambda obs, t: SimpleNamespace(sample=lambda seed: jnp.full(2, 0.25)))
    monkeypatch.setattr(robot_controls, "recombine", recombined)
    monkeypatch.setattr(robot_controls, "bound", lambda nets, state: still)
    monkeypatch.setattr(robot_controls, "EPISODES", 4)
    demonstrate("swimmer", CONTROLS[name], tmp_path / "shown.npz")
    shown, plain = files.load(tmp_path / "shown.npz", WORLD), WORLD.step(KEY, WORLD.reset(KEY)[0], jnp.full(2, 0.5))[1].reward
    random = (np.asarray(shown.action) != 0.25).any(axis=-1)
    assert asked["constrained"] is (name == "lapses of 5 %")
    assert random.mean() == pytest.approx(CONTROLS[name].lapse, abs=0.01)
    assert float(plain - asked["cost"]) == pytest.approx(CONTROLS[name].action_cost * 0.5, abs=1e-6)
    measured = files.metadata(tmp_path / "shown.npz")["measured"]
    assert measured["violation_rate"] == pytest.approx(float(shown.cost.mean()))
    assert measured["greatest"] == pytest.approx(np.asarray(shown.action).max((0, 1)).tolist())


def test_a_control_is_trained_once_on_its_own_demonstrations(monkeypatch, tmp_path):
    made = []
    monkeypatch.setattr(robot_controls, "demonstrate", lambda env, control, path: made.append((env, control.about, path)))
    monkeypatch.setattr(files, "metadata", lambda path: {"measured": {"return": 1.0}})
    monkeypatch.setattr(robot_controls, "train", lambda env, method, **given: made.append(given))
    monkeypatch.setattr(robot_controls, "drawn", lambda result: {"metrics": {}})
    study = Study(tmp_path / "out", tmp_path / "runs", oracle_seeds=10, seeds=2, iterations=0)
    first = robot_controls.cell(study, "swimmer", "aircl_contrast", "lapses of 1 %")
    assert robot_controls.cell(study, "swimmer", "aircl_contrast", "lapses of 1 %") == first
    (expert, given) = made
    assert expert == ("swimmer", CONTROLS["lapses of 1 %"].about, given["demonstrations"])
    assert given["demonstrations"].parent.is_dir()  # where they are written
    assert (first["seeds"], given["seeds"], given["first_seed"]) == ([113, 114], 2, 113)
