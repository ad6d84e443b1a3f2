from dataclasses import replace
from functools import partial
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jax.tree_util import Partial

from aircl_jax.algorithm.learners.scale_free import (
    TRUE,
    Spread,
    Task,
    bound,
    falls,
    make_learner,
    normalised,
    practise,
)
from aircl_jax.algorithm.learners.scale_free_update import Trained, make_batch, make_optimiser, num_minibatches
from aircl_jax.settings.learner_config import LearnerConfig, learner_config
from aircl_jax.settings.train_config import PPOConfig
from envs import Box, Step, make_env
from envs.robots.practice_worlds import ending
from tests.algorithm.learners.test_lagrangian import limited_world
from tests.worlds import one_state_env

CONFIG = LearnerConfig(
    iterations=200,
    num_trajectories=16,
    hidden=(4,),
    cost_discount=0.5,
    ppo=PPOConfig(learning_rate=1e-2, clip_eps=0.2, minibatch_size=48, discount=0.5, gae_lambda=0.9),
)
ONES = jnp.ones((1, 4))


def counting_world(horizon=4):
    """Its observation is the number of steps since the reset; r = a."""
    world = one_state_env(lambda t, action: action.sum(), horizon=horizon, action_space=Box(1), finite_horizon=False)
    return replace(
        world,
        obs_size=1,
        reset=lambda key: (jnp.zeros(()), jnp.zeros(1)),
        step=lambda key, state, action: (
            state + 1,
            Step((state + 1)[None], action.sum(), (action > 0.5).any().astype(jnp.float32), jnp.zeros(())),
        ),
    )


def scaled(factor):
    return Partial(partial(_scaled, factor))


def _scaled(factor, trajectory):
    return factor * trajectory.reward, trajectory.cost


def task(objective=TRUE, constrained=1.0):
    return Task(objective, jnp.asarray(constrained))


def started(config=CONFIG, steps=0, objective=TRUE, constrained=1.0):
    learner = make_learner(counting_world(), config)
    state = jax.jit(learner.init)(jax.random.key(3))
    step = jax.jit(learner.step)
    metrics = {}
    for _ in range(steps):
        state, metrics = step(state, task(objective, constrained))
    return learner, state, metrics


@pytest.mark.parametrize("factor", [0.25, 8.0])
def test_the_unit_of_the_reward_changes_no_bit_of_what_is_learned(factor):
    _, plain, _ = started(steps=3)
    _, other, _ = started(steps=3, objective=scaled(factor))
    for one, two in zip(jax.tree.leaves(plain.trained), jax.tree.leaves(other.trained), strict=True):
        np.testing.assert_array_equal(one, two)


def test_the_entropy_has_the_unit_of_the_reward():
    warm, hot = (replace(CONFIG, temperature=temperature) for temperature in (0.5, 2.0))
    _, plain, _ = started(warm, steps=2)
    _, other, _ = started(hot, steps=2, objective=scaled(4.0))
    np.testing.assert_array_equal(*(jax.tree.leaves(state.trained.policy)[0] for state in (plain, other)))
    _, cold, _ = started(steps=2)
    assert (jax.tree.leaves(plain.trained.policy)[0] != jax.tree.leaves(cold.trained.policy)[0]).any()


def test_the_spread_is_the_mean_over_iterations_of_the_centred_square():
    config = replace(CONFIG, reward_spread=0.1, alive_bonus=2.0)
    mask = jnp.asarray([[1.0, 1.0, 0.0]])
    first, spread = normalised(jnp.asarray([[1.0, 3.0, 90.0]]), mask, Spread(jnp.zeros(()), jnp.zeros(())), config)
    np.testing.assert_allclose(first[0, :2], [0.1 * (-1 + 2), 0.1 * (1 + 2)], rtol=1e-6)  # ρ² = 1
    second, spread = normalised(jnp.asarray([[0.0, 6.0, 0.0]]), mask, spread, config)
    np.testing.assert_allclose(spread.mean_square, (1 + 9) / 2, rtol=1e-6)
    np.testing.assert_allclose(second[0, :2], [0.1 * (-3 / 5**0.5 + 2), 0.1 * (3 / 5**0.5 + 2)], rtol=1e-6)


def test_a_constant_reward_is_not_blown_up():
    scaled_reward, _ = normalised(ONES, ONES, Spread(jnp.zeros(()), jnp.zeros(())), CONFIG)
    np.testing.assert_array_equal(scaled_reward, jnp.zeros((1, 4)))


