"""The paper's equations and the corrected terms against naive float64 numpy: products and exps, no log space."""

from collections.abc import Iterator
from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from aircl_jax.algorithm.policy_reward import policy_reward
from aircl_jax.algorithm.terms.logits import Batches, judge, trajectory_logit
from aircl_jax.algorithm.terms.table import TERMS
from aircl_jax.methods import METHODS
from aircl_jax.model.feasibility import RATIO_FLOOR, calibrate, log_feasibility, log_step_feasibility
from aircl_jax.settings.train_config import AdversaryConfig, Coefficients
from aircl_jax.types import Scores
from tests.worlds import TINY, naive, random_batches, random_scores, random_trajectories, tiny_grid, tiny_networks, unit_stats

COEFFICIENTS = Coefficients(contrast_coef=0.3, minimal_coef=0.2, sampled_coef=0.5, icrl_coef=0.6, sequence_ridge=0.1)


@pytest.fixture(autouse=True)
def double_precision() -> Iterator[None]:
    with jax.enable_x64(True):
        yield


def sigmoid(x):
    return 1 / (1 + np.exp(-x))


def masked(x, scores, reduce):
    """A reduction over the unmasked steps of each trajectory."""
    return np.array([reduce(row[keep > 0]) for row, keep in zip(x, naive(scores).mask, strict=True)])


def step_discriminator(scores):
    one = naive(scores)
    return np.exp(one.f) / (np.exp(one.f) + np.exp(one.log_pi))


def trajectory_discriminator(scores):
    one = naive(scores)
    exp_f, pi = np.exp(masked(one.f, scores, np.sum)), masked(np.exp(one.log_pi), scores, np.prod)
    return exp_f / (exp_f + pi)


def feasibility_of(scores, method):
    """δ̄(τ) as a product of what the row has: σ of the sequence's logit, the product over steps."""
    one, row = naive(scores), METHODS[method]
    by_sequence = sigmoid(one.sequence_logit) if "sequence" in row.feasibility else 1.0
    return by_sequence * (masked(sigmoid(one.step_logit), scores, np.prod) if "step" in row.feasibility else 1.0)


def term(name, method="aircl", batches=None, coefficients=COEFFICIENTS, **adversary):
    config = replace(TINY, adversary=AdversaryConfig(**adversary))
    return TERMS[name](METHODS[method], config, coefficients, batches or random_batches())


def test_step_discriminator_is_equation_2():
    batches = random_batches()
    logit, _ = judge(METHODS["airl"], TINY, batches.expert, batches.sampled)
    np.testing.assert_allclose(jax.nn.sigmoid(logit), step_discriminator(batches.expert), rtol=1e-12)


def test_step_judged_loss_is_equation_3_with_log_of_one_minus_d():
    batches = random_batches()
    log_d = masked(np.log(step_discriminator(batches.expert)), batches.expert, np.mean)
    log_not_d = masked(np.log(1 - step_discriminator(batches.sampled)), batches.sampled, np.mean)
    np.testing.assert_allclose(term("discriminator", "airl"), -log_d.mean() - log_not_d.mean(), rtol=1e-12)


def test_state_action_feasibility_of_a_trajectory_is_the_product_of_equation_4():
    scores = random_scores(0, 5)
    log_delta = log_feasibility(METHODS["aircl_sa"], COEFFICIENTS, scores)
    np.testing.assert_allclose(jnp.exp(log_delta), feasibility_of(scores, "aircl_sa"), rtol=1e-12)


def test_feasibility_cancels_from_the_discriminator_of_equations_7_and_9():
    scores = random_scores(0, 5)
    exp_f = np.exp(masked(naive(scores).f, scores, np.sum))
    pi, delta = masked(np.exp(naive(scores).log_pi), scores, np.prod), feasibility_of(scores, "aircl")
    q = pi * delta
    expected = exp_f * delta / (exp_f * delta + q)
    np.testing.assert_allclose(jax.nn.sigmoid(trajectory_logit(scores, "sum")), expected, rtol=1e-12)


