"""A policy that practises inside another loop: what is paid, and when the constraint counts."""

from dataclasses import replace
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from aircl_jax.algorithm.learners import practice as practising
from aircl_jax.algorithm.learners.practice import Learning, Practice
from aircl_jax.algorithm.learners.scale_free_update import make_optimiser
from aircl_jax.methods import get_method
from aircl_jax.model.networks import make_networks
from aircl_jax.settings.train_config import TrainConfig
from tests.algorithm.learners.test_scale_free import CONFIG, counting_world
from tests.worlds import unit_stats

WORLD = counting_world()


def begun(**changed):
    config = replace(CONFIG, **changed)
    learning = Learning(config, make_optimiser(config, WORLD.horizon))
    method = get_method("aircl_contrast", of_box=True)
    nets = make_networks(WORLD, method, TrainConfig(hidden=config.hidden, ppo=config.ppo))
    params = nets.init(jax.random.key(0))
    practice = practising.begin(learning, params, nets.init(jax.random.key(1)).value, WORLD, jax.random.key(2))
    return learning, nets.bind(params, unit_stats(WORLD)), practice


def learned(bound: float = 1.0, mask: Any = None, cost: Any = 0.0, **changed: Any) -> Practice:
    learning, nets, practice = begun(**changed)
    drawn, practice = practising.roll_out(learning, nets, practice, WORLD, jnp.asarray(False), jax.random.key(3))
    drawn = drawn if mask is None else drawn._replace(mask=mask)
    costs = jnp.full_like(drawn.mask, cost)
    return practising.learn(learning, nets, practice, drawn, drawn.reward, costs, jnp.asarray(bound), jax.random.key(4))[0]


def same(one, two):
    return all(np.array_equal(a, b) for a, b in zip(jax.tree.leaves(one), jax.tree.leaves(two), strict=True))


def test_the_multiplier_rises_by_what_is_spent_while_the_constraint_counts():
    practice = learned(cost=1.0, multiplier_init=0.5, multiplier_rate=0.1, cost_budget=0.25)
    assert float(practice.multiplier) == pytest.approx(0.5 * np.exp(0.1 * min(4 - 0.25, 1.0)), rel=1e-6)
    assert float(learned(bound=0.0, cost=1.0, multiplier_init=0.5).multiplier) == 0.5


def test_the_multiplier_falls_while_rollouts_stray_more_often_than_they_may():
    mask = jnp.ones((CONFIG.num_trajectories, 4)).at[:8, 2].set(0.0)  # half of the rollouts stray once
    after = {
        most: float(learned(mask=mask, cost=1.0, multiplier_init=0.5, multiplier_rate=0.1, most_strays=most).multiplier)
        for most in (8 / CONFIG.num_trajectories - 0.01, 8 / CONFIG.num_trajectories + 0.01)
    }
    assert list(after.values()) == [pytest.approx(0.5 * np.exp(step)) for step in (-0.1, 0.1)]
    assert float(learned(bound=0.0, mask=mask, multiplier_init=0.5, most_strays=0.0).multiplier) == 0.5


def test_without_the_constraint_a_cost_moves_no_policy():
    free, charged = learned(bound=0.0), learned(bound=0.0, cost=1.0)
    assert same(free.trained.policy, charged.trained.policy)
    varied = jnp.asarray(np.random.default_rng(0).integers(2, size=(CONFIG.num_trajectories, 4)), jnp.float32)
    assert not same(learned().trained.policy, learned(cost=varied).trained.policy)


def test_a_step_after_which_the_world_starts_anew_is_paid_less():
    mask = jnp.ones((CONFIG.num_trajectories, 4)).at[:8, 2].set(0.0)  # half of the rollouts stray in their second step
    free, costly = (learned(mask=mask, stray_cost=cost) for cost in (0.0, 50.0))
    assert not same(free.trained.value, costly.trained.value)
    assert same(learned(stray_cost=0.0).trained, learned(stray_cost=50.0).trained)  # nobody strayed


def test_rollouts_go_on_from_where_the_last_ones_ended():
    learning, nets, practice = begun(continued=1.0)
    _, practice = practising.roll_out(learning, nets, practice, WORLD, jnp.asarray(False), jax.random.key(3))
    drawn, _ = practising.roll_out(learning, nets, practice, WORLD, jnp.asarray(True), jax.random.key(5))
    np.testing.assert_array_equal(drawn.obs[:, 0, 0], 4.0)


def test_the_policy_that_acts_is_the_one_that_practises():
    _, nets, practice = begun()
    other = practice._replace(trained=practice.trained._replace(policy=nets.networks.init(jax.random.key(9)).policy))
    assert same(practising.acting(nets, other).params.policy, other.trained.policy)
    assert same(practising.acting(nets, practice).params.value, practice.trained.value)


@pytest.mark.parametrize("bootstraps", [False, True])
def test_straying_costs_and_what_it_leads_to_counts_where_that_is_asked_for(bootstraps):
    config = replace(CONFIG, stray_cost=50.0, reward_spread=0.1, strays_bootstrap=bootstraps)
    learning, nets, practice = begun()
    drawn, _ = practising.roll_out(learning, nets, practice, WORLD, jnp.asarray(False), jax.random.key(3))
    drawn = drawn._replace(mask=jnp.ones_like(drawn.mask).at[0, 2].set(0.0))
    expected = np.zeros(drawn.mask.shape)
    expected[0, 1] = bootstraps * config.ppo.discount * float(drawn.value[0, 2]) - 5.0
    np.testing.assert_allclose(practising.worth_of_strays(drawn, config), expected, rtol=1e-6)
