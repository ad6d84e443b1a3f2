"""The reward of a world without a table: θ by the gaps of the feature means, and the choice among them."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.optimize import minimize

from aircl_jax.algorithm.boxes.moments import LATER_GAPS, first_weights, following, mean_features, next_weights, separating
from aircl_jax.methods import get_method
from aircl_jax.model.features import features
from aircl_jax.settings.train_config import MomentConfig, TrainConfig
from envs import Box, make_env
from tests.finished_runs import random_episodes
from tests.worlds import TINY, tiny_networks, unit_stats

FREE = MomentConfig(rate=0.5, sparsity=0.0, norm=10.0, sphere=40)
NEVER, ONCE = jnp.zeros((), bool), jnp.ones((), bool)


def after(config, gap, now=(0.0, 0.0), step=0):
    return following(jnp.asarray(now, jnp.float32), jnp.asarray(gap, jnp.float32), jnp.asarray(step), config)


def test_a_feature_that_demonstrations_have_more_of_is_worth_more():
    np.testing.assert_allclose(after(FREE, (1.0, -2.0), now=(0.1, 0.2)), [0.6, -0.8], rtol=1e-6)


def test_what_explains_little_is_shrunk_to_nothing():
    sparse = MomentConfig(rate=0.5, sparsity=0.4, norm=10.0)
    np.testing.assert_allclose(after(sparse, (1.0, -0.3)), [0.3, 0.0], atol=1e-6)  # .5 − .5 · .4; |−.15| < .2


def test_a_reward_that_would_vanish_whole_is_not_shrunk():
    sparse = MomentConfig(rate=0.5, sparsity=4.0, norm=10.0)
    np.testing.assert_allclose(after(sparse, (1.0, -0.3)), [0.5, -0.15], rtol=1e-6)


@pytest.mark.parametrize(("step", "size"), [(39, 0.5), (40, 2.0)])
def test_the_norm_is_bounded_at_first_and_then_fixed(step, size):
    config = MomentConfig(rate=1.0, sparsity=0.0, norm=2.0, sphere=40)
    assert float(jnp.linalg.norm(after(config, (0.3, 0.4), step=step))) == pytest.approx(size, rel=1e-6)
    assert float(jnp.linalg.norm(after(config, (3.0, 4.0), step=step))) == pytest.approx(2.0, rel=1e-6)


def test_the_norm_never_falls_below_what_it_was_and_the_direction_still_turns():
    config = MomentConfig(rate=0.5, sparsity=0.1, norm=2.0, sphere=40)
    now = after(config, (-0.5, 0.4), now=(0.3, 0.0))  # (.3 − .25 − .05, .2 − .05) → (0, .15) → (0, .3)
    np.testing.assert_allclose(now, [0.0, 0.3], atol=1e-6)


def chosen(gaps, config, otherwise=None):
    gaps = jnp.asarray(gaps, jnp.float32)
    return np.asarray(separating(gaps, jnp.zeros(gaps.shape[1]) if otherwise is None else otherwise, config))


def test_the_chosen_reward_is_the_minimum_in_float64():
    draws = np.random.default_rng(0)
    gaps, config = draws.normal(0.4, 0.6, (40, 6)), MomentConfig(norm=0.5, near=0.6, selection=0.1)
    far = gaps[np.sqrt((gaps**2).mean(axis=1)) > 0.6]
    assert 0 < len(far) < len(gaps)
    penalty = 0.1 * np.abs(far.sum(axis=0)).max()

    def loss(split):  # θ = its positive part less its negative one
        slack = np.maximum(0.0, 1.0 - far @ (split[:6] - split[6:]))
        pull = -far.T @ slack
        return 0.5 * (slack**2).sum() + penalty * split.sum(), np.concatenate([pull, -pull]) + penalty

    found = minimize(loss, np.full(12, 0.1), jac=True, bounds=[(0, None)] * 12, method="L-BFGS-B", options={"ftol": 1e-14})
    naive = found.x[:6] - found.x[6:]
    assert (np.abs(naive) < 1e-6).any() and (np.abs(naive) > 1e-2).sum() > 1
    np.testing.assert_allclose(chosen(gaps, config), 0.5 * naive / np.linalg.norm(naive), atol=2e-4)


def test_what_every_policy_lacked_is_chosen_and_not_the_manner_that_the_last_one_lacks():
    manners = [(0.0, 0.9, 0.1), (-0.6, 0.8, 0.2), (0.3, 0.7, 0.9), (-0.5, 0.6, -0.8), (0.8, 0.3, -0.3)]
    theta = chosen(manners, MomentConfig(norm=0.5, near=0.175))
    np.testing.assert_allclose(theta, [0.0, 0.5, 0.0], atol=0.03)
    assert theta[2] == 0.0
    assert np.argmax(np.abs(chosen(manners[-1:], MomentConfig(norm=0.5, near=0.175)))) == 0


def test_policies_like_the_demonstrator_have_no_say_and_without_others_nothing_changes():
    config = MomentConfig(norm=0.5, near=0.5)
    far = np.array([[0.2, 1.0], [-0.2, 1.0]])
    near = np.tile([0.4, -0.1], (50, 1))
    np.testing.assert_allclose(chosen(np.concatenate([far, near]), config), chosen(far, config), atol=1e-6)
    np.testing.assert_array_equal(chosen(near, config, jnp.array([0.3, 0.4])), np.array([0.3, 0.4], np.float32))


def test_the_reward_follows_the_gap_is_chosen_once_and_is_kept_while_the_policy_stays():
    config = MomentConfig(rate=0.5, sparsity=0.0, norm=0.5, near=0.1, far=4.0, patience=1)
    train = TrainConfig(feasibility_delay=3, moments=config)
    weights, gaps = first_weights(2, train), np.array([[0.9, 1.0], [-0.8, 1.0], [1.0, 0.2], [3.0, 3.0]], np.float32)
    for step, (gap, begins, begun) in enumerate(
        zip(gaps, (NEVER, NEVER, ONCE, ONCE), (NEVER, NEVER, NEVER, ONCE), strict=True)
    ):
        before, weights = weights, next_weights(weights, jnp.asarray(gap), jnp.asarray(step), begins, begun, ONCE, config)
        if step < 2:
            np.testing.assert_array_equal(weights.now, following(before.now, jnp.asarray(gap), jnp.asarray(step), config))
    np.testing.assert_array_equal(weights.gaps, [*gaps[:3], *np.zeros((1 + LATER_GAPS, 2))])
    np.testing.assert_array_equal(weights.now, separating(jnp.asarray(gaps[:3]), jnp.zeros(2), config))


def test_a_reward_by_which_the_policy_leaves_is_chosen_anew_by_what_it_then_was():
    """π was to the left at first, so "more to the right" separates; then it goes right for ever, and its square is left."""
    config = MomentConfig(norm=0.5, near=0.1, far=1.0, patience=3)
    start = first_weights(2, TrainConfig(feasibility_delay=1, moments=config))
    gaps = ((1.5, -1.2), (1.5, -1.2), (-4.0, -4.5), (0.1, 0.1), (-4.0, -4.5), (-4.1, -4.5), (-4.2, -4.5), (-0.2, 0.0))

    def run(early):
        weights, seen = start, []
        for step, gap in enumerate(gaps):
            begins, begun = (ONCE if step >= first else NEVER for first in (1, 2))
            weights = next_weights(weights, jnp.asarray(gap), jnp.asarray(step), begins, begun, early, config)
            seen.append(np.asarray(weights.now))
        return weights, seen

    weights, seen = run(ONCE)
    np.testing.assert_allclose(seen[1:6], [[0.5, 0.0]] * 5, atol=1e-6)  # three iterations in a row away make it
    np.testing.assert_allclose(seen[6:], [[0.0, -0.5]] * 2, atol=1e-6)
    assert (float(weights.away), float(weights.all_away), float(weights.rechosen)) == (0.0, 4.0, 1.0)
    kept = np.asarray(weights.gaps)
    np.testing.assert_allclose(kept[kept.any(axis=1)], [gaps[i] for i in (0, 1, 2, 4, 5, 6)])  # near it teaches nothing
    late, seen = run(NEVER)
    np.testing.assert_allclose(seen[1:], [[0.5, 0.0]] * 7, atol=1e-6)
    assert float(late.rechosen) == 0.0


def test_of_the_time_since_the_choice_the_last_gaps_are_kept():
    config = MomentConfig(near=0.1, far=1.0, patience=1_000)
    weights, step = first_weights(1, TrainConfig(feasibility_delay=0, moments=config)), jax.jit(next_weights, static_argnums=6)
    for at in range(1, LATER_GAPS + 3):
        weights = step(weights, jnp.array([1.0 + at]), jnp.asarray(at), ONCE, ONCE, ONCE, config)
    kept = np.sort(np.asarray(weights.gaps)[1:, 0])
    np.testing.assert_array_equal(kept, 1.0 + np.arange(3, LATER_GAPS + 3))


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
