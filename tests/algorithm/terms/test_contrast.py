"""The contrast row's terms and entry counts against naive float64 numpy."""

from dataclasses import replace
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.stats import multivariate_t

from aircl_jax.algorithm import entries
from aircl_jax.algorithm.adversary import make_optimiser
from aircl_jax.algorithm.policy_reward import policy_reward
from aircl_jax.algorithm.terms.logits import StateScores
from aircl_jax.analysis.exact import soft_plan
from aircl_jax.methods import METHODS
from tests.worlds import (
    COEFFICIENTS,
    TINY,
    masked,
    naive,
    random_batches,
    random_trajectories,
    sigmoid,
    table_of,
    term,
    tiny_grid,
    tiny_networks,
    unit_stats,
)

pytestmark = pytest.mark.usefixtures("double_precision")

ROW = METHODS["aircl_contrast"]
SLIPPING = tiny_grid(slip=0.2, wind=0.1)
RANDOM = np.random.default_rng(3)


def of_states(seed=0, number=5):
    random = np.random.default_rng(seed)
    reward, logit = random.normal(size=(2, number))
    made, expected = random.integers(0, 9, size=(2, number))
    slopes = random.normal(size=2)
    return StateScores(*map(jnp.asarray, (reward, slopes, logit, made.astype(float), expected + 0.25, 7.0, 1.0, 2.0)))


def logits(nets, obs, t):
    policy: Any = nets.policy(obs, jnp.asarray(t))
    return np.asarray(policy.logits, np.float64)


def bound(env=SLIPPING, price=None, seed=0):
    """Random g, z and h on a grid, beside a random price of entries."""
    nets, params = tiny_networks(env, ROW)
    random = np.random.default_rng(seed)
    random_params = jax.tree.map(lambda leaf: leaf + random.normal(size=leaf.shape), params)
    price = random.uniform(-2, 0, size=params.entry_price.shape) if price is None else price
    return nets.bind(random_params._replace(entry_price=jnp.asarray(price)), unit_stats(env))


def test_the_likelihoods_loss_is_model_minus_expert_over_unmasked_steps():
    batches = random_batches()
    expert, sampled = (masked(naive(one).f, one, np.sum).mean() for one in (batches.expert, batches.sampled))
    np.testing.assert_allclose(term("likelihood", "aircl_contrast"), sampled - expert, rtol=1e-12)


def test_the_ridge_is_the_scatter_about_the_mean_for_each_demonstration():
    states = of_states()
    coefficients = replace(COEFFICIENTS, reward_scatter=0.6)
    g = np.asarray(states.reward)
    expected = sum((x - g.mean()) ** 2 for x in g) / (2 * 7 * 0.36)
    found = term("reward_ridge", "aircl_contrast", random_batches()._replace(states=states), coefficients)
    np.testing.assert_allclose(found, expected, rtol=1e-12)


def test_the_prior_of_the_potential_is_minus_the_log_of_a_cauchy_density_for_each_demonstration():
    states = of_states()
    batches, coefficients = random_batches()._replace(states=states), replace(COEFFICIENTS, potential_scatter=0.6)
    slopes = np.asarray(states.potential, np.float64)
    family: Any = multivariate_t
    at_zero, at_slopes = (family.logpdf(x, np.zeros(2), 0.36 * np.eye(2), 1) for x in (np.zeros(2), slopes))
    expected = (at_zero - at_slopes) / 7
    np.testing.assert_allclose(term("potential_prior", "aircl_contrast", batches, coefficients), expected, rtol=1e-12)


def test_the_entry_ratio_is_a_logistic_regression_of_made_against_expected_entries():
    states, pseudo = of_states(), 0.4
    z, n, m = (np.asarray(one) for one in (states.step_logit, states.entered, states.expected))
    expected = -((n + pseudo) * np.log(sigmoid(z)) + (m + pseudo) * np.log(sigmoid(-z))).sum() / 7
    batches, coefficients = random_batches(), replace(COEFFICIENTS, pseudo_count=pseudo)
    found = term("entry_ratio", "aircl_contrast", batches._replace(states=states), coefficients)
    np.testing.assert_allclose(found, expected, rtol=1e-12)

    def loss(logit):
        moved = batches._replace(states=states._replace(step_logit=logit))
        return term("entry_ratio", "aircl_contrast", moved, coefficients)

    np.testing.assert_allclose(jax.grad(loss)(jnp.log((n + pseudo) / (m + pseudo))), 0.0, atol=1e-12)


