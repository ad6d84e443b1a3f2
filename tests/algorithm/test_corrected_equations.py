"""The centred discriminator and the corrected terms, tests and thresholds against naive float64 numpy, without log space."""

from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from aircl_jax.algorithm.policy_reward import policy_reward
from aircl_jax.algorithm.terms.logits import Batches, discriminator_logits
from aircl_jax.methods import METHODS
from aircl_jax.model.feasibility import RATIO_FLOOR, calibrate, log_feasibility, log_step_feasibility
from aircl_jax.types import Scores
from tests.worlds import (
    COEFFICIENTS,
    TINY,
    masked,
    naive,
    random_batches,
    random_scores,
    random_trajectories,
    sigmoid,
    term,
    tiny_grid,
    tiny_networks,
    unit_stats,
)

pytestmark = pytest.mark.usefixtures("double_precision")


def test_minimal_constraint_term_of_the_corrected_row_speaks_of_the_sequence_factor_alone():
    sampled = random_batches().sampled
    expected = 0.2 * np.abs(1 - sharpened(naive(sampled).sequence_logit)).mean()
    np.testing.assert_allclose(term("minimal", "aircl_corrected"), expected, rtol=1e-10)


@pytest.mark.parametrize("temperature", [1.0, 0.1])
def test_centred_judge_subtracts_the_midpoint_of_both_means_without_a_gradient(temperature):
    batches, config = random_batches(), replace(TINY, temperature=temperature)
    h = [naive(one).f - temperature * naive(one).log_pi for one in (batches.expert, batches.sampled)]
    means = [masked(x, one, np.mean).mean() for x, one in zip(h, (batches.expert, batches.sampled), strict=True)]
    logits = discriminator_logits(METHODS["aircl_corrected"], config, batches.expert, batches.sampled)
    for logit, x in zip(logits, h, strict=True):
        np.testing.assert_allclose(logit, x - np.mean(means), rtol=1e-12)

    def expert_logit(constant):
        shifted = batches.expert._replace(f=batches.expert.f + constant)
        return discriminator_logits(METHODS["aircl_corrected"], TINY, shifted, batches.sampled)[0].sum()

    assert jax.grad(expert_logit)(0.0) == h[0].size


@pytest.mark.parametrize("constant", [-3.0, 40.0])
def test_a_constant_in_the_reward_does_not_move_the_centred_judge(constant):
    batches = random_batches()
    moved = Batches(*(one._replace(f=one.f + constant) for one in batches.sets))
    value, value_moved = (term("discriminator", "aircl_corrected", one) for one in (batches, moved))
    np.testing.assert_allclose(value_moved, value, rtol=1e-10)


def test_step_ratio_term_is_logistic_regression_of_expert_against_policy_and_replay():
    batches = random_batches()
    expert, policy, replay = (
        masked(np.log(sigmoid(sign * naive(one).step_logit)), one, np.mean).mean()
        for one, sign in ((batches.expert, 1), (batches.policy, -1), (batches.replay, -1))
    )
    expected = -expert - 0.5 * (policy + replay)
    np.testing.assert_allclose(term("step_ratio", "aircl_corrected"), expected, rtol=1e-12)


def test_step_ratio_term_is_stationary_at_log_expert_over_policy():
    expert_states, policy_states = np.array([[0, 0, 0, 1]]), np.array([[0, 1, 1, 2]])
    counts = [np.bincount(states[0], minlength=3) for states in (expert_states, policy_states)]

    def loss(z):
        def scores(states):
            zeros = jnp.zeros(states.shape)
            return Scores(
                zeros, zeros, z[states], jnp.zeros(len(states)), jnp.ones(states.shape), random_scores(0, 1).thresholds
            )

        policy = scores(policy_states)
        return term("step_ratio", "aircl_corrected", Batches(scores(expert_states), policy, policy, policy))

    log_ratio = jnp.log(counts[0] + 1e-300) - jnp.log(counts[1])  # state 2, never demonstrated, has ratio 0
    np.testing.assert_allclose(jax.grad(loss)(log_ratio), 0.0, atol=1e-12)