def test_trajectory_judged_loss_is_equation_8():
    batches = random_batches()
    log_d = np.log(trajectory_discriminator(batches.expert))
    log_not_d = np.log(1 - trajectory_discriminator(batches.sampled))
    np.testing.assert_allclose(term("discriminator"), -log_d.mean() - log_not_d.mean(), rtol=1e-12)


def test_mean_logit_option_divides_by_the_unmasked_steps():
    scores = random_scores(0, 5)
    lengths = naive(scores).mask.sum(axis=1)
    np.testing.assert_allclose(trajectory_logit(scores, "mean") * lengths, trajectory_logit(scores, "sum"), rtol=1e-12)


@pytest.mark.parametrize(("option", "reduce"), [("sum", np.sum), ("mean", np.mean)])
@pytest.mark.parametrize("method", ["aircl", "aircl_sa"])
def test_contrast_prior_is_minus_equation_13_over_expert_and_sampled(method, option, reduce):
    batches = random_batches()
    squares = [
        (masked(naive(one).f, one, reduce) - feasibility_of(one, method)) ** 2 for one in (batches.expert, batches.sampled)
    ]
    expected = -0.3 * np.concatenate(squares).mean()
    np.testing.assert_allclose(term("contrast", method, contrast_reward=option), expected, rtol=1e-12)


def test_descending_the_contrast_prior_drives_reward_and_feasibility_apart():
    def loss(f, logit):
        one = random_scores(0, 1, horizon=1)._replace(f=f[None, None], sequence_logit=logit[None])
        return term("contrast", batches=Batches(one, one, one, one))

    f, logit = jnp.asarray(0.9), jnp.asarray(0.0)  # f above δ̄ = ½: the prior as printed raises f and lowers δ̄
    grad_f, grad_logit = jax.grad(loss, argnums=(0, 1))(f, logit)
    assert -grad_f > 0 > -grad_logit


def test_minimal_constraint_term_is_kappa_times_mean_distance_from_one():
    sampled = random_batches().sampled
    expected = 0.2 * np.abs(1 - feasibility_of(sampled, "aircl_sa")).mean()
    np.testing.assert_allclose(term("minimal", "aircl_sa"), expected, rtol=1e-12)


def test_minimal_constraint_term_of_the_corrected_row_speaks_of_the_sequence_factor_alone():
    sampled = random_batches().sampled
    expected = 0.2 * np.abs(1 - sharpened(naive(sampled).sequence_logit)).mean()
    np.testing.assert_allclose(term("minimal", "aircl_corrected"), expected, rtol=1e-10)


@pytest.mark.parametrize("temperature", [1.0, 0.1])
def test_centred_judge_subtracts_the_midpoint_of_both_means_without_a_gradient(temperature):
    batches, config = random_batches(), replace(TINY, temperature=temperature)
    h = [naive(one).f - temperature * naive(one).log_pi for one in (batches.expert, batches.sampled)]
    means = [masked(x, one, np.mean).mean() for x, one in zip(h, (batches.expert, batches.sampled), strict=True)]
    logits = judge(METHODS["aircl_corrected"], config, batches.expert, batches.sampled)
    for logit, x in zip(logits, h, strict=True):
        np.testing.assert_allclose(logit, x - np.mean(means), rtol=1e-12)

    def expert_logit(constant):
        shifted = batches.expert._replace(f=batches.expert.f + constant)
        return judge(METHODS["aircl_corrected"], TINY, shifted, batches.sampled)[0].sum()

    assert jax.grad(expert_logit)(0.0) == h[0].size


