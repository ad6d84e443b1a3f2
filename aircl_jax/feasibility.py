"""δ̄ in log space: from the feasibility networks' logits to log δ of a step and of a trajectory."""

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from aircl_jax.config import Coefficients
from aircl_jax.methods import Method
from aircl_jax.types import Scores

RATIO_FLOOR = -5.0  # least log δ₁ of the sharpened test: an infeasible step costs the policy this much reward
SIGMOID_FLOOR = -11.5  # least log δ of σ(z) in the policy's reward: the published baselines' log(D + 1e-5) for "−∞"


def log_step_feasibility(method: Method, coefficients: Coefficients, scores: Scores) -> Float[Array, "*N T"]:
    """log δ₁(s_t, a_t): log σ(z), or the sharpened test max(log σ(k (z − log ϑ)), −5) of z = log p_E/p_P; 0 where masked."""
    if "step" not in method.feasibility:
        return jnp.zeros_like(scores.step_logit)
    if method.step_test == "ratio":
        excess = coefficients.sharpness * (scores.step_logit - jnp.log(coefficients.threshold))
        log_delta = jnp.maximum(jax.nn.log_sigmoid(excess), RATIO_FLOOR)
    else:
        log_delta = jax.nn.log_sigmoid(scores.step_logit)
    return log_delta * scores.mask


def log_sequence_feasibility(method: Method, scores: Scores) -> Float[Array, "*N"]:
    """log δ_seq(τ) = log σ of the order-aware encoder's logit."""
    if "sequence" not in method.feasibility:
        return jnp.zeros_like(scores.sequence_logit)
    return jax.nn.log_sigmoid(scores.sequence_logit)


def log_feasibility(method: Method, coefficients: Coefficients, scores: Scores) -> Float[Array, "*N"]:
    """log δ̄(τ) = log δ_seq(τ) + Σ_t log δ(s_t, a_t) (Eq. 4's product), or + min_t log δ₁ for the sharpened test."""
    log_step = log_step_feasibility(method, coefficients, scores)
    reduced = log_step.min(axis=-1) if method.step_test == "ratio" else log_step.sum(axis=-1)
    return log_sequence_feasibility(method, scores) + reduced
