"""Cloning by hand: the loss, what it leaves out, and what an epoch is."""

from dataclasses import replace
from functools import cache
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from aircl_jax.algorithm import cloning
from aircl_jax.algorithm.learners.ppo import make_optimiser
from aircl_jax.settings.train_config import PPOConfig
from aircl_jax.types import Params, Trajectory
from envs import Box
from tests.worlds import TINY, one_state_env, random_trajectories, tiny_grid, tiny_networks, unit_stats

WHOLE = PPOConfig(num_epochs=1, minibatch_size=10_000, learning_rate=0.01)  # one minibatch, one step
EXPERT = random_trajectories(tiny_grid(), 0, 5)


@cache
def clone(epochs: int, poison: int) -> tuple[Params, Params, float]:
    """Parameters before and after, and the loss; `poison` changes the actions past each episode's end."""
    env, config = tiny_grid(), replace(WHOLE, num_epochs=epochs)
    nets, params = tiny_networks(env, "bc")
    expert = EXPERT._replace(action=jnp.where(EXPERT.mask > 0, EXPERT.action, (EXPERT.action + poison) % 4))
    start = make_optimiser(config).init((params.policy, params.value))

    def run(expert: Trajectory) -> tuple[Params, Any, Any]:
        return cloning.update(nets.bind(params, unit_stats(env)), start, expert, jax.random.key(0), config)

    after, _, metrics = jax.jit(run)(expert)
    return params, after, float(metrics["policy_loss"])


def unlikelihood(params: Params) -> float:
    """−mean log π(a|s) over the steps before each episode's end, step by step."""
    nets, _ = tiny_networks(tiny_grid(), "bc")
    total = [
        float(nets.bind(params, unit_stats(nets.env)).policy(EXPERT.obs[n, t], jnp.asarray(t)).log_prob(EXPERT.action[n, t]))
        for n in range(5)
        for t in range(int(EXPERT.mask[n].sum()))
    ]
    return -float(np.mean(total))


def test_the_loss_of_cloning_is_minus_the_mean_log_probability_of_the_steps_before_the_end():
    before, _, loss = clone(1, 0)
    np.testing.assert_allclose(loss, unlikelihood(before), rtol=1e-5)


def test_what_stands_past_an_episodes_end_is_not_cloned():
    jax.tree.map(np.testing.assert_array_equal, clone(1, 0)[1:], clone(1, 2)[1:])


def test_cloning_makes_the_demonstrations_likelier_and_leaves_the_critic_alone():
    before, after, _ = clone(1, 0)
    assert unlikelihood(after) < unlikelihood(before) - 1e-3
    jax.tree.map(np.testing.assert_array_equal, before._replace(policy=None), after._replace(policy=None))


def test_each_epoch_of_cloning_is_a_step_further_and_the_last_ones_loss_is_reported():
    _, after_one, _ = clone(1, 0)
    _, _, loss = clone(2, 0)
    np.testing.assert_allclose(loss, unlikelihood(after_one), rtol=1e-5)


def test_log_std_of_a_clone_is_kept_in_its_bounds():
    env, config = one_state_env(lambda t, action: action.sum(), action_space=Box(1)), replace(WHOLE, log_std_max=-0.5)
    nets, params = tiny_networks(env, "bc", replace(TINY, ppo=replace(config, log_std_init=-0.5)))
    expert = random_trajectories(env, 0, 4)._replace(action=9.0 * jnp.ones((4, 1, 1)))  # far out: σ would rise
    start = make_optimiser(config).init((params.policy, params.value))
    after, _, _ = cloning.update(nets.bind(params, unit_stats(env)), start, expert, jax.random.key(0), config)
    assert after.policy["params"]["log_std"] == -0.5