def test_terms_of_states_say_where_they_belong():
    with pytest.raises(ValueError, match="are of worlds whose states are counted"):
        term("reward_ridge", "aircl_contrast")


def test_entries_are_of_the_likeliest_successor_if_it_is_another_cell_and_the_step_counts():
    expert = random_trajectories(SLIPPING, 0, 4)
    shown = entries.shown_by(expert, SLIPPING, table_of(SLIPPING))
    aim = np.asarray(table_of(SLIPPING).transition).argmax(-1)
    made, visits = np.zeros(9), np.zeros((4, 9))
    for obs, action, mask in zip(*(np.asarray(x) for x in (expert.obs, expert.action, expert.mask)), strict=True):
        for t, (cell, taken, keep) in enumerate(zip(obs.argmax(-1), action, mask, strict=True)):
            visits[t, cell] += keep
            made[aim[cell, taken]] += keep * (aim[cell, taken] != cell)
    np.testing.assert_allclose(shown.entered, made)
    np.testing.assert_allclose(shown.visits, visits)
    assert made.sum() < np.asarray(expert.mask).sum()  # a bump or the goal's own steps enter nothing
    assert shown.demonstrations == 4


def test_a_tempted_policy_makes_one_successor_ordinary_and_leaves_the_other_actions():
    nets, table = bound(), table_of(SLIPPING)
    found = entries.tempted_policy(nets, table, entries.log_policy(nets, table))
    transition = np.asarray(table.transition, np.float64)
    g = np.array([float(nets.state_reward(obs)) for obs in table.obs])
    price = np.asarray(nets.params.entry_price)
    for t, cell in ((0, 1), (2, 4), (3, 6)):
        usual = logits(nets, table.obs[cell], t)
        for action in range(4):
            ordinary = usual.copy()
            ordinary[action] += g.mean() - transition[cell, action] @ g - price[cell, action]
            expected = np.exp(ordinary[action]) / np.exp(ordinary).sum()
            np.testing.assert_allclose(found[t, cell, action], expected, rtol=1e-6)


def test_expected_entries_sum_the_temptations_of_the_demonstrated_states():
    nets, table = bound(), table_of(SLIPPING)
    expert = random_trajectories(SLIPPING, 0, 4)
    log_model = entries.log_policy(nets, table)
    shown, tempted = entries.shown_by(expert, SLIPPING, table), np.asarray(entries.tempted_policy(nets, table, log_model))
    aim, expected = np.asarray(table.transition).argmax(-1), np.zeros(9)
    for obs, mask in zip(np.asarray(expert.obs), np.asarray(expert.mask), strict=True):
        for t, (cell, keep) in enumerate(zip(obs.argmax(-1), mask, strict=True)):
            for action in range(4):
                expected[aim[cell, action]] += keep * tempted[t, cell, action] * (aim[cell, action] != cell)
    np.testing.assert_allclose(entries.expected_entries(nets, table, shown, log_model), expected, rtol=1e-9)


def test_no_gradient_flows_through_the_expected_entries():
    nets, table = bound(), table_of(SLIPPING)
    score = entries.scorer(nets, random_trajectories(SLIPPING, 0, 4), table)

    def expected(reward):
        return score(nets.with_params(reward=reward)).expected.sum()

    assert all(not np.any(leaf) for leaf in jax.tree.leaves(jax.grad(expected)(nets.params.reward)))


def test_the_price_of_an_entry_is_the_expected_log_delta_of_the_successor_floored_and_delayed():
    nets, table = bound(), table_of(SLIPPING)
    coefficients = replace(COEFFICIENTS, threshold=0.15, sharpness=20.0)
    config = replace(TINY, feasibility_delay=5, coefficients=coefficients)
    nets = replace(nets, networks=replace(nets.networks, config=config))
    final = nets.params.feasibility["step"]["params"]
    drawn = np.array([float(nets.step_logit(obs, jnp.zeros((), jnp.int32))) for obs in table.obs])
    middle = (np.sort(drawn)[3] + np.sort(drawn)[4]) / 2  # put at log ϑ, so that some cells are forbidden and some are not
    final[max(final)]["bias"] = final[max(final)]["bias"] + np.log(0.15) - middle
    z = drawn + np.log(0.15) - middle
    log_delta = np.maximum(np.log(sigmoid(20.0 * (z - np.log(0.15)))), -6.0)
    assert (log_delta == -6.0).any() and (log_delta > -1.0).any()
    expected = np.asarray(table.transition, np.float64) @ log_delta
    np.testing.assert_allclose(entries.entry_price(nets, table, jnp.asarray(5)), expected, rtol=1e-5)
    assert not np.any(entries.entry_price(nets, table, jnp.asarray(4)))


