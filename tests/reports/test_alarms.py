"""What a report says first: what looks degenerate, and settings that nobody tuned."""

import re
from dataclasses import asdict, replace

import pytest

from aircl_jax.reports.alarms import ALARMS, alarms, untuned
from aircl_jax.settings.env_defaults import GUESTS, TUNED, config_of
from aircl_jax.settings.train_config import TrainConfig
from envs import ENVS, make_env
from envs.settings import flatten


def test_every_shipped_world_has_settings_of_its_own():
    grid = make_env("gridworld")
    of_all = {name: untuned(replace(grid, name=name)) for name in ENVS}
    assert [name for name, sentences in of_all.items() if sentences] == list(GUESTS)
    assert of_all["brax"][0].endswith("what `config` does not name is those of the shipped robots.")


def test_a_world_without_settings_of_its_own_is_named_in_one_line():
    (sentence,) = untuned(replace(make_env("gridworld"), name="point"))
    assert sentence.startswith("env=point runs with untuned settings")


def test_a_world_of_ones_own_takes_no_settings_by_its_name():
    own = replace(make_env("gridworld"), name="walker", registered=False)
    assert untuned(own)[0].startswith("env=walker runs with untuned settings")
    assert config_of(own, "tuned") == TrainConfig()
    robot = replace(make_env("swimmer"), name="walker", registered=False)
    assert config_of(robot, "tuned") == config_of(replace(robot, name="point"), "tuned") != TUNED["walker"]
    assert config_of(make_env("gridworld"), "tuned") == TUNED["gridworld"]


def test_an_alarm_names_the_seeds_that_it_rings_for():
    (sentence,) = alarms([3, 4], {"feasibility_auroc": {"per_seed": [0.4, 0.9]}})
    said, advice = sentence.split(". ", 1)
    assert said == "δ̄ is inverted: it ranks violating trajectories above clean ones (feasibility_auroc 0.4; seed 3)"
    assert advice.startswith("Look at what it forbids in card.md")


@pytest.mark.parametrize(
    ("metric", "rings", "silent", "advice"),
    [
        ("untested", 1.0, 0.9, "Give more demonstrations, or ones of a task that tempts more"),
        ("moment_gap", 0.4, 0.3, "Train longer (iterations=), or roll out more (train.num_trajectories=)"),
        ("gap_at_end", 1.1, 0.9, "Train longer (iterations=), or give more demonstrations"),
        ("strayed", 0.03, 0.01, "Train longer (iterations=)"),
        ("feasibility_expert", 0.5, 0.7, "a smaller train.coefficients.threshold flags less"),
    ],
)
def test_what_did_not_work_is_said_with_what_to_do(metric, rings, silent, advice):
    (sentence,) = alarms([0, 1, 2], {metric: {"per_seed": [silent, rings, None]}})
    assert f"({metric} {rings:.3g}; seed 1). " in sentence
    assert advice in sentence


def test_every_setting_that_an_alarm_names_exists():
    named = {name for alarm in ALARMS for name in re.findall(r"train\.([\w.]+)=?", alarm.advice)}
    assert named <= set(flatten(asdict(TrainConfig())))
    assert len(named) >= 5
