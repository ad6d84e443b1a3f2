"""PPO on worlds so small that the soft-optimal policy is known by hand: max E[r] + temperature × entropy."""

from dataclasses import replace
from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from aircl_jax.algorithm.rollout import rollouts
from aircl_jax.algorithm.trainer import make_trainer
from aircl_jax.demonstrations.soft_optimal import soft_value_iteration
from aircl_jax.model.networks import make_networks
from aircl_jax.settings.train_config import PPOConfig, TrainConfig
from envs import Box, Discrete, Env, Step, make_env
from tests.worlds import (
    KNOWN_REWARD,
    OPTIMISED,
    TINY,
    expected_return,
    one_state_env,
    random_trajectories,
    table_of,
    unit_stats,
)

PPO = PPOConfig(learning_rate=1e-2, num_epochs=4, minibatch_size=10_000, discount=0.5, log_std_init=-1.5)
ACTIONS = jnp.asarray([0.0, 1.0, 2.0])


def solve(env: Env, iterations=150, temperature=1.0, number=512, **changes):
    """The networks and the trained parameters of PPO alone, under the world's own reward."""
    config = TrainConfig(num_trajectories=number, hidden=(8,), temperature=temperature, ppo=replace(PPO, **changes))
    trainer, nets = make_trainer(env, KNOWN_REWARD, config), make_networks(env, KNOWN_REWARD, config)
    expert = random_trajectories(env, 0, 2)

    @partial(jax.jit, compiler_options=OPTIMISED)
    def train(key):
        state = trainer.init(key, expert)._replace(obs_stats=unit_stats(env))
        return jax.lax.scan(lambda state, _: (trainer.step(state, expert)[0], None), state, length=iterations)[0]

    return nets, train(jax.random.key(0)).params


def act(env, nets, params):
    return nets.bind(params, unit_stats(env)).policy(jnp.eye(env.obs_size)[0], jnp.asarray(0))


def probabilities(env, nets, params):
    return jnp.exp(jax.vmap(act(env, nets, params).log_prob)(jnp.arange(env.action_space.feature_size)))


def value(env, nets, params, t=0):
    return nets.bind(params, unit_stats(env)).value(jnp.eye(env.obs_size)[t], jnp.asarray(t))


@pytest.mark.parametrize("temperature", [1.0, 0.5])
def test_bandit_is_played_by_the_softmax_of_its_rewards(temperature):
    env = one_state_env(lambda t, action: ACTIONS[action], action_space=Discrete(3))
    nets, params = solve(env, temperature=temperature, learning_rate=2e-3, iterations=400)
    probability = probabilities(env, nets, params)
    np.testing.assert_allclose(probability, jax.nn.softmax(ACTIONS / temperature), atol=0.03)
    soft_optimum = temperature * jax.nn.logsumexp(ACTIONS / temperature)
    np.testing.assert_allclose(value(env, nets, params), soft_optimum, atol=0.15)


def test_a_reward_that_comes_later_is_discounted_once():
    # Action 1 gives 4 a step later, action 0 gives 1 now: Q = [1, ½·4] + ½·log 2, so π(1) = σ(2 − 1).
    def step(key, state, action):
        t, chosen = state
        reward = jnp.where(t == 0, 1.0 * (action == 0), 4.0 * chosen)
        return (t + 1, (action == 1).astype(jnp.float32)), Step(jnp.eye(3)[t + 1], reward, 0.0 * reward, 0.0 * reward)

    env = replace(
        one_state_env(lambda t, action: jnp.zeros(()), horizon=2),
        reset=lambda key: ((jnp.zeros((), jnp.int32), jnp.zeros(())), jnp.eye(3)[0]),
        step=step,
    )
    nets, params = solve(env)
    np.testing.assert_allclose(probabilities(env, nets, params)[1], jax.nn.sigmoid(1.0), atol=0.04)


@pytest.mark.parametrize(
    ("kind", "expected"),
    [
        ({"finite_horizon": True}, [1.5, 1.0]),  # nothing is worth anything after the horizon
        ({"finite_horizon": False}, [2.0, 2.0]),  # the horizon only cuts: V = 1 + ½ V
        ({"finite_horizon": False, "terminates": True}, [1.0]),  # the first step ends it
    ],
)
def test_value_of_one_reward_a_step_knows_horizon_bootstrap_and_termination(kind, expected):
    env = one_state_env(lambda t, action: jnp.ones(()), horizon=2, action_space=Discrete(1), **kind)
    if kind == {"finite_horizon": False}:
        env = constant_observation(env)
    nets, params = solve(env, iterations=200, number=64, gae_lambda=0.9)
    found = [value(env, nets, params, t if kind["finite_horizon"] else 0) for t in range(len(expected))]
    np.testing.assert_allclose(found, expected, atol=0.08)


def constant_observation(env: Env) -> Env:
    """The same world seen as one state, so that V at the cut is V at the start."""

    def step(key, state, action):
        state, result = env.step(key, state, action)
        return state, result._replace(obs=jnp.eye(env.obs_size)[0])

    return replace(env, step=step)


def test_quadratic_reward_is_answered_by_its_own_gaussian():
    # r = −(a − 0.6)² / (2 · 0.5²) has the soft-optimal policy N(0.6, 0.5).
    env = one_state_env(lambda t, action: -0.5 * jnp.sum((action - 0.6) ** 2) / 0.5**2, action_space=Box(1, -5.0, 5.0))
    nets, params = solve(env, iterations=600, learning_rate=1e-3)
    policy = act(env, nets, params)
    np.testing.assert_allclose([policy.mean()[0], policy.stddev()[0]], [0.6, 0.5], atol=0.04)


def test_actions_are_drawn_beyond_the_box_and_rewarded_at_its_edge():
    box = Box(1, -1.0, 1.0)
    env = one_state_env(lambda t, action: 20.0 * box.clip(action).sum(), action_space=box)
    nets, params = solve(env, iterations=100)
    drawn = jax.jit(lambda key: rollouts(nets.bind(params, unit_stats(env)), key, 1000))(jax.random.key(1))
    assert drawn.action.max() > 1.0  # as drawn, before the world clips it
    assert drawn.reward.mean() > 19.0
    assert drawn.reward.max() == 20.0


@pytest.mark.slow
def test_ppo_reaches_the_exact_soft_optimal_return_of_the_grid_within_two_percent():
    env = make_env("gridworld")
    table = table_of(env)
    exact = soft_value_iteration(table, table.reward, env.horizon, 1.0, forbid=False)
    config = replace(TINY, num_trajectories=280, hidden=(32, 32), ppo=PPOConfig(discount=1.0, learning_rate=2e-3))
    trainer, nets = make_trainer(env, KNOWN_REWARD, config), make_networks(env, KNOWN_REWARD, config)
    expert = random_trajectories(env, 0, 2)

    @jax.jit
    def train(key):
        state = trainer.init(key, expert)._replace(obs_stats=unit_stats(env))
        state = jax.lax.scan(lambda state, _: (trainer.step(state, expert)[0], None), state, length=400)[0]
        return rollouts(nets.bind(state.params, state.obs_stats), key, 5000)

    episodes = train(jax.random.key(0))
    soft_return = (episodes.reward - episodes.log_prob).sum(axis=1).mean()
    np.testing.assert_allclose(soft_return, exact.soft_value[0, 0], rtol=0.02)
    exact_return = expected_return(table, exact.log_policy, table.reward)
    np.testing.assert_allclose(episodes.reward.sum(axis=1).mean(), exact_return, rtol=0.02)