def test_the_reward_is_of_the_state_with_the_expected_difference_of_a_linear_potential():
    nets, table = bound(), table_of(SLIPPING)
    slope = np.asarray(nets.params.reward["potential"])
    where = np.array([divmod(cell, 3) for cell in range(9)])
    transition = np.asarray(table.transition, np.float64)
    for cell in range(9):
        for action in range(4):
            g = float(nets.state_reward(table.obs[cell]))
            expected = g + (transition[cell, action] @ where - where[cell]) @ slope
            np.testing.assert_allclose(nets.reward(table.obs[cell], jnp.asarray(action)), expected, rtol=1e-5, atol=1e-7)
            np.testing.assert_allclose(nets.potential(table.obs[cell]), where[cell] @ slope, rtol=1e-6)


def test_the_policy_has_the_price_in_its_logits_and_is_paid_it():
    price = RANDOM.uniform(-2, 0, size=(9, 4))
    nets, free = bound(price=price), bound(price=np.zeros((9, 4)))
    obs = jnp.eye(9)[4]
    with_price, without = (logits(one, obs, 1) for one in (nets, free))
    np.testing.assert_allclose(with_price - with_price[0], without + price[4] - (without + price[4])[0], rtol=1e-5)

    rollouts = random_trajectories(SLIPPING, 1, 3)
    paid, free_pay = (policy_reward(one, rollouts, rollouts)[0] for one in (nets, free))
    cells, actions = np.asarray(rollouts.obs).argmax(-1), np.asarray(rollouts.action)
    np.testing.assert_allclose(paid - free_pay, price[cells, actions] * np.asarray(rollouts.mask), rtol=1e-5, atol=1e-6)


def test_a_plan_has_the_price_in_its_values_and_not_again_in_its_logits():
    config = replace(TINY, learner="exact")
    nets, params = tiny_networks(SLIPPING, ROW, config)
    priced = params._replace(entry_price=jnp.asarray(RANDOM.uniform(-2, 0, size=(9, 4))))
    planned = logits(nets.bind(priced, unit_stats(SLIPPING)), jnp.eye(9)[4], 1)
    np.testing.assert_allclose(planned, planned[0])


def test_the_exact_likelihood_is_the_mean_over_all_episodes_of_the_soft_plan_from_the_demonstrated_starts():
    nets, table = bound(), table_of(SLIPPING)
    expert = random_trajectories(SLIPPING, 0, 4)
    states = entries.scorer(nets, expert, table)(nets)
    f = np.array([[float(nets.reward(obs, jnp.asarray(action))) for action in range(4)] for obs in table.obs])
    transition = np.asarray(table.transition, np.float64)
    plan = soft_plan(transition, f + np.asarray(nets.params.entry_price), 4)
    visits, model = np.asarray(expert.obs[:, 0]).mean(axis=0), 0.0
    for policy in plan:
        model += (visits[:, None] * policy * f).sum()
        visits = np.einsum("x,xa,xay->y", visits, policy, transition)
    cells, actions, mask = (np.asarray(one) for one in (expert.obs.argmax(-1), expert.action, expert.mask))
    shown = (f[cells, actions] * mask).sum(axis=1).mean()
    np.testing.assert_allclose(states.model_f, model, rtol=1e-6)
    np.testing.assert_allclose(states.expert_f, shown, rtol=1e-6)
    loss = term("exact_likelihood", "aircl_contrast", random_batches()._replace(states=states))
    np.testing.assert_allclose(loss, model - shown, rtol=1e-6)


def test_the_slopes_of_a_potential_go_down_their_own_gradient_and_the_networks_by_adam():
    nets, params = tiny_networks(SLIPPING, ROW)
    optimiser = make_optimiser(ROW, nets.config)
    trainable = (params.reward, params.feasibility)
    updates: Any
    updates, _ = optimiser.update(jax.tree.map(lambda leaf: 4.0 + 0.0 * leaf, trainable), optimiser.init(trainable))
    np.testing.assert_allclose(updates[0]["potential"], -4.0 * TINY.adversary.potential_rate)
    for leaf in jax.tree.leaves((updates[0]["state"], updates[1])):
        np.testing.assert_allclose(leaf, -TINY.adversary.learning_rate, rtol=1e-5)
