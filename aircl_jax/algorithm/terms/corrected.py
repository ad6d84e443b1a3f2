"""Define the loss terms of the corrected formulation: density-ratio tests of steps and of trajectories."""

import jax
from jaxtyping import Array, Float

from aircl_jax.algorithm.masks import mean_over_steps
from aircl_jax.algorithm.terms.logits import Batches
from aircl_jax.methods import Method
from aircl_jax.settings.train_config import Coefficients, TrainConfig


def step_ratio(method: Method, config: TrainConfig, coefficients: Coefficients, scores: Batches) -> Float[Array, ""]:
    """Corrected, per step: E_E mean_t softplus(−z) + E_{P ∪ replay} mean_t softplus(z), so that z = log p_E/p_P."""
    expert = mean_over_steps(jax.nn.softplus(-scores.expert.step_logit), scores.expert.mask).mean()
    policy, replay = (
        mean_over_steps(jax.nn.softplus(batch.step_logit), batch.mask).mean() for batch in (scores.policy, scores.replay)
    )
    return expert + 0.5 * (policy + replay)


def sequence_ratio(method: Method, config: TrainConfig, coefficients: Coefficients, scores: Batches) -> Float[Array, ""]:
    """Corrected, per trajectory, z of the order-aware encoder: with D_S as feasible with weight m beside D_E,

    (E_E softplus(−z) + m E_S softplus(−z)) / (1 + m) + E_{P ∪ replay} softplus(z) + η E_{E ∪ S ∪ P ∪ replay} z².

    The ridge η keeps z from overfitting few demonstrations; without it z memorises a robot's fifty.
    """
    m = coefficients.sampled_coef
    expert, sampled = (jax.nn.softplus(-batch.sequence_logit).mean() for batch in (scores.expert, scores.sampled))
    policy, replay = (jax.nn.softplus(batch.sequence_logit).mean() for batch in (scores.policy, scores.replay))
    ridge = sum((batch.sequence_logit**2).mean() for batch in scores.sets) / len(scores.sets)
    return (expert + m * sampled) / (1.0 + m) + 0.5 * (policy + replay) + coefficients.sequence_ridge * ridge
