"""Define the loss terms of the contrast row: a reward by the likelihood, and a test of entries made against those expected."""

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from aircl_jax.algorithm.terms.logits import Batches, StateScores
from aircl_jax.methods import Method
from aircl_jax.settings.train_config import Coefficients, TrainConfig
from aircl_jax.types import Scores


def likelihood(method: Method, config: TrainConfig, coefficients: Coefficients, scores: Batches) -> Float[Array, ""]:
    """Eq. 6 as a loss: −E_E[f(τ)] + E_S[f(τ)], whose gradient in θ is −E_E[∇f] + E_q[∇f], expert minus model."""

    def mean_f(batch: Scores) -> Float[Array, ""]:
        return (batch.f * batch.mask).sum(axis=-1).mean()

    return -mean_f(scores.expert) + mean_f(scores.sampled)


def exact_likelihood(method: Method, config: TrainConfig, coefficients: Coefficients, scores: Batches) -> Float[Array, ""]:
    """The same with E_p[f(τ)] of the model's own plan, from the world's table, in place of a mean over rollouts of π.

    f would follow the noise of rollouts, and it would explain what π has not learned yet.
    """
    states = _of_states(scores)
    return -states.expert_f + states.model_f


def reward_ridge(method: Method, config: TrainConfig, coefficients: Coefficients, scores: Batches) -> Float[Array, ""]:
    """Σ_s (g(s) − ḡ)² / (2 N σ²): minus the log of a normal prior of g about its mean, for each of N demonstrations.

    Of all rewards that explain D_E it chooses the smallest, so that what a constraint explains is left to the constraint.
    """
    states = _of_states(scores)
    scatter = (states.reward - states.reward.mean()) ** 2
    return scatter.sum() / (2 * states.demonstrations * coefficients.reward_scatter**2)


def potential_prior(method: Method, config: TrainConfig, coefficients: Coefficients, scores: Batches) -> Float[Array, ""]:
    """(P + 1)/2 · log(1 + |∇h|²/σ_h²) / N: minus the log of a Cauchy prior of the P slopes of h, for each demonstration.

    It holds slopes near 0 that the demonstrations hardly tell, and leaves large ones that they do: its pull ends as 1/|∇h|.
    """
    states = _of_states(scores)
    steepness = (states.potential**2).sum() / coefficients.potential_scatter**2
    return (len(states.potential) + 1) / 2 * jnp.log1p(steepness) / states.demonstrations


def entry_ratio(method: Method, config: TrainConfig, coefficients: Coefficients, scores: Batches) -> Float[Array, ""]:
    """Σ_s [(n_s + ε) softplus(−z_s) + (M_s + ε) softplus(z_s)] / N, least at z_s = log (n_s + ε) / (M_s + ε).

    A logistic regression of entries that were made against those that would have been, were entering s alone ordinary.
    """
    states, pseudo = _of_states(scores), coefficients.pseudo_count
    made = (states.entered + pseudo) * jax.nn.softplus(-states.step_logit)
    expected = (states.expected + pseudo) * jax.nn.softplus(states.step_logit)
    return (made + expected).sum() / states.demonstrations


def _of_states(scores: Batches) -> StateScores:
    if scores.states is None:
        raise ValueError("terms of the contrast row are of worlds whose states are counted; choose other terms here")
    return scores.states