def test_each_network_is_clipped_by_its_own_norm():
    optimiser: Any = make_optimiser(CONFIG, horizon=4)
    params = Trained(jnp.zeros(2), jnp.zeros(2), jnp.zeros(2))
    small = jnp.asarray([0.1, 0.2])
    grads = Trained(small, 1e6 * small, 1e3 * small)
    state = optimiser.init(params)
    alone, _ = optimiser.update(Trained(small, small, small), state)
    beside, _ = optimiser.update(grads, state)
    np.testing.assert_array_equal(beside.policy, alone.policy)


def test_the_rate_is_zero_after_the_last_update():
    config = replace(CONFIG, iterations=2)
    optimiser: Any = make_optimiser(config, horizon=4)
    updates = 2 * config.ppo.num_epochs * num_minibatches(config, horizon=4)
    params = Trained(jnp.zeros(1), jnp.zeros(1), jnp.zeros(1))
    grads, state = jax.tree.map(jnp.ones_like, params), optimiser.init(params)
    sizes = []
    for _ in range(updates + 1):
        change, state = optimiser.update(grads, state)
        sizes.append(float(abs(change.policy[0])))
    assert sizes[0] > sizes[updates // 2] > sizes[updates - 1] > sizes[updates] == 0.0
    np.testing.assert_allclose(sizes[updates // 2], sizes[0] / 2, rtol=1e-3)


def again(learner, state, config):
    return practise(bound(learner.nets, state), state.ends, state.step > 0, jax.random.key(1), counting_world(), config)


@pytest.mark.parametrize(("continued", "first"), [(0.0, 0.0), (1.0, 4.0)])
def test_rollouts_go_on_from_where_the_last_ones_ended(continued, first):
    config = replace(CONFIG, continued=continued)
    learner, state, _ = started(config, steps=1)
    trajectories, ends = again(learner, state, config)
    np.testing.assert_array_equal(trajectories.obs[:, 0, 0], first)
    np.testing.assert_array_equal(ends[1][:, 0], first + 4)


def test_the_first_rollouts_begin_at_a_reset():
    config = replace(CONFIG, continued=1.0)
    learner, state, _ = started(config)
    state = state._replace(ends=jax.tree.map(lambda leaf: leaf + 100.0, state.ends))
    trajectories, _ = again(learner, state, config)
    np.testing.assert_array_equal(trajectories.obs[:, 0, 0], 0.0)


def test_a_fall_is_the_step_before_one_that_does_not_count():
    np.testing.assert_array_equal(falls(jnp.asarray([[1.0, 1.0, 0.0, 1.0, 1.0]])), [[0.0, 1.0, 0.0, 0.0, 0.0]])


def test_both_critics_bootstrap_from_the_last_observation():
    learner, state, _ = started(steps=1)
    acting = bound(learner.nets, state)
    critic = state.trained.cost_value
    trajectories, ends = again(learner, state, CONFIG)
    zeros = jnp.zeros_like(trajectories.mask)
    batch = make_batch(acting, critic, trajectories, ends[1], zeros, zeros, jnp.zeros(()), CONFIG)
    target, cost_target = (leaf.reshape(zeros.shape) for leaf in (batch.target, batch.cost_target))
    after = jax.vmap(lambda obs: acting.value(obs, jnp.asarray(4)))(ends[1])
    cost_after = jax.vmap(lambda obs: acting.with_params(value=critic).value(obs, jnp.asarray(4)))(ends[1])
    np.testing.assert_allclose(target[:, -1], CONFIG.ppo.discount * after, atol=1e-6)
    np.testing.assert_allclose(cost_target[:, -1], CONFIG.cost_discount * cost_after, atol=1e-6)
    assert not np.allclose(after, cost_after)


def test_the_constraint_is_kept_until_its_release_and_then_dropped():
    config = replace(CONFIG, iterations=4, release=0.5)
    assert [float(started(config, steps, constrained=0.0)[2]["multiplier"] > 0) for steps in (1, 2, 3)] == [1.0, 1.0, 0.0]
    assert float(started(config, 3, constrained=1.0)[2]["multiplier"]) > 0


def test_unconstrained_seeds_have_a_lower_bound_of_their_own_on_the_noise():
    config = replace(CONFIG, released_log_std_max=-2.0)
    free, held = (started(config, 1, constrained=flag)[1].trained.policy["params"]["log_std"] for flag in (0.0, 1.0))
    assert (free <= -2.0).all()
    assert (held > -1.0).all()


@pytest.mark.parametrize("factor", [1 / 3, 3.0])
def test_learns_to_stay_below_the_limit_whatever_the_unit(factor):
    world = replace(limited_world(), finite_horizon=False)
    learner = make_learner(world, replace(CONFIG, cost_budget=0.3))
    state = jax.jit(learner.init)(jax.random.key(0))
    state, metrics = jax.jit(
        lambda state: jax.lax.scan(lambda state, _: learner.step(state, task(scaled(factor))), state, length=200)
    )(state)
    assert metrics["cost"][-20:].mean() < 1.0  # of 6 steps; an unconstrained policy violates in all
    assert metrics["return"][-20:].mean() / factor > 2.0  # of 3 at the limit


def test_a_world_that_ends_at_its_horizon_is_refused():
    with pytest.raises(ValueError, match="ends at its horizon"):
        make_learner(limited_world(), CONFIG)


def test_motors_stop_at_each_seeds_own_limits_while_the_cost_counts_and_asking_for_more_costs():
    learner = make_learner(counting_world(), CONFIG)
    state = jax.jit(learner.init)(jax.random.key(3))
    low, high = jnp.asarray([-0.01]), jnp.asarray([0.02])
    returns = {}
    for constrained in (1.0, 0.0):
        metrics = jax.jit(learner.step)(state, Task(TRUE, jnp.asarray(constrained), (low, high)))[1]
        returns[constrained] = float(metrics["return"])
        asked = float(jax.jit(learner.step)(state, Task(TRUE, jnp.asarray(constrained)))[1]["cost"])
        assert (metrics["cost"] > asked) == (constrained > 0)  # nearly every draw is beyond them; above .5 in any case
    assert -0.01 * 4 <= returns[1.0] <= 0.02 * 4
    assert not -0.01 * 4 <= returns[0.0] <= 0.02 * 4


def test_a_body_that_falls_gets_up_within_the_rollout():
    world = replace(counting_world(horizon=7), fallen=lambda state: state >= 3)
    learner = make_learner(world, replace(CONFIG, restart=True, continued=0.0))
    state = jax.jit(learner.init)(jax.random.key(3))
    assert float(jax.jit(learner.step)(state, task())[1]["strays"]) == 1.0  # down after 3 steps, up after 4
    still = make_learner(counting_world(horizon=7), replace(CONFIG, restart=True, continued=0.0))
    assert float(jax.jit(still.step)(still.init(jax.random.key(3)), task())[1]["strays"]) == 0.0


def test_robots_share_one_setting_and_those_that_can_fall_another():
    swimmer, walker, pendulum = (make_env(name) for name in ("swimmer", "walker", "pendulum"))
    assert learner_config(swimmer) == learner_config(make_env("halfcheetah")) == LearnerConfig()
    assert learner_config(walker) == learner_config(make_env("hopper"))
    of_states = learner_config(pendulum)
    assert (of_states.cost_discount, learner_config(walker).cost_discount) == (0.99, 0.0)
    assert (of_states.cost_budget, learner_config(walker).cost_budget) == (1.0, 0.01)
    assert of_states.num_trajectories * pendulum.horizon == learner_config(walker).num_trajectories * walker.horizon
    for world, longer in ((swimmer, 2.5), (walker, 1.0)):
        held, free = learner_config(world), learner_config(world, constrained=False)
        assert (free.iterations, free.release, held.release) == (longer * held.iterations, 0.3, 0.0)


@pytest.mark.parametrize("name", ["walker", "hopper", "pendulum"])
def test_a_body_has_fallen_where_its_own_early_end_would_stop_it(name):
    world, with_end = make_env(name), make_env(name, terminate=True)
    state, _ = world.reset(jax.random.key(0))
    ended = []
    with_its, with_ours = jax.jit(with_end.step), jax.jit(ending(world).step)
    for key in jax.random.split(jax.random.key(1), 150):
        push = jax.random.uniform(key, world.action_space.shape, minval=-1.0)
        later, result = with_its(key, state, push)
        again, ours = with_ours(key, state, push)
        assert float(result.terminated) == float(ours.terminated)
        np.testing.assert_array_equal(jax.tree.leaves(later)[0], jax.tree.leaves(again)[0])
        ended.append(float(result.terminated))
        state = later
    assert set(ended) == {0.0, 1.0}
    assert make_env("swimmer").fallen is None
