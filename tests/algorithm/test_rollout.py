"""What one episode hands on, on worlds whose only state is the step count."""

from dataclasses import replace
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jaxtyping import Array

from aircl_jax.algorithm.rollout import rollout
from aircl_jax.types import Trajectory
from envs import Step
from tests.worlds import KNOWN_REWARD, one_state_env, tiny_networks, unit_stats


def one_episode(horizon: int, **kind: bool) -> tuple[Trajectory, list[float], list[float]]:
    """An episode whose step t is paid 10 + t, and V of every observation on its way, and log π of each action."""
    env = one_state_env(lambda t, action: 10.0 + t, horizon=horizon, **kind)
    nets, params = tiny_networks(env, KNOWN_REWARD)
    stats = unit_stats(env)
    found = jax.jit(lambda key: rollout(nets.bind(params, stats), key))(jax.random.key(0))
    value = [float(nets.bind(params, stats).value(jnp.eye(horizon + 1)[t], jnp.asarray(t))) for t in range(horizon + 1)]
    assert min(map(abs, value)) > 1e-3
    log_prob = [
        float(nets.bind(params, stats).policy(jnp.eye(horizon + 1)[t], jnp.asarray(t)).log_prob(found.action[t]))
        for t in range(horizon)
    ]
    return found, value, log_prob


def test_an_episode_that_terminates_in_its_last_step_is_worth_nothing_after_it():
    found, _, _ = one_episode(1, terminates=True, finite_horizon=False)
    np.testing.assert_array_equal(found.mask, [1.0])
    assert found.bootstrap == 0.0


def test_an_episode_that_the_horizon_cuts_is_worth_the_value_of_the_state_after_the_last_step():
    found, value, _ = one_episode(2, finite_horizon=False)
    np.testing.assert_array_equal(found.mask, [1.0, 1.0])
    np.testing.assert_allclose(found.bootstrap, value[2], rtol=1e-5)


def test_an_episode_whose_task_ends_at_the_horizon_is_worth_nothing_after_it():
    found, _, _ = one_episode(2, finite_horizon=True)
    assert found.bootstrap == 0.0


def test_the_step_that_terminates_still_counts_and_none_after_it():
    found, _, _ = one_episode(3, terminates=True, finite_horizon=False)
    np.testing.assert_array_equal(found.mask, [1.0, 0.0, 0.0])


def test_an_episode_that_is_over_stays_over():
    base = one_state_env(lambda t, action: jnp.ones(()), horizon=4, finite_horizon=False)

    def step(key: Array, state: Any, action: Array) -> tuple[Any, Step]:
        after, result = base.step(key, state, action)
        return after, result._replace(terminated=(state == 1).astype(jnp.float32))

    env = replace(base, step=step)
    nets, params = tiny_networks(env, KNOWN_REWARD)
    found = jax.jit(lambda key: rollout(nets.bind(params, unit_stats(env)), key))(jax.random.key(0))
    np.testing.assert_array_equal(found.mask, [1.0, 1.0, 0.0, 0.0])
    assert found.bootstrap == 0.0


@pytest.mark.parametrize("t", [0, 1])
def test_a_step_holds_the_state_before_the_action_with_its_value_and_log_probability_and_the_reward_after_it(t):
    found, value, log_prob = one_episode(2)
    np.testing.assert_array_equal(found.obs[t], np.eye(3)[t])
    np.testing.assert_allclose([found.value[t], found.log_prob[t]], [value[t], log_prob[t]], rtol=1e-5)
    assert found.reward[t] == 10.0 + t
