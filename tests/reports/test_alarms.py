"""What a report says first: what looks degenerate, and settings that nobody tuned."""

from dataclasses import replace

from aircl_jax.reports.alarms import alarms, untuned
from aircl_jax.settings.env_defaults import GUESTS, TUNED, config_of
from aircl_jax.settings.train_config import TrainConfig
from envs import ENVS, make_env


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
    assert config_of(make_env("gridworld"), "tuned") == TUNED["gridworld"]


def test_an_alarm_names_the_seeds_that_it_rings_for():
    (sentence,) = alarms([3, 4], {"feasibility_auroc": {"per_seed": [0.4, 0.9]}})
    assert sentence == "δ̄ is inverted: it ranks violating trajectories above clean ones (feasibility_auroc 0.4; seed 3)."
