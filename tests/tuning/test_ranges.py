"""Ranges are read, tried at their ends, and refused in one line."""

import pytest

from aircl_jax.settings.train_config import TrainConfig
from aircl_jax.tuning.ranges import Choice, Range, nested, read_ranges
from experiments.search import ranges_among

DEFAULTS = TrainConfig()


def test_words_give_ranges_lists_and_the_words_that_are_left():
    ranges, others = ranges_among(
        [
            "env=swimmer",
            "train.ppo.learning_rate=1e-4:1e-2:log",
            "train.adversary.num_steps=2:8",
            "train.encoder=attention,gru",
            "train.hidden=[4,4],[8]",
            "train.additive_hidden=[16,16]",
            "env.obstacles=[[1,2],[3,3]]",
        ]
    )
    assert ranges == {
        "train.ppo.learning_rate": (1e-4, 1e-2, "log"),
        "train.adversary.num_steps": (2, 8),
        "train.encoder": ["attention", "gru"],
        "train.hidden": [[4, 4], [8]],
    }
    assert others == ["env=swimmer", "train.additive_hidden=[16,16]", "env.obstacles=[[1,2],[3,3]]"]


def test_a_range_is_of_whole_numbers_where_its_setting_is_one():
    given = {"train.ppo.learning_rate": (1, 2), "train.adversary.num_steps": (2, 8, "log"), "train.learner": ["ppo", "exact"]}
    assert read_ranges(given, DEFAULTS) == {
        "train.ppo.learning_rate": Range(1, 2, log=False, whole=False),
        "train.adversary.num_steps": Range(2, 8, log=True, whole=True),
        "train.learner": Choice(("ppo", "exact")),
    }


def test_names_become_groups():
    assert nested({"train.ppo.discount": 0.9, "train.ppo.num_epochs": 2, "train.hidden": [4]}) == {
        "ppo": {"discount": 0.9, "num_epochs": 2},
        "hidden": [4],
    }


@pytest.mark.parametrize(
    ("given", "said"),
    [
        ({}, "there is nothing to search"),
        ({"env.slip": (0.0, 0.1)}, r"env\.slip cannot be searched; choose settings of training"),
        ({"train.iterations": (1, 2)}, r"train\.iterations cannot be searched; give iterations=N"),
        ({"train.num_demonstrations": (1, 2)}, "give held_out=SHARE"),
        ({"train.ppo.rate": (1, 2)}, r"unknown setting train\.ppo\.rate; choose from learning_rate"),
        ({"train.ppo.learning_rate": (0.1, 0.01)}, r"train\.ppo\.learning_rate=0\.1:0\.01 is empty"),
        ({"train.ppo.learning_rate": (0, 0.01, "log")}, "a logarithm needs numbers above 0"),
        ({"train.ppo.learning_rate": (0.1, "high")}, r"train\.ppo\.learning_rate=0\.1:high is no range"),
        ({"train.ppo.learning_rate": (0.1, 0.2, "even")}, "write LOW:HIGH or LOW:HIGH:log"),
        ({"train.adversary.num_steps": (1.5, 3)}, r"train\.adversary\.num_steps=1\.5 is not an integer"),
        ({"train.ppo.discount": (0.9, 1.5)}, r"train\.ppo\.discount=1\.5"),
        ({"train.encoder": ["gru"]}, "a list of 1 leaves no choice"),
        ({"train.encoder": ["gru", "lstm"]}, r"train\.encoder=lstm is not one of attention, gru"),
    ],
)
def test_what_cannot_be_searched_is_refused_in_one_line(given, said):
    with pytest.raises(ValueError, match=said) as error:
        read_ranges(given, DEFAULTS)
    assert "\n" not in str(error.value)