def test_sequence_ratio_term_counts_samples_as_feasible_with_weight_m_beside_the_expert_and_bounds_the_logit():
    sign = {"expert": 1, "sampled": 1, "policy": -1, "replay": -1}
    log_right = {
        name: np.log(sigmoid(sign[name] * naive(getattr(random_batches(), name)).sequence_logit)).mean() for name in sign
    }
    squares = np.mean([(naive(one).sequence_logit ** 2).mean() for one in random_batches().sets])
    expected = -(log_right["expert"] + 0.5 * log_right["sampled"]) / 1.5 - 0.5 * (log_right["policy"] + log_right["replay"])
    expected += 0.1 * squares
    np.testing.assert_allclose(term("sequence_ratio", "aircl_corrected"), expected, rtol=1e-12)


def sharpened(logit):
    """ρ^k / (ρ^k + ϑ^k) of the density ratio ρ = exp(z), with its floor."""
    power, threshold = np.exp(logit) ** COEFFICIENTS.sharpness, COEFFICIENTS.threshold**COEFFICIENTS.sharpness
    return np.maximum(power / (power + threshold), np.exp(RATIO_FLOOR))


def test_sharpened_test_is_a_power_law_of_the_density_ratio_with_a_floor():
    scores = random_scores(0, 5)
    log_delta = log_step_feasibility(METHODS["aircl_corrected"], COEFFICIENTS, scores)
    unmasked = naive(scores).mask > 0
    expected = sharpened(naive(scores).step_logit)
    np.testing.assert_allclose(np.exp(log_delta)[unmasked], expected[unmasked], rtol=1e-10)


def test_corrected_feasibility_is_the_sequence_factor_times_the_least_step_factor():
    scores = random_scores(0, 5)
    one = naive(scores)
    expected = sharpened(one.sequence_logit) * masked(sharpened(one.step_logit), scores, np.min)
    log_delta = log_feasibility(METHODS["aircl_corrected"], COEFFICIENTS, scores)
    np.testing.assert_allclose(jnp.exp(log_delta), expected, rtol=1e-10)


@pytest.mark.parametrize("temperature", [1.0, 0.1])
def test_corrected_policy_is_paid_by_the_centred_reward_the_step_factor_and_the_entropy(temperature):
    env, config = tiny_grid(), replace(TINY, temperature=temperature, coefficients=COEFFICIENTS)
    nets, params = tiny_networks(env, "aircl_corrected", config)
    expert, policy = random_trajectories(env, 0, 5), random_trajectories(env, 1, 6)
    stats = unit_stats(env)
    of_expert, of_policy = (jax.vmap(nets.bind(params, stats).scores)(one, one.log_prob) for one in (expert, policy))
    reward, credit = policy_reward(nets.bind(params, stats), expert, policy)
    centre = masked(naive(of_expert).f, of_expert, np.mean).mean()
    delta = np.maximum(sharpened(naive(of_policy).step_logit), np.exp(RATIO_FLOOR))
    paid = naive(of_policy).f - centre + np.log(delta) - temperature * np.asarray(policy.log_prob)
    np.testing.assert_allclose(reward, paid * naive(of_policy).mask, rtol=1e-6, atol=1e-9)
    log_sequence = np.log(np.maximum(sharpened(naive(of_policy).sequence_logit), np.exp(RATIO_FLOOR)))
    np.testing.assert_allclose(credit, log_sequence - log_sequence.mean(), rtol=1e-6, atol=1e-9)


def test_thresholds_are_lowered_until_the_demonstrations_pass():
    expert = random_scores(0, 100)
    shifted = expert._replace(step_logit=expert.step_logit - 5.0)
    thresholds = calibrate(COEFFICIENTS, shifted)
    assert thresholds.sequence == calibrate(COEFFICIENTS, expert).sequence  # each test has its own
    passed = log_feasibility(METHODS["aircl_corrected_sa"], COEFFICIENTS, shifted._replace(thresholds=thresholds))
    least = np.where(naive(shifted).mask > 0, naive(shifted).step_logit, np.inf).min(axis=1)
    lowered = np.quantile(least, COEFFICIENTS.false_alarms) - 3.0 / COEFFICIENTS.sharpness
    np.testing.assert_allclose(thresholds.step, lowered, rtol=1e-10)
    assert (np.exp(passed) >= 0.95).mean() == 0.95


def test_thresholds_stay_where_the_demonstrations_pass_anyway():
    expert = random_scores(0, 100)
    clear = expert._replace(step_logit=jnp.abs(expert.step_logit), sequence_logit=jnp.zeros(100))
    np.testing.assert_allclose(calibrate(COEFFICIENTS, clear), np.log(COEFFICIENTS.threshold), rtol=1e-10)
