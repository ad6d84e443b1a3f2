from dataclasses import replace
from importlib.resources import files

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jaxtyping import PRNGKeyArray

from aircl_jax.algorithm.learners.lagrangian import (
    LagrangianState,
    Moments,
    bound,
    lagrangian_advantage,
    make_lagrangian,
    next_multiplier,
    observe,
    stats_of,
)
from aircl_jax.algorithm.rollout import rollouts
from aircl_jax.demonstrations.sources import load_shipped
from aircl_jax.experts.selection import EpisodeMeasures, Sampler, altered, best_expert, best_free, measure, reference_set
from aircl_jax.settings.lagrangian_config import LagrangianConfig
from aircl_jax.settings.train_config import PPOConfig
from aircl_jax.types import Trajectory
from envs import Box, Step, make_env
from envs.robots.practice_worlds import restarting, weakened
from tests.worlds import UNOPTIMISED, one_state_env, random_trajectories, tiny_grid

SHIPPED = sorted(
    path.name.removesuffix("_reference.npz")
    for path in (files("envs") / "demonstrations").iterdir()
    if path.name.endswith("_reference.npz")
)

CONFIG = LagrangianConfig(
    iterations=150,
    num_trajectories=32,
    hidden=(4,),
    reward_scale=1.0,
    cost_discount=0.5,
    multiplier_rate=0.1,
    ppo=PPOConfig(learning_rate=1e-2, clip_eps=0.2, minibatch_size=128, discount=0.5),
)


def limited_world(limit=0.5, horizon=6, terminates_at=None):
    """r = a, c = [a > limit]: the best clean Gaussian has its mean a few σ below the limit."""
    world = one_state_env(lambda t, action: action.sum(), horizon=horizon, action_space=Box(1))

    def step(key, state, action):
        state, result = world.step(key, state, jnp.clip(action, -1.0, 1.0))
        ended = jnp.zeros(()) if terminates_at is None else (state == terminates_at).astype(jnp.float32)
        return state, Step(result.obs, result.reward, (action > limit).any().astype(jnp.float32), ended)

    return replace(world, step=step)


def multiplier(value, cost, **changes):
    config = replace(CONFIG, cost_budget=0.1, multiplier_rate=0.5, multiplier_max=20.0, **changes)
    return float(next_multiplier(jnp.asarray(value), jnp.asarray(cost), config))


def test_multiplier_rises_in_proportion_to_the_excess_and_to_itself():
    np.testing.assert_allclose(multiplier(4.0, 0.5), 4.0 * np.exp(0.5 * 0.4), rtol=1e-6)


def test_multiplier_has_a_largest_step_and_a_largest_value():
    assert multiplier(4.0, 1.0 + 0.1) == multiplier(4.0, 500.0)
    assert multiplier(19.0, 500.0) == 20.0


def test_multiplier_falls_while_the_cost_is_within_the_budget():
    np.testing.assert_allclose(multiplier(4.0, 0.0), 4.0 * np.exp(-0.05), rtol=1e-6)


def test_advantage_without_a_multiplier_is_the_standardised_gain():
    gain, mask = jnp.asarray([[1.0, 3.0, 90.0]]), jnp.asarray([[1.0, 1.0, 0.0]])
    found = lagrangian_advantage(gain, jnp.ones((1, 3)), mask, jnp.zeros(()))
    np.testing.assert_allclose(found[0, :2], [-1.0, 1.0], rtol=1e-6)


def test_advantage_weighs_the_centred_cost_in_its_own_unit():
    # gain (−1, 1) after standardising, cost (−½, ½) after centring: (∓1 ± 3·½) / 4
    gain, cost = jnp.asarray([[1.0, 3.0]]), jnp.asarray([[0.0, 1.0]])
    found = lagrangian_advantage(gain, cost, jnp.ones((1, 2)), jnp.asarray(3.0))
    np.testing.assert_allclose(found, [[0.125, -0.125]], rtol=1e-6)


