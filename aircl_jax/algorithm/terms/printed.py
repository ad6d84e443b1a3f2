"""Define the paper's loss terms as printed: Eq. 8, 12, 13 and Section 6's minimal constraint."""

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from aircl_jax.algorithm.masks import mean_over_steps
from aircl_jax.algorithm.terms.logits import Batches, discriminator_logits, per_trajectory, trajectory_logit
from aircl_jax.methods import Method
from aircl_jax.model.feasibility import log_feasibility, log_sequence_feasibility
from aircl_jax.settings.train_config import Coefficients, TrainConfig
from aircl_jax.types import Scores


def discriminator(method: Method, config: TrainConfig, coefficients: Coefficients, scores: Batches) -> Float[Array, ""]:
    """Eq. 8 (Eq. 3 for a discriminator of steps): −E_E[log D] − E_S[log(1 − D)], whose gradient in θ is Eq. 11."""
    expert_logit, sampled_logit = discriminator_logits(method, config, scores.expert, scores.sampled)
    expert_loss = per_trajectory(jax.nn.softplus(-expert_logit), scores.expert.mask)
    sampled_loss = per_trajectory(jax.nn.softplus(sampled_logit), scores.sampled.mask)
    return expert_loss.mean() + sampled_loss.mean()


def feasibility_gradient(method: Method, config: TrainConfig, coefficients: Coefficients, scores: Batches) -> Float[Array, ""]:
    """Eq. 12: −E_S[c(τ) δ̄] + E_P[δ̄] (Eq. 10 at λ = 1, without its constant α), c = π / (1 + exp(f)/π) constant and clipped.

    In log space log c = log π + log σ(log π − f). The term is as printed; docs/equations.md explains why it collapses.
    """
    logit = trajectory_logit(scores.sampled, config.adversary.trajectory_logit)
    log_pi = (scores.sampled.log_pi * scores.sampled.mask).sum(axis=-1)
    log_coefficient = jnp.minimum(log_pi + jax.nn.log_sigmoid(-logit), jnp.log(coefficients.ratio_clip))
    coefficient = jax.lax.stop_gradient(jnp.exp(log_coefficient))
    delta_sampled = jnp.exp(log_feasibility(method, coefficients, scores.sampled))
    delta_policy = jnp.exp(log_feasibility(method, coefficients, scores.policy))
    return -(coefficient * delta_sampled).mean() + delta_policy.mean()


def contrast(method: Method, config: TrainConfig, coefficients: Coefficients, scores: Batches) -> Float[Array, ""]:
    """Eq. 13: −φ · E_{E ∪ S}[(f(τ) − δ̄(τ))²]. The paper maximises the expectation, which drives f and δ̄ apart."""

    def squares(batch: Scores) -> Float[Array, " N"]:
        summed = config.adversary.contrast_reward == "sum"
        f = (batch.f * batch.mask).sum(-1) if summed else mean_over_steps(batch.f, batch.mask)
        return (f - jnp.exp(log_feasibility(method, coefficients, batch))) ** 2

    both = jnp.concatenate([squares(scores.expert), squares(scores.sampled)])
    return -coefficients.contrast_coef * both.mean()


def minimal(method: Method, config: TrainConfig, coefficients: Coefficients, scores: Batches) -> Float[Array, ""]:
    """Section 6's minimal-constraint term, κ · E_S|1 − δ̄(τ)|; on δ_seq alone where the per-step factor is a ratio test."""
    logs = log_sequence_feasibility if method.is_ratio_test else log_feasibility
    return coefficients.minimal_coef * (1.0 - jnp.exp(logs(method, coefficients, scores.sampled))).mean()
