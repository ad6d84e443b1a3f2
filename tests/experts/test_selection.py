"""The shipped experts' training and selection by hand: what counts, what is masked, which seed is chosen."""

from dataclasses import replace
from functools import cache
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from aircl_jax.algorithm.learners import lagrangian
from aircl_jax.algorithm.learners.lagrangian import LagrangianState, Moments, make_lagrangian, stats_of
from aircl_jax.experts.selection import (
    DRAWN,
    EpisodeMeasures,
    Sampler,
    best_expert,
    best_free,
    clean_episodes,
    measure,
    random_return,
)
from aircl_jax.model.networks import BoundNetworks
from aircl_jax.settings.lagrangian_config import LagrangianConfig
from aircl_jax.settings.train_config import PPOConfig
from aircl_jax.types import Metrics, Trajectory
from envs import Box, Env, Step
from tests.worlds import UNOPTIMISED, one_state_env, random_trajectories, tiny_grid

CONFIG = LagrangianConfig(
    iterations=10,
    num_trajectories=3,
    hidden=(4,),
    reward_scale=0.5,
    cost_discount=0.6,
    cost_budget=0.5,
    multiplier_rate=0.1,
    fall_cost=5.0,
    ppo=PPOConfig(learning_rate=0.01, num_epochs=1, minibatch_size=1000, discount=0.8, gae_lambda=0.5, value_coef=0.3),
)


def costly_once(terminates_at: int | None = None) -> Env:
    """Six steps, each paid 1, the second of which costs 1; perhaps over when the count reaches `terminates_at`."""
    world = one_state_env(lambda t, action: jnp.ones(()), horizon=6, action_space=Box(1))

    def step(key: Any, state: Any, action: Any) -> tuple[Any, Step]:
        after, result = world.step(key, state, action)
        ended = (after == terminates_at).astype(jnp.float32) if terminates_at else jnp.zeros(())
        return after, Step(result.obs, result.reward, (state == 1).astype(jnp.float32), ended)

    return replace(world, step=step)


@cache
def trained(terminates_at: int | None, step: int = 0) -> tuple[LagrangianState, LagrangianState, Metrics]:
    training = make_lagrangian(costly_once(terminates_at), CONFIG)
    first = jax.jit(training.init)(jax.random.key(0))._replace(step=jnp.asarray(step, jnp.int32))
    last, metrics = jax.jit(training.step, compiler_options=UNOPTIMISED)(first, jnp.ones(()))
    return first, last, metrics


def test_the_steps_that_put_a_body_back_on_its_feet_are_masked():
    # Two steps, the restart, two steps, the restart: four of six are the task's, and show the counts 0 and 1.
    _, last, _ = trained(2)
    assert last.moments.number == 3 * 4
    np.testing.assert_allclose(last.moments.mean, [0.5, 0.5, 0, 0, 0, 0, 0], atol=1e-6)


def test_a_fall_costs_what_the_settings_say_in_its_step_and_the_restart_costs_nothing():
    _, _, metrics = trained(2)
    assert (metrics["cost"], metrics["return"]) == (2 * 5.0, 4.0)


def test_an_episode_with_one_violation_is_not_clean():
    _, _, metrics = trained(None)
    assert (metrics["cost"], metrics["clean_share"], metrics["return"]) == (1.0, 0.0, 6.0)


def test_the_multiplier_rises_by_the_mean_cost_of_an_episode_beyond_the_budget():
    first, last, metrics = trained(None)
    assert metrics["multiplier"] == first.multiplier
    np.testing.assert_allclose(last.multiplier, first.multiplier * np.exp(0.1 * (1.0 - 0.5)), rtol=1e-6)


@pytest.mark.parametrize(("step", "left"), [(5, 0.5), (10, 0.0)])
def test_the_steps_size_falls_linearly_to_nothing_at_the_last_iteration(step, left):
    def moved(iteration: int) -> Any:
        first, last, _ = trained(None, iteration)
        return jax.tree.map(lambda old, new: new - old, first.value, last.value)

    whole = moved(0)
    assert max(np.abs(leaf).max() for leaf in jax.tree.leaves(whole)) > 0.005
    jax.tree.map(lambda a, b: np.testing.assert_allclose(a, left * b, atol=1e-6), moved(step), whole)


def test_statistics_of_what_was_met_are_its_mean_and_standard_deviation():
    state = trained(None)[0]
    assert (stats_of(state.moments).std == 1.0).all()  # before anything was met
    met = state._replace(moments=Moments(jnp.asarray(4.0), jnp.full(7, 2.0), jnp.full(7, 36.0)))
    np.testing.assert_allclose(stats_of(met.moments), np.array([[2.0] * 7, [3.0] * 7]))


def met_by_hand() -> tuple[BoundNetworks, LagrangianState, Trajectory]:
    """Two rollouts of six steps, the third step of the first masked."""
    env = costly_once()
    training = make_lagrangian(env, CONFIG)
    random = np.random.default_rng(0)
    met = random_trajectories(env, 3, 2)._replace(
        action=jnp.asarray(random.normal(size=(2, 6, 1))),
        value=jnp.asarray(random.normal(size=(2, 6))),
        mask=jnp.ones((2, 6)).at[0, 2].set(0.0),
    )
    state = jax.jit(training.init)(jax.random.key(1))
    return lagrangian.bound(training.nets, state), state, met  # nothing was seen yet: the statistics are 0 and 1


