"""δ̄ in log space: from the feasibility networks' logits to log δ of a step and of a trajectory."""

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from aircl_jax.config import Coefficients
from aircl_jax.methods import Method
from aircl_jax.types import Scores

RATIO_FLOOR = -10.0  # least log δ of the sharpened test: what an infeasible step costs the policy, in units of reward
SIGMOID_FLOOR = -11.5  # least log δ of σ(z) in the policy's reward: the published baselines' log(D + 1e-5) for "−∞"


def log_delta(method: Method, coefficients: Coefficients, logit: Float[Array, "..."]) -> Float[Array, "..."]:
    """log σ(z); or, of z = log p_E/p_P, the sharpened test max(log σ(k (z − log ϑ)), −10)."""
    if method.test == "sigmoid":
        return jax.nn.log_sigmoid(logit)
    excess = coefficients.sharpness * (logit - jnp.log(coefficients.threshold))
    return jnp.maximum(jax.nn.log_sigmoid(excess), RATIO_FLOOR)


def log_step_feasibility(method: Method, coefficients: Coefficients, scores: Scores) -> Float[Array, "*N T"]:
    """log δ₁(s_t, a_t) of each step; 0 where masked, or where the method has no per-step factor."""
    if "step" not in method.feasibility:
        return jnp.zeros_like(scores.step_logit)
    return log_delta(method, coefficients, scores.step_logit) * scores.mask


def log_sequence_feasibility(method: Method, coefficients: Coefficients, scores: Scores) -> Float[Array, "*N"]:
    """log δ_seq(τ) of the order-aware encoder; 0 where the method has none."""
    if "sequence" not in method.feasibility:
        return jnp.zeros_like(scores.sequence_logit)
    return log_delta(method, coefficients, scores.sequence_logit)


def log_feasibility(method: Method, coefficients: Coefficients, scores: Scores) -> Float[Array, "*N"]:
    """log δ̄(τ) = log δ_seq(τ) + Σ_t log δ(s_t, a_t) (Eq. 4's product), or + min_t log δ₁ for the sharpened test."""
    log_step = log_step_feasibility(method, coefficients, scores)
    reduced = log_step.min(axis=-1) if method.test == "ratio" else log_step.sum(axis=-1)
    return log_sequence_feasibility(method, coefficients, scores) + reduced