@pytest.mark.parametrize("constant", [-3.0, 40.0])
def test_a_constant_in_the_reward_does_not_move_the_centred_judge(constant):
    batches = random_batches()
    moved = Batches(*(one._replace(f=one.f + constant) for one in batches))
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
        name: np.log(sigmoid(sign[name] * naive(one).sequence_logit)).mean() for name, one in random_batches()._asdict().items()
    }
    squares = np.mean([(naive(one).sequence_logit ** 2).mean() for one in random_batches()])
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
    of_expert, of_policy = (
        jax.vmap(nets.scores, (None, None, 0, 0))(params, stats, one, one.log_prob) for one in (expert, policy)
    )
    reward, credit = policy_reward(nets, params, stats, expert, policy)
    centre = masked(naive(of_expert).f, of_expert, np.mean).mean()
    delta = np.maximum(sharpened(naive(of_policy).step_logit), np.exp(RATIO_FLOOR))
    paid = naive(of_policy).f - centre + np.log(delta) - temperature * np.asarray(policy.log_prob)
    np.testing.assert_allclose(reward, paid * naive(of_policy).mask, rtol=1e-6, atol=1e-9)
    log_sequence = np.log(np.maximum(sharpened(naive(of_policy).sequence_logit), np.exp(RATIO_FLOOR)))
    np.testing.assert_allclose(credit, log_sequence - log_sequence.mean(), rtol=1e-6, atol=1e-9)


@pytest.mark.parametrize("name", ["gacl", "icrl"])
def test_a_policy_of_the_true_reward_is_paid_by_it_the_feasibility_and_the_entropy(name):
    env = tiny_grid()
    nets, params = tiny_networks(env, name)
    params = params._replace(feasibility=jax.tree.map(lambda leaf: -9.0 * leaf, params.feasibility))  # some steps at the floor
    expert, policy = random_trajectories(env, 0, 5), random_trajectories(env, 1, 60)
    scores = jax.vmap(nets.scores, (None, None, 0, 0))(params, unit_stats(env), policy, policy.log_prob)
    reward, credit = policy_reward(nets, params, unit_stats(env), expert, policy)
    log_delta = np.log(sigmoid(naive(scores).step_logit))
    assert 0 < (log_delta < -11.5).mean() < 1
    paid = np.asarray(policy.reward) + np.maximum(log_delta, -11.5) - np.asarray(policy.log_prob)
    np.testing.assert_allclose(reward, paid * naive(scores).mask, rtol=1e-6, atol=1e-9)
    np.testing.assert_array_equal(credit, np.zeros(60))


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


def test_icrl_term_is_the_log_likelihood_and_its_regulariser():
    batches = random_batches()
    log_delta, distance = (
        [masked(function(sigmoid(naive(one).step_logit)), one, np.mean).mean() for one in (batches.expert, batches.policy)]
        for function in (np.log, lambda delta: 1 - delta)
    )
    expected = -log_delta[0] + log_delta[1] + 0.6 * sum(distance)
    np.testing.assert_allclose(term("icrl", "icrl"), expected, rtol=1e-12)


def test_gacl_term_is_the_imitation_discriminator_with_feasibility_as_verdict():
    batches = random_batches()
    expert = masked(np.log(sigmoid(naive(batches.expert).step_logit)), batches.expert, np.mean).mean()
    policy = masked(np.log(1 - sigmoid(naive(batches.policy).step_logit)), batches.policy, np.mean).mean()
    np.testing.assert_allclose(term("gacl", "gacl"), -expert - policy, rtol=1e-12)


@pytest.mark.parametrize("scale", [1.0, 100.0])
@pytest.mark.parametrize("name", TERMS)
def test_terms_and_their_gradients_are_finite_in_float32_at_500_steps(name, scale):
    rows = [method for method, row in METHODS.items() if name in row.terms]

    def loss(scores, method):
        return term(name, method, Batches(scores, scores, scores, scores))

    with jax.enable_x64(False):
        one = jax.tree.map(lambda leaf: scale * leaf.astype(jnp.float32), random_scores(0, 3, horizon=500))
        one = one._replace(mask=jnp.ones((3, 500), jnp.float32))
        for method in rows:
            leaves = jax.tree.leaves(jax.value_and_grad(loss)(one, method))
            assert all(bool(jnp.isfinite(leaf).all()) for leaf in leaves), method
