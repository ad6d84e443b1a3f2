"""What a row runs with where nothing is named: one configuration for every robot."""

from dataclasses import replace

import pytest

from aircl_jax.settings.env_defaults import config_of, contrast_of_box
from envs import make_env


@pytest.mark.parametrize("name", ["swimmer", "walker", "halfcheetah", "hopper", "pendulum"])
def test_horizon_and_number_of_actions_are_all_that_the_contrast_row_is_told_of_a_robot(name):
    env = make_env(name)
    assert config_of(env, "contrast") == contrast_of_box(env.horizon, env.action_space.feature_size)
    own = replace(env, name="own", registered=False)
    assert config_of(own, "contrast") == config_of(env, "contrast")
    assert config_of(own, "contrast").num_trajectories * env.horizon == 8_000
