"""What each part of a fused step is given, in the order of Algorithm 1: recorded at the parts' doors."""

import sys
from dataclasses import replace
from functools import cache, partial
from types import SimpleNamespace
from typing import Any

import chex
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from aircl_jax.algorithm import adversary, scoring
from aircl_jax.algorithm.learners import ppo
from aircl_jax.algorithm.policy_reward import policy_reward
from aircl_jax.algorithm.sampler import SAMPLERS
from aircl_jax.algorithm.terms.logits import Batches
from aircl_jax.algorithm.trainer import make_trainer
from aircl_jax.methods import METHODS
from aircl_jax.model.feasibility import calibrate, log_feasibility
from aircl_jax.model.networks import BoundNetworks, make_networks
from aircl_jax.settings.train_config import AdversaryConfig
from aircl_jax.types import ObsStats, Params, Thresholds, Trajectory
from tests.worlds import TINY, random_trajectories, tiny_grid

CONFIG = replace(TINY, adversary=AdversaryConfig(num_steps=1, replay_rate=1.0))
METHOD = METHODS["aircl_corrected"]  # every part takes its turn
POOL = CONFIG.num_trajectories * CONFIG.pool_factor


same_to_rounding = partial(chex.assert_trees_all_close, rtol=1e-4, atol=1e-6)


@cache
def recorded() -> SimpleNamespace:
    """One step whose policy episodes end at various steps, whose adversary relearns, and which is recorded."""
    env, seen = tiny_grid(), SimpleNamespace(keys={})
    seen.nets = make_networks(env, METHOD, CONFIG)
    seen.expert, seen.pool = random_trajectories(env, 0, CONFIG.num_demonstrations), random_trajectories(env, 1, POOL)
    trainer = make_trainer(env, METHOD, CONFIG)
    state = jax.jit(trainer.init)(jax.random.key(0), seen.expert)
    random = np.random.default_rng(1)
    params = jax.tree.map(lambda leaf: jnp.asarray(random.normal(size=leaf.shape), jnp.float32), state.params)
    seen.first = state._replace(
        params=params, obs_stats=ObsStats(jnp.zeros(9), jnp.ones(9)), replay=random_trajectories(env, 2, 3)
    )

    def roll(nets: BoundNetworks, key: Any, number: int) -> Trajectory:
        assert number == POOL
        seen.keys["rollout"] = key
        return seen.pool

    def least_feasible(log_delta: Any, number: int, key: Any) -> Any:
        seen.log_delta, seen.keys["sampler"] = log_delta, key
        return jnp.argsort(log_delta)[:number]

    def relearn(nets: BoundNetworks, opt: Any, batches: Batches, key: Any, of_states: Any) -> tuple:
        assert of_states is None  # the row has no reward of states
        params = nets.params
        seen.judged_by, seen.batches, seen.keys["adversary"] = params, batches, key
        learned = jax.tree.map(lambda leaf: -1.5 * leaf, (params.reward, params.feasibility))
        seen.left = params._replace(reward=learned[0], feasibility=learned[1])
        return seen.left, opt, {}

    def act(nets: BoundNetworks, opt: Any, policy: Any, reward: Any, bonus: Any, key: Any, config: Any) -> tuple:
        params = nets.params
        seen.acting, seen.played, seen.reward, seen.bonus, seen.keys["policy"] = params, policy, reward, bonus, key
        return params._replace(policy=jax.tree.map(lambda leaf: leaf + 1.0, params.policy)), opt, {}

    def refresh(replay: Trajectory, policy: Trajectory, key: Any, rate: float) -> Trajectory:
        seen.keys["replay"] = key
        return policy

    doors = sys.modules[make_trainer.__module__]
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(scoring, "rollouts", roll)
        patch.setattr(doors, "refresh", refresh)
        patch.setattr(adversary, "update", relearn)
        patch.setattr(ppo, "update", act)
        patch.setitem(SAMPLERS, "resample", least_feasible)
        seen.last, seen.metrics = trainer.step(seen.first, seen.expert)
    return seen


