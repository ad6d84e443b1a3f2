"""The paper's gradients (Eq. 11, 12) and the ones that docs/equations.md derives instead, in float64."""

from dataclasses import replace
from functools import cache

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jax.flatten_util import ravel_pytree

from aircl_jax.algorithm.adversary import score_all
from aircl_jax.algorithm.terms.logits import Batches
from aircl_jax.algorithm.terms.table import TERMS
from aircl_jax.methods import METHODS
from aircl_jax.model.feasibility import log_feasibility
from aircl_jax.settings.train_config import Coefficients
from tests.worlds import TINY, random_trajectories, tiny_grid, tiny_networks, unit_stats

pytestmark = pytest.mark.usefixtures("double_precision")


class Setting:
    """A row's networks on random trajectories, as functions of flat θ and φ."""

    def __init__(self, method: str, ratio_clip: float = 1e9):
        env = tiny_grid()
        self.method = METHODS[method]
        self.config = replace(TINY, coefficients=Coefficients(ratio_clip=ratio_clip))
        self.nets, params = tiny_networks(env, method, self.config)
        self.params, self.stats = params, unit_stats(env)
        self.batches = Batches(*(random_trajectories(env, seed, 5) for seed in range(4)))
        self.theta, self.unravel_theta = ravel_pytree(params.reward)
        self.phi, self.unravel_phi = ravel_pytree(params.feasibility)

    def scores(self, theta, phi):
        params = self.params._replace(reward=self.unravel_theta(theta), feasibility=self.unravel_phi(phi))
        return score_all(self.nets.bind(params, self.stats), Batches(*((one, one.log_prob) for one in self.batches.sets)))

    def grad(self, name, argnums):
        def loss(theta, phi):
            return TERMS[name](self.method, self.config, self.config.coefficients, self.scores(theta, phi))

        return np.asarray(jax.jit(jax.grad(loss, argnums))(self.theta, self.phi))

    def reward(self, batch):
        """f_θ(τ), its Jacobian in θ, and π(τ), as numpy."""

        def value(theta):
            one = getattr(self.scores(theta, self.phi), batch)
            return (one.f * one.mask).sum(axis=-1)

        one = getattr(self.batches, batch)
        pi = np.prod(np.where(np.asarray(one.mask) > 0, np.exp(one.log_prob), 1.0), axis=1)
        return np.asarray(jax.jit(value)(self.theta)), np.asarray(jax.jit(jax.jacrev(value))(self.theta)), pi

    def feasibility_jacobian(self, batch):
        """∂δ̄_φ(τ)/∂φ, as numpy."""

        def value(phi):
            scores = getattr(self.scores(self.theta, phi), batch)
            return jnp.exp(log_feasibility(self.method, self.config.coefficients, scores))

        return np.asarray(jax.jit(jax.jacrev(value))(self.phi))

    def equation_12(self):
        f, _, pi = self.reward("sampled")
        coefficient = np.minimum(pi / (1 + np.exp(f) / pi), self.config.coefficients.ratio_clip)
        weighted = coefficient[:, None] * self.feasibility_jacobian("sampled")
        return coefficient, weighted.mean(0) - self.feasibility_jacobian("policy").mean(0)


@cache
def setting(method: str) -> Setting:
    return Setting(method)


def test_discriminator_gradient_is_equation_11():
    one = setting("aircl")
    (f_expert, df_expert, pi_expert), (f_sampled, df_sampled, pi_sampled) = one.reward("expert"), one.reward("sampled")
    d_expert = np.exp(f_expert) / (np.exp(f_expert) + pi_expert)
    d_sampled = np.exp(f_sampled) / (np.exp(f_sampled) + pi_sampled)
    equation = ((1 - d_expert)[:, None] * df_expert).mean(0) - (d_sampled[:, None] * df_sampled).mean(0)
    np.testing.assert_allclose(-one.grad("discriminator", 0), equation, rtol=1e-10, atol=1e-14)


@pytest.mark.parametrize("method", ["aircl", "aircl_linear", "aircl_sa"])
def test_feasibility_gradient_is_equation_12(method):
    one = setting(method)
    _, equation = one.equation_12()
    np.testing.assert_allclose(-one.grad("feasibility_gradient", 1), equation, rtol=1e-10, atol=1e-14)


def test_coefficient_of_equation_12_is_clipped_from_above():
    one = Setting("aircl_linear", ratio_clip=0.01)
    coefficient, equation = one.equation_12()
    assert 0 < (coefficient == 0.01).sum() < len(coefficient)
    np.testing.assert_allclose(-one.grad("feasibility_gradient", 1), equation, rtol=1e-10, atol=1e-14)


@pytest.mark.parametrize(("name", "standing"), [("discriminator", 1), ("feasibility_gradient", 0), ("minimal", 0)])
def test_each_term_moves_only_its_own_parameters(name, standing):
    np.testing.assert_array_equal(setting("aircl_linear").grad(name, standing), 0.0)


# A finite set of trajectories on which every expectation is a sum: what docs/equations.md derives is checked on it.
FINITE = np.random.default_rng(0)
LOGIT, REWARD = FINITE.normal(size=6), FINITE.normal(size=6)
PI = FINITE.dirichlet(np.ones(6))
EXPERT = FINITE.dirichlet(np.ones(6))
D = np.exp(REWARD) / (np.exp(REWARD) + PI)


def test_true_gradient_of_equation_10_is_a_covariance_without_the_stray_policy_factor():
    def objective(logit):
        delta = jax.nn.sigmoid(logit)
        q = PI * delta / (PI * delta).sum()
        return (q * np.log(1 - D)).sum() - (PI * delta).sum()

    delta = 1 / (1 + np.exp(-LOGIT))
    q = PI * delta / (PI * delta).sum()
    dlog_delta = np.diag(1 - delta)
    centred = np.log(1 - D) - (q * np.log(1 - D)).sum()
    expected = (q * centred) @ dlog_delta - (PI * delta) @ dlog_delta
    np.testing.assert_allclose(jax.grad(objective)(LOGIT), expected, rtol=1e-10)


def test_likelihood_gradient_of_equation_6_is_expert_minus_model():
    def log_likelihood(logit):
        log_delta = jax.nn.log_sigmoid(logit)
        return (EXPERT * (REWARD + log_delta)).sum() - jax.nn.logsumexp(REWARD + log_delta)

    delta = 1 / (1 + np.exp(-LOGIT))
    model = np.exp(REWARD) * delta / (np.exp(REWARD) * delta).sum()
    expected = (EXPERT - model) @ np.diag(1 - delta)
    np.testing.assert_allclose(jax.grad(log_likelihood)(LOGIT), expected, rtol=1e-10)


def test_equation_12_at_a_saturated_coefficient_only_spreads_the_feasibility():
    # c = 1 everywhere: E_S[∂δ̄] − E_P[∂δ̄] = ½ ∂Var_π(δ̄) / E_π[δ̄], with no word of the expert.
    def variance(logit):
        delta = jax.nn.sigmoid(logit)
        return (PI * delta**2).sum() - (PI * delta).sum() ** 2

    delta = 1 / (1 + np.exp(-LOGIT))
    q = PI * delta / (PI * delta).sum()
    printed = (q - PI) @ np.diag(delta * (1 - delta))
    np.testing.assert_allclose(printed, 0.5 * jax.grad(variance)(LOGIT) / (PI * delta).sum(), rtol=1e-10)