def gains(reward: np.ndarray, value: np.ndarray, mask: np.ndarray, discount: float) -> np.ndarray:
    """GAE of the first five steps of one rollout, backward; the sixth lends its value."""
    found, after = np.zeros(5), 0.0
    for t in reversed(range(5)):
        delta = reward[t] + discount * value[t + 1] * mask[t + 1] - value[t]
        after = found[t] = mask[t] * (delta + discount * 0.5 * after)
    return found


@pytest.mark.parametrize("centred", [False, True])
def test_a_batch_has_each_critics_target_and_one_advantage_of_both(centred):
    nets, state, met = met_by_hand()
    batch = lagrangian.make_batch(nets, state.cost_value, met, jnp.asarray(2.0), replace(CONFIG, centred=centred))
    mask, reward, cost, value = (np.asarray(x, np.float64) for x in (met.mask, met.reward, met.cost, met.value))
    cost_value = np.array(
        [[nets.with_params(value=state.cost_value).value(met.obs[n, t], jnp.asarray(t)) for t in range(6)] for n in range(2)]
    )
    paid = 0.5 * (reward - centred * reward[mask > 0].mean())
    gain = np.array([gains(paid[n], value[n], mask[n], 0.8) for n in range(2)])
    cost_gain = np.array([gains(cost[n], cost_value[n], mask[n], 0.6) for n in range(2)])
    kept = mask[:, :5] > 0
    a, b = gain - gain[kept].mean(), cost_gain - cost_gain[kept].mean()
    advantage = (a / a[kept].std() - 2.0 * b) / 3.0
    found = np.stack([np.asarray(x).reshape(2, 5) for x in (batch.target, batch.cost_target, batch.advantage)])
    expected = np.stack([value[:, :5] + gain, cost_value[:, :5] + cost_gain, advantage])
    np.testing.assert_allclose(found[:, kept], expected[:, kept], rtol=1e-4, atol=1e-5)
    np.testing.assert_array_equal(np.asarray(batch.mask).reshape(2, 5), mask[:, :5])


def test_the_loss_of_an_experts_training_is_over_unmasked_steps_with_both_critics():
    nets, state, met = met_by_hand()
    batch = lagrangian.make_batch(nets, state.cost_value, met, jnp.asarray(2.0), CONFIG)
    total, metrics = lagrangian.loss((state.policy, state.value, state.cost_value), nets, batch, CONFIG.ppo)
    surrogate, errors, apart = [], [], []
    for i in np.flatnonzero(batch.mask):
        seen = (batch.obs[i], batch.t[i])
        log_ratio = float(nets.policy(*seen).log_prob(batch.action[i])) - float(batch.log_prob[i])
        ratio, gain = np.exp(log_ratio), float(batch.advantage[i])
        surrogate.append(min(ratio * gain, np.clip(ratio, 0.9, 1.1) * gain))
        wrong = float(nets.value(*seen)) - float(batch.target[i])
        cost_wrong = float(nets.with_params(value=state.cost_value).value(*seen)) - float(batch.cost_target[i])
        errors.append(wrong**2 + cost_wrong**2)
        apart.append(-log_ratio)
    expected = [np.mean(errors) / 2, np.mean(apart), -np.mean(surrogate) + 0.3 * np.mean(errors) / 2]
    np.testing.assert_allclose([metrics["value_loss"], metrics["approx_kl"], total], expected, rtol=1e-4)


# Three episodes of three steps: clean; one violation; one violation past its end.
EPISODES = random_trajectories(tiny_grid(horizon=3, goal=[1, 2]), 0, 3)._replace(
    reward=jnp.asarray([[1.0, 2.0, 3.0], [10.0, 10.0, 10.0], [4.0, 90.0, 90.0]]),
    cost=jnp.asarray([[0.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 1.0, 1.0]]),
    mask=jnp.asarray([[1.0, 1.0, 1.0], [1.0, 1.0, 1.0], [1.0, 0.0, 0.0]]),
)


def test_a_seed_is_judged_by_all_its_episodes_and_by_the_clean_ones():
    found = measure(EPISODES)
    expected = EpisodeMeasures(mean=40 / 3, std=float(np.std([6, 30, 4])), clean_share=2 / 3, clean_return=5.0, cost=1 / 3)
    np.testing.assert_allclose(found, expected, rtol=1e-6)


def test_the_expert_is_chosen_by_its_clean_episodes_and_the_unconstrained_one_by_all():
    one = EpisodeMeasures(mean=9.0, std=1.0, clean_share=0.6, clean_return=2.0, cost=0.0)
    other = EpisodeMeasures(mean=5.0, std=1.0, clean_share=0.6, clean_return=3.0, cost=0.0)
    assert best_expert([one, other]) == 1
    assert best_free([other._replace(clean_share=0.1), one._replace(clean_share=0.1)]) == 1


class Repeating(Sampler):
    """Draws the three episodes above again and again."""

    def __init__(self) -> None:
        pass

    def __call__(self, state: LagrangianState, key: Any, number: int) -> Trajectory:
        return jax.tree.map(lambda leaf: leaf[jnp.arange(number) % 3], EPISODES)


def test_demonstrations_are_the_episodes_without_a_single_violation_before_their_end():
    kept, share = clean_episodes(Repeating(), trained(None)[0], jax.random.key(0), 40)
    np.testing.assert_array_equal(kept.reward[:, 0], np.resize([1.0, 4.0], 40))
    assert share == 43 / DRAWN


def test_random_actions_are_judged_by_the_whole_return_and_all_violating_steps():
    assert random_return(costly_once(), jax.random.key(0))[:3] == (6.0, 0.0, 0.0)
