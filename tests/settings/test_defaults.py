"""What a row runs with where nothing is named: one configuration for every robot."""

from dataclasses import replace

import pytest

from aircl_jax.settings.env_defaults import config_of, contrast_of_box
from aircl_jax.settings.train_config import TrainConfig
from envs import make_env


@pytest.mark.parametrize("name", ["swimmer", "walker", "halfcheetah", "hopper", "pendulum"])
def test_horizon_and_number_of_actions_are_all_that_the_contrast_row_is_told_of_a_robot(name):
    env = make_env(name)
    assert config_of(env, "contrast") == contrast_of_box(env.horizon, env.action_space.feature_size)
    own = replace(env, name="own", registered=False)
    assert config_of(own, "contrast") == config_of(env, "contrast")
    assert config_of(own, "contrast").num_trajectories * env.horizon == 8_000


def test_a_box_of_ones_own_has_ten_minibatches_of_whole_episodes_however_short_they_are():
    robot = make_env("swimmer")
    for horizon in (30, 500):
        own = replace(robot, registered=False, horizon=horizon)
        config = config_of(own, "tuned")
        assert config.num_trajectories * horizon == 10 * config.ppo.minibatch_size
        assert config_of(own, "paper") == TrainConfig()
