"""What a report says first: what looks degenerate, and settings that nobody tuned."""

from aircl_jax.reports.alarms import alarms, untuned
from envs import ENVS


def test_every_shipped_world_has_settings_of_its_own():
    assert [sentence for name in ENVS for sentence in untuned(name)] == []


def test_a_world_without_settings_of_its_own_is_named_in_one_line():
    (sentence,) = untuned("point")
    assert sentence.startswith("env=point runs with untuned settings")


def test_an_alarm_names_the_seeds_that_it_rings_for():
    (sentence,) = alarms([3, 4], {"feasibility_auroc": {"per_seed": [0.4, 0.9]}})
    assert sentence == "δ̄ is inverted: it ranks violating trajectories above clean ones (feasibility_auroc 0.4; seed 3)."