def test_moments_of_two_batches_are_those_of_all_unmasked_observations():
    world = tiny_grid()
    first, second = (random_trajectories(world, seed, number) for seed, number in ((0, 3), (1, 5)))
    zeros = jnp.zeros(world.obs_size)
    moments = observe(observe(Moments(jnp.zeros(()), zeros, zeros), first), second)
    seen = np.concatenate([np.asarray(one.obs)[np.asarray(one.mask) == 1] for one in (first, second)])
    np.testing.assert_allclose(moments.mean, seen.mean(axis=0), atol=1e-6)
    np.testing.assert_allclose(moments.square / moments.number, seen.var(axis=0), atol=1e-6)


def test_a_world_that_ends_begins_again_after_one_masked_step():
    world = limited_world(terminates_at=2)
    training = make_lagrangian(world, CONFIG)
    state = jax.jit(training.init)(jax.random.key(0))
    again = restarting(world, fall_cost=5.0)
    carried, _ = again.reset(jax.random.key(1))
    counts, costs, counted = [], [], []
    for t in range(6):
        carried, result = again.step(jax.random.key(t), carried, jnp.zeros(1))
        counts.append(int(carried[0]))
        costs.append(float(result.cost))
        counted.append(float(result.counts))
        assert result.terminated == 0.0
    assert counts == [1, 2, 0, 1, 2, 0]
    assert costs == [0.0, 5.0, 0.0, 0.0, 5.0, 0.0]  # the end costs
    assert counted == [1.0, 1.0, 0.0, 1.0, 1.0, 0.0]  # the step after it is none of the task's
    assert np.isfinite(stats_of(state.moments).std).all()


def test_altered_multiplies_mean_and_noise():
    world = limited_world()
    training = make_lagrangian(world, CONFIG)
    state = jax.jit(training.init)(jax.random.key(0))
    changed = altered(state.policy, mean=1.5, noise=2.0)

    def act(policy):
        return bound(training.nets, state._replace(policy=policy)).policy(jnp.ones(world.obs_size), jnp.asarray(0))

    np.testing.assert_allclose(act(changed).mean(), 1.5 * act(state.policy).mean(), rtol=1e-5)
    np.testing.assert_allclose(act(changed).stddev(), 2.0 * act(state.policy).stddev(), rtol=1e-5)


def test_best_expert_is_the_richest_of_those_that_are_clean_in_half():
    judged = [
        EpisodeMeasures(mean=r, std=1.0, clean_share=s, clean_return=r, cost=0.0) for r, s in ((9, 0.4), (5, 0.6), (7, 0.5))
    ]
    assert best_expert(judged) == 2
    with pytest.raises(ValueError, match=r"no seed is clean"):
        best_expert(judged[:1])


def test_the_unconstrained_expert_is_the_richest_of_those_that_violate():
    judged = [
        EpisodeMeasures(mean=r, std=1.0, clean_share=s, clean_return=r, cost=0.0) for r, s in ((9, 0.9), (5, 0.1), (7, 0.4))
    ]
    assert best_free(judged) == 2
    assert best_free(judged[:1]) == 0


class Scripted(Sampler):
    """Episodes of which a share violates: all of one state's, some of every other's."""

    def __init__(self, always: LagrangianState, share: float) -> None:
        self.always, self.share = always, share

    def __call__(self, state: LagrangianState, key: PRNGKeyArray, number: int) -> Trajectory:
        episodes = random_trajectories(tiny_grid(), 0, number)
        share = 1.0 if state.key is self.always.key else self.share
        return episodes._replace(cost=episodes.mask * (jnp.arange(number) < share * number)[:, None])


@pytest.mark.parametrize(("violating", "groups"), [(0.5, 7), (0.0, 8)])
def test_a_reference_set_of_rare_violations_has_more_of_the_unconstrained_expert(violating, groups):
    expert, free = (make_lagrangian(limited_world(), CONFIG).init(jax.random.key(seed)) for seed in (0, 1))
    whole, judged = reference_set(Scripted(free, violating), expert, free, jax.random.key(0))
    assert len(judged) == groups
    assert 0.2 <= measure(whole).clean_share <= 0.8


