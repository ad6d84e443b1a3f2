from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from aircl_jax.algorithm.learners.ppo import clipped_surrogate, epoch_order, gae, make_optimiser
from aircl_jax.algorithm.masks import masked_mean
from aircl_jax.model.distributions import project_log_std
from aircl_jax.settings.train_config import PPOConfig
from envs import Box
from tests.worlds import KNOWN_REWARD, one_state_env, tiny_networks, unit_stats


def advantage(reward, value, bootstrap, mask, discount=0.5, gae_lambda=0.5):
    def array(x):
        return jnp.asarray(x, jnp.float32)

    return gae(array(reward), array(value), array(bootstrap), array(mask), discount, gae_lambda)


def test_gae_is_the_sum_worked_by_hand():
    # δ = [1 + ½·2 − 4, 3 + ½·8 − 2] = [−2, 5]; Â_1 = 5, Â_0 = −2 + ¼·5
    np.testing.assert_allclose(advantage([1, 3], [4, 2], 8, [1, 1]), [-0.75, 5.0])


def test_gae_has_no_value_after_termination_and_none_of_its_rewards():
    # The first step terminates: Â_0 = 1 − 4, whatever stands behind it.
    np.testing.assert_allclose(advantage([1, 900], [4, 700], 0, [1, 0]), [-3.0, 0.0])


def test_gae_with_lambda_one_is_the_return_less_the_value():
    # returns: 3 + ½·8 = 7 and 1 + ½·7 = 4.5
    np.testing.assert_allclose(advantage([1, 3], [4, 2], 8, [1, 1], gae_lambda=1.0), [0.5, 5.0])


def test_gae_with_lambda_zero_is_the_temporal_difference():
    np.testing.assert_allclose(advantage([1, 3], [4, 2], 8, [1, 1], gae_lambda=0.0), [-2.0, 5.0])


def test_a_huge_gradient_of_the_critic_does_not_mute_the_policy():
    optimiser = make_optimiser(PPOConfig(learning_rate=0.1))
    weights = (jnp.zeros(2), jnp.zeros(2))
    state = optimiser.init(weights)

    def moved(critic_gradient):
        updates: Any = optimiser.update((jnp.ones(2), critic_gradient * jnp.ones(2)), state, weights)[0]
        return updates[0]

    np.testing.assert_array_equal(moved(1.0), moved(1e8))
    np.testing.assert_allclose(moved(1e8), -0.1, rtol=1e-4)  # Adam's first step


def test_gae_equals_the_double_sum_over_random_trajectories():
    random = np.random.default_rng(0)
    reward, value = random.normal(size=(2, 7))
    values = np.append(value, 1.5)
    delta = reward + 0.9 * values[1:] - values[:-1]
    expected = [sum((0.9 * 0.8) ** i * delta[t + i] for i in range(7 - t)) for t in range(7)]
    np.testing.assert_allclose(advantage(reward, value, 1.5, np.ones(7), 0.9, 0.8), expected, rtol=1e-5)


@pytest.mark.parametrize(
    ("ratio", "gain", "expected"),
    [
        (1.0, 2.0, 2.0),  # nothing moved
        (1.5, 2.0, 2.2),  # gain beyond 1 + ε is cut
        (0.5, 2.0, 1.0),  # a loss is not
        (0.5, -2.0, -1.8),  # gain beyond 1 − ε is cut
        (1.5, -2.0, -3.0),
    ],
)
def test_clipped_surrogate_is_the_number_worked_by_hand(ratio, gain, expected):
    value = clipped_surrogate(jnp.log(ratio), jnp.zeros(()), jnp.asarray(gain), 0.1)
    np.testing.assert_allclose(value, expected, rtol=1e-6)


def test_clipped_surrogate_has_no_gradient_where_it_is_clipped():
    def surrogate(log_prob):
        return clipped_surrogate(log_prob, jnp.zeros(()), jnp.ones(()), 0.1)

    assert jax.grad(surrogate)(jnp.log(1.5)) == 0.0
    np.testing.assert_allclose(jax.grad(surrogate)(jnp.log(0.5)), 0.5, rtol=1e-6)


@pytest.mark.parametrize(
    ("number", "horizon", "minibatch_size", "shape"),
    [(50, 500, 2500, (10, 5)), (70, 10, 700, (1, 70)), (7, 30, 60, (3, 2)), (3, 500, 100, (3, 1)), (4, 10, 1000, (1, 4))],
)
def test_an_epoch_visits_every_trajectory_once_but_for_a_remainder(number, horizon, minibatch_size, shape):
    order = np.asarray(epoch_order(jax.random.key(0), number, horizon, minibatch_size))
    assert order.shape == shape
    assert len(set(order.ravel())) == order.size
    assert order.size > number - max(shape)
    assert set(order.ravel()) <= set(range(number))


def test_masked_mean_ignores_masked_steps_and_is_zero_of_none():
    x = jnp.asarray([1.0, 3.0, 100.0])
    assert masked_mean(x, jnp.asarray([1.0, 1.0, 0.0])) == 2.0
    assert masked_mean(x, jnp.zeros(3)) == 0.0


def test_log_std_is_projected_after_the_update_and_keeps_its_gradient_at_the_bound():
    config = PPOConfig(log_std_min=-3.0, log_std_max=0.0)
    env = one_state_env(lambda t, action: -jnp.sum(action**2), action_space=Box(1))
    nets, params = tiny_networks(env, KNOWN_REWARD)

    def log_prob(log_std):
        policy = {"params": {**params.policy["params"], "log_std": log_std}}
        bound = nets.bind(params._replace(policy=policy), unit_stats(env))
        return bound.policy(jnp.zeros(2), jnp.asarray(0)).log_prob(jnp.asarray([0.3]))

    at_bound = jnp.zeros(1)
    assert project_log_std({"params": {"log_std": at_bound + 0.4}}, config)["params"]["log_std"] == 0.0
    assert jax.grad(log_prob)(at_bound)[0] < 0.0