def log_delta(params: Params, trajectories: Trajectory) -> Any:
    """log δ̄ of each trajectory under the thresholds of these parameters."""
    nets, stats = recorded().nets, recorded().first.obs_stats
    scores = jax.vmap(nets.bind(params, stats).scores)(trajectories, trajectories.log_prob)
    return log_feasibility(METHOD, CONFIG.coefficients, scores)


def thresholds(params: Params) -> Thresholds:
    """What D_E asks for under these parameters."""
    nets, expert = recorded().nets, recorded().expert
    scores = jax.vmap(nets.bind(params, recorded().first.obs_stats).scores)(expert, expert.log_prob)
    return calibrate(CONFIG.coefficients, scores)


def paid(params: Params) -> tuple[Any, Any]:
    seen = recorded()
    return policy_reward(seen.nets.bind(params, seen.first.obs_stats), seen.expert, seen.pool)


def test_ppo_is_paid_by_the_reward_and_the_constraint_that_the_adversary_has_left():
    seen = recorded()
    same_to_rounding((seen.reward, seen.bonus), paid(seen.left._replace(thresholds=thresholds(seen.left))))
    assert np.abs(np.asarray(seen.reward - paid(seen.first.params)[0])).max() > 0.1


def test_samples_are_drawn_from_the_whole_pool_by_the_feasibility_before_the_update():
    seen = recorded()
    same_to_rounding(seen.log_delta, log_delta(seen.first.params, seen.pool))
    order = np.argsort(np.asarray(seen.log_delta), kind="stable")[: CONFIG.num_trajectories]
    np.testing.assert_array_equal(seen.batches.sampled.reward, np.asarray(seen.pool.reward)[order])


def test_the_adversary_sees_the_experts_the_first_half_of_the_round_and_the_replay_of_the_round_before():
    seen = recorded()
    np.testing.assert_array_equal(seen.batches.expert.reward, seen.expert.reward)
    np.testing.assert_array_equal(seen.batches.policy.reward, seen.pool.reward[:3])
    np.testing.assert_array_equal(seen.batches.replay.reward, seen.first.replay.reward)
    same_to_rounding(seen.judged_by, seen.first.params)


def test_the_replay_is_refreshed_with_what_the_adversary_has_judged():
    np.testing.assert_array_equal(recorded().last.replay.reward, recorded().pool.reward[:3])


def test_ppo_runs_over_the_whole_pool_with_the_present_policy():
    seen = recorded()
    np.testing.assert_array_equal(seen.played.reward, seen.pool.reward)
    same_to_rounding((seen.acting.policy, seen.acting.value), (seen.first.params.policy, seen.first.params.value))


def test_thresholds_are_calibrated_after_the_adversarys_update_and_kept():
    seen = recorded()
    same_to_rounding(seen.last.params.thresholds, thresholds(seen.left))
    assert abs(seen.last.params.thresholds.sequence - thresholds(seen.first.params).sequence) > 0.01


def test_feasibility_of_a_step_is_the_policys_before_the_update_and_the_experts_after_it():
    seen = recorded()
    after = seen.left._replace(thresholds=thresholds(seen.left))
    found = [seen.metrics["feasibility_policy"], seen.metrics["feasibility_expert"]]
    expected = [np.exp(log_delta(params, one)).mean() for params, one in ((seen.first.params, seen.pool), (after, seen.expert))]
    np.testing.assert_allclose(found, expected, rtol=1e-5)


def test_what_the_policys_update_returns_is_the_next_state():
    seen = recorded()
    jax.tree.map(lambda new, old: np.testing.assert_array_equal(new, old + 1.0), seen.last.params.policy, seen.acting.policy)
    same_to_rounding((seen.last.params.reward, seen.last.params.feasibility), (seen.left.reward, seen.left.feasibility))


def test_no_key_is_used_twice():
    seen = recorded()
    keys = [*seen.keys.values(), seen.first.key, seen.last.key]
    assert len({tuple(np.asarray(jax.random.key_data(key)).tolist()) for key in keys}) == 7
