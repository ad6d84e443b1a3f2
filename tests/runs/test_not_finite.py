"""A seed in which a number is not finite: said with its iteration, and without a measure from then on."""

import json
from dataclasses import replace
from functools import cache
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from aircl_jax import read_metrics, train
from aircl_jax.algorithm.trainer import FINITE, make_trainer
from aircl_jax.methods import METHODS
from aircl_jax.reports import run_report
from aircl_jax.reports.alarms import not_finite
from aircl_jax.reports.summary import summarise
from aircl_jax.runs import checkpoint, loop
from aircl_jax.runs.opening import open_saved
from envs import Env
from tests.finished_runs import untrained
from tests.tiny_runs import CONFIG, FAST
from tests.worlds import TINY, UNOPTIMISED, random_trajectories, tiny_grid

pytestmark = pytest.mark.usefixtures("no_figures")

NAMES = ("policy", "value", "reward", "feasibility")


@cache
def flag_of() -> Any:
    """(an addend for each group of parameters, one for observations) -> whether a step of the default row is finite."""
    env = tiny_grid()

    def run(addends: dict[str, Any], of_obs: Any) -> Any:
        def step(key, state, action):
            state, seen = env.step(key, state, action)
            return state, seen._replace(obs=seen.obs.at[0].add(of_obs))

        expert = random_trajectories(env, 0, TINY.num_demonstrations)
        trainer = make_trainer(replace(env, step=step), METHODS["aircl_corrected"], TINY)
        state = trainer.init(jax.random.key(0), expert)
        groups = {
            name: jax.tree.map(lambda leaf, add=add: leaf.at[(0,) * leaf.ndim].add(add), getattr(state.params, name))
            for name, add in addends.items()
        }
        return trainer.step(state._replace(params=state.params._replace(**groups)), expert)[1][FINITE]

    return jax.jit(run, compiler_options=UNOPTIMISED)


def flagged(obs: float = 0.0, **addends: float) -> bool:
    return bool(flag_of()(dict.fromkeys(NAMES, 0.0) | addends, obs))


def test_a_step_says_whether_its_numbers_are_finite():
    assert flagged()


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("value", [np.nan, np.inf])
def test_a_parameter_that_is_not_finite_is_noticed(name, value):
    assert not flagged(**{name: value})


@pytest.mark.parametrize("value", [np.nan, np.inf])
def test_an_observation_that_is_not_finite_is_noticed(value):
    assert not flagged(obs=value)


def test_the_first_iteration_of_each_seed_is_kept_over_chunks():
    since = loop._not_finite_since(None, np.ones((2, 3)), 0)
    assert since is None
    since = loop._not_finite_since(since, np.array([[1.0, 1.0, 1.0], [1.0, 0.0, 1.0]]), 2)
    assert since == [None, 4, None]
    assert loop._not_finite_since(since, np.array([[0.0, 1.0, 1.0], [0.0, 1.0, 1.0]]), 4) == [5, 4, None]
    row = {"rate": np.array([0.1, 0.2, 0.3])}
    assert np.array_equal(loop.without(row, [None, 4, None], 3)["rate"], [0.1, 0.2, 0.3])
    assert np.array_equal(loop.without(row, [None, 4, None], 4)["rate"], [0.1, np.nan, 0.3], equal_nan=True)


def test_the_mean_is_that_of_the_other_seeds_and_says_of_how_many():
    timing = [{"iteration": 4, "env_steps": 1, "first": True, "seconds": 1.0, "compile_s": 0.5, "not_finite": [None, 4]}]
    summary = summarise(untrained("airl").spec, {"return": np.array([3.0, 0.0])}, timing)
    assert summary["metrics"]["return"] == {"mean": 3.0, "std": None, "per_seed": [3.0, None], "of": 1}
    assert summary["not_finite"] == {"1": 4}
    (alarm,) = not_finite(summary)
    assert alarm.startswith("not finite: seed 1, from iteration 4 on (parameters, losses or observations)")
    assert alarm.endswith("such a seed's measures are undefined, and means are of the other 1.")
    assert "3 (of 1 seeds)" in run_report.table(summary)


def test_a_seed_whose_parameters_break_is_named_with_its_iteration_and_costs_no_other_seed(tmp_path):
    whole = train(**FAST, first_seed=6, iterations=4, run_dir=tmp_path / "whole")
    train(**FAST, first_seed=6, iterations=2, run_dir=tmp_path / "run")
    directory = open_saved(tmp_path / "run")
    states = directory.load(whole.states)
    reward = jax.tree.map(lambda leaf: leaf.at[1].set(jnp.nan), states.params.reward)
    path = tmp_path / "run" / "state" / "00000002"
    notes = checkpoint.notes_of(path)
    path.rename(tmp_path / "before")
    checkpoint.save(path, states._replace(params=states.params._replace(reward=reward)), notes)

    result = train(**FAST, first_seed=6, iterations=4, run_dir=tmp_path / "run", resume=True)

    assert result.alarms[0].startswith("not finite: seed 7, from iteration 3 on (parameters, losses or observations)")
    kept = json.loads((tmp_path / "run" / "summary.json").read_text())
    assert kept["not_finite"] == {"7": 3} and kept["metrics"].keys() == whole.summary["metrics"].keys()
    for name, row in kept["metrics"].items():
        assert row["per_seed"] == [whole.summary["metrics"][name]["per_seed"][0], None], name
    history = read_metrics(tmp_path / "run")
    assert np.isnan([values[2:, 1] for values in history.values()]).all()
    assert np.array_equal(history["violation_rate"][:, 0], whole.history["violation_rate"][:, 0])
    assert result.alarms[0][1:] in (tmp_path / "run" / "report.md").read_text()
    longer = train(**FAST, first_seed=6, iterations=6, run_dir=tmp_path / "run", resume=True)
    assert longer.alarms[0].startswith("not finite: seed 7, from iteration 3 on")


def blinking(env: Env) -> Env:
    """The same world, whose first observation after a step is not finite."""

    def step(key, state, action):
        state, seen = env.step(key, state, action)
        return state, seen._replace(obs=seen.obs.at[0].set(jnp.inf))

    return replace(env, step=step)


def test_a_world_that_breaks_in_every_seed_has_no_mean_and_still_a_summary(tmp_path):
    result = train(blinking(tiny_grid()), "airl", seeds=2, iterations=2, run_dir=tmp_path, config=CONFIG)
    (alarm,) = [line for line in result.alarms if line.startswith("not finite")]
    assert alarm.startswith("not finite: seed 0, from iteration 1 on; seed 1, from iteration 1 on")
    assert alarm.endswith("undefined, and no mean is left.")
    kept = json.loads((tmp_path / "summary.json").read_text())
    assert all(row["per_seed"] == [None, None] and row["mean"] is None for row in kept["metrics"].values())
    assert (tmp_path / "report.md").exists()
