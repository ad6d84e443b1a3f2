"""The paper's equations against naive float64 numpy: products and exps, no log space."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from aircl_jax.algorithm.policy_reward import policy_reward
from aircl_jax.algorithm.terms.logits import Batches, StateScores, discriminator_logits, trajectory_logit
from aircl_jax.algorithm.terms.table import TERMS
from aircl_jax.methods import METHODS
from aircl_jax.model.feasibility import log_feasibility
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


def test_step_discriminator_is_equation_2():
    batches = random_batches()
    logit, _ = discriminator_logits(METHODS["airl"], TINY, batches.expert, batches.sampled)
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


@pytest.mark.parametrize("name", ["gacl", "icrl"])
def test_a_policy_of_the_true_reward_is_paid_by_it_the_feasibility_and_the_entropy(name):
    env = tiny_grid()
    nets, params = tiny_networks(env, name)
    params = params._replace(feasibility=jax.tree.map(lambda leaf: -9.0 * leaf, params.feasibility))  # some steps at the floor
    expert, policy = random_trajectories(env, 0, 5), random_trajectories(env, 1, 60)
    scores = jax.vmap(nets.bind(params, unit_stats(env)).scores)(policy, policy.log_prob)
    reward, credit = policy_reward(nets.bind(params, unit_stats(env)), expert, policy)
    log_delta = np.log(sigmoid(naive(scores).step_logit))
    assert 0 < (log_delta < -11.5).mean() < 1
    paid = np.asarray(policy.reward) + np.maximum(log_delta, -11.5) - np.asarray(policy.log_prob)
    np.testing.assert_allclose(reward, paid * naive(scores).mask, rtol=1e-6, atol=1e-9)
    np.testing.assert_array_equal(credit, np.zeros(60))


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
        of_states = StateScores(*jnp.abs(scores.f[jnp.array([0, 1, 2, 0, 1])]), *scores.mask[:, 0])
        return term(name, method, Batches(scores, scores, scores, scores, of_states))

    with jax.enable_x64(False):
        one = jax.tree.map(lambda leaf: scale * leaf.astype(jnp.float32), random_scores(0, 3, horizon=500))
        one = one._replace(mask=jnp.ones((3, 500), jnp.float32))
        for method in rows:
            leaves = jax.tree.leaves(jax.value_and_grad(loss)(one, method))
            assert all(bool(jnp.isfinite(leaf).all()) for leaf in leaves), method


def test_a_policy_of_the_papers_learned_reward_is_paid_by_it_uncentred_and_the_entropy_alone():
    env = tiny_grid()
    nets, params = tiny_networks(env, "aircl_sa")
    expert, policy = random_trajectories(env, 0, 5), random_trajectories(env, 1, 6)
    scores = jax.vmap(nets.bind(params, unit_stats(env)).scores)(policy, policy.log_prob)
    reward, credit = policy_reward(nets.bind(params, unit_stats(env)), expert, policy)
    paid = naive(scores).f - np.asarray(policy.log_prob)
    np.testing.assert_allclose(reward, paid * naive(scores).mask, rtol=1e-6, atol=1e-9)
    np.testing.assert_array_equal(credit, np.zeros(6))
