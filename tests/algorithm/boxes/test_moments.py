"""The reward of a world without a table: θ by the gap of the feature means."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from aircl_jax.algorithm.boxes.moments import Weights, mean_features, next_weights
from aircl_jax.methods import get_method
from aircl_jax.model.features import features
from aircl_jax.settings.train_config import MomentConfig
from envs import Box, make_env
from tests.finished_runs import random_episodes
from tests.worlds import TINY, tiny_networks, unit_stats

FREE = MomentConfig(rate=0.5, sparsity=0.0, norm=10.0, sphere=40, averaged_from=0.5)


def after(config, gap, now=(0.0, 0.0), mean=(0.0, 0.0), step=0, iterations=100):
    weights = Weights(jnp.asarray(now, jnp.float32), jnp.asarray(mean, jnp.float32))
    return next_weights(weights, jnp.asarray(gap, jnp.float32), jnp.asarray(step), iterations, config)


def test_a_feature_that_demonstrations_have_more_of_is_worth_more():
    np.testing.assert_allclose(after(FREE, (1.0, -2.0), now=(0.1, 0.2)).now, [0.6, -0.8], rtol=1e-6)


def test_what_explains_little_is_shrunk_to_nothing():
    sparse = MomentConfig(rate=0.5, sparsity=0.4, norm=10.0)
    np.testing.assert_allclose(after(sparse, (1.0, -0.3)).now, [0.3, 0.0], atol=1e-6)  # .5 − .5 · .4; |−.15| < .2


def test_a_reward_that_would_vanish_whole_is_not_shrunk():
    sparse = MomentConfig(rate=0.5, sparsity=4.0, norm=10.0)
    np.testing.assert_allclose(after(sparse, (1.0, -0.3)).now, [0.5, -0.15], rtol=1e-6)


@pytest.mark.parametrize(("step", "size"), [(39, 0.5), (40, 2.0)])
def test_the_norm_is_bounded_at_first_and_then_fixed(step, size):
    config = MomentConfig(rate=1.0, sparsity=0.0, norm=2.0, sphere=40)
    assert float(jnp.linalg.norm(after(config, (0.3, 0.4), step=step).now)) == pytest.approx(size, rel=1e-6)
    assert float(jnp.linalg.norm(after(config, (3.0, 4.0), step=step).now)) == pytest.approx(2.0, rel=1e-6)


def test_the_norm_never_falls_below_what_it_was_and_the_direction_still_turns():
    config = MomentConfig(rate=0.5, sparsity=0.1, norm=2.0, sphere=40)
    now = after(config, (-0.5, 0.4), now=(0.3, 0.0)).now  # (.3 − .25 − .05, .2 − .05) → (0, .15) → (0, .3)
    np.testing.assert_allclose(now, [0.0, 0.3], atol=1e-6)


def test_what_is_learned_is_the_mean_over_the_later_part_of_the_run():
    weights, seen = Weights(jnp.zeros(1), jnp.zeros(1)), []
    for step in range(10):
        weights = next_weights(weights, jnp.ones(1), jnp.asarray(step), 10, FREE)
        seen.append(float(weights.now[0]))
        if step < 5:
            assert float(weights.mean[0]) == seen[-1]
    assert float(weights.mean[0]) == pytest.approx(np.mean(seen[5:]), rel=1e-6)


def test_features_are_the_coordinates_and_half_their_bounded_squares():
    np.testing.assert_allclose(features(jnp.array([-2.0, 5.0])), [-2.0, 5.0, 2.0, 4.5])


def test_the_mean_of_features_counts_what_is_not_masked():
    env = make_env("swimmer", horizon=8)
    method = get_method("aircl_contrast", of_box=True)
    nets, params = tiny_networks(env, method, TINY)
    stats = unit_stats(env)._replace(mean=jnp.full(env.obs_size, 0.25))
    episodes = random_episodes(env, 0, 4)
    rows = np.asarray(episodes.obs, float)[np.asarray(episodes.mask) > 0] - 0.25
    naive = np.concatenate([rows, 0.5 * np.minimum(rows**2, 9.0)], axis=1).mean(axis=0)
    np.testing.assert_allclose(mean_features(nets.bind(params, stats), episodes), naive, rtol=1e-4, atol=1e-6)


def test_the_reward_is_the_weighted_features_of_the_normalised_state_alone():
    env = make_env("swimmer", horizon=8)
    nets, params = tiny_networks(env, get_method("aircl_contrast", of_box=True), TINY)
    weights = jnp.arange(16.0)
    stats = unit_stats(env)._replace(std=jnp.full(8, 2.0))
    bound = nets.bind(params, stats).with_params(reward={"params": {"weights": weights}})
    obs = jax.random.normal(jax.random.key(0), (8,))
    seen = np.asarray(obs, float) / 2.0
    naive = np.arange(16.0) @ np.concatenate([seen, 0.5 * seen**2])
    for action in (jnp.zeros(2), jnp.ones(2)):
        assert float(bound.reward(obs, action)) == pytest.approx(naive, rel=1e-5)
    assert isinstance(env.action_space, Box)