def test_judge_counts_unmasked_steps_only():
    episodes = random_trajectories(tiny_grid(), 0, 4)
    episodes = episodes._replace(cost=1.0 - episodes.mask)
    assert measure(episodes).clean_share == 1.0
    expected = np.mean([(r * m).sum() for r, m in zip(np.asarray(episodes.reward), np.asarray(episodes.mask), strict=True)])
    np.testing.assert_allclose(measure(episodes).mean, expected, rtol=1e-5)


def test_an_unconstrained_seed_keeps_the_constraint_until_it_is_released():
    world = limited_world()
    training = make_lagrangian(world, replace(CONFIG, release=0.5, num_trajectories=2, ppo=replace(CONFIG.ppo, num_epochs=1)))
    state = jax.jit(training.init)(jax.random.key(0))
    step = jax.jit(training.step, compiler_options=UNOPTIMISED)
    for iteration, expected in ((74, 1.0), (75, 0.0)):
        _, metrics = step(state._replace(step=jnp.asarray(iteration)), jnp.zeros(()))
        assert metrics["multiplier"] == expected


@pytest.mark.slow
def test_the_best_gaussian_under_a_limit_stays_a_few_sigma_below_it_and_without_it_goes_beyond():
    world = limited_world()
    training = make_lagrangian(world, CONFIG)

    @jax.jit
    @jax.vmap
    def train(key, constrained):
        start = training.init(key)
        state, _ = jax.lax.scan(lambda state, _: training.step(state, constrained), start, length=CONFIG.iterations)
        return rollouts(bound(training.nets, state), key, 500, world)

    episodes = train(jax.random.split(jax.random.key(0)), jnp.asarray([1.0, 0.0]))
    held, free = episodes.action.mean(axis=(1, 2, 3))
    assert 0.1 < held < 0.5 - 2 * episodes.action[0].std()
    assert free > 0.8
    held, free = episodes.cost.mean(axis=(1, 2))
    assert held < 0.02
    assert free > 0.5


def test_weakened_motors_stop_at_the_limit_and_to_ask_for_more_costs():
    world = limited_world(limit=2.0)
    weak = weakened(world, jnp.asarray(-0.3), jnp.asarray(0.3))
    state, _ = world.reset(jax.random.key(0))
    for asked, given, cost in [(0.2, 0.2, 0.0), (0.3, 0.3, 0.0), (0.9, 0.3, 1.0), (-0.9, -0.3, 1.0)]:
        _, result = weak.step(jax.random.key(0), state, jnp.asarray([asked]))
        np.testing.assert_allclose((result.reward, result.cost), (given, cost), rtol=1e-6)


@pytest.mark.parametrize("name", SHIPPED)
def test_shipped_demonstrations_are_clean_and_the_reference_set_has_both_labels(name):
    env, constraint = name.split("_")
    world = make_env(env, constraint=constraint)
    assert world.shipped_demonstrations == name
    expert, reference = load_shipped(name, world), load_shipped(f"{name}_reference", world)
    assert len(expert.obs) == 50
    assert expert.cost.sum() == 0.0
    assert 0.2 <= (reference.cost.sum(axis=1) == 0).mean() <= 0.8
    first = {leaf.tobytes() for leaf in np.asarray(expert.obs[:, 0])}
    assert first.isdisjoint(leaf.tobytes() for leaf in np.asarray(reference.obs[:, 0]))


@pytest.mark.parametrize("name", [name for name in SHIPPED if name.endswith("_torque")])
def test_shipped_costs_are_those_of_the_shipped_actions(name):
    env, constraint = name.split("_")
    world = make_env(env, constraint=constraint)
    for source in (name, f"{name}_reference"):
        episodes = load_shipped(source, world)
        np.testing.assert_array_equal(episodes.cost, (np.abs(episodes.action) > 0.5).any(axis=-1))
