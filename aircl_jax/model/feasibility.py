"""δ̄ in log space: from the feasibility networks' logits to log δ of a step and of a trajectory."""

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from aircl_jax.methods import Method
from aircl_jax.settings.train_config import Coefficients
from aircl_jax.types import FeasibilityScores, Scores, Thresholds

RATIO_FLOOR = -10.0  # least log δ of the sharpened test: what an infeasible step costs the policy, in units of reward
PASSED_LOGIT = 3.0  # σ(3) = 0.95: how clearly the demonstrations that pass a calibrated test do
SIGMOID_FLOOR = -11.5  # least log δ of σ(z) in the policy's reward: the published baselines' log(D + 1e-5) for "−∞"

FORBIDDEN_BELOW = 0.5  # δ₁ under which a step, a cell or a value counts as forbidden

AnyScores = Scores | FeasibilityScores


def log_delta(
    method: Method, coefficients: Coefficients, logit: Float[Array, "..."], threshold: Float[Array, "..."]
) -> Float[Array, "..."]:
    """log σ(z); or, of z = log p_E/p_P, the sharpened test max(log σ(k (z − log ϑ)), −10), log ϑ being the threshold."""
    if not method.is_ratio_test:
        return jax.nn.log_sigmoid(logit)
    return jnp.maximum(jax.nn.log_sigmoid(coefficients.sharpness * (logit - threshold)), RATIO_FLOOR)


def calibrate(coefficients: Coefficients, expert: AnyScores) -> Thresholds:
    """log ϑ of both tests: that of the settings, or as much lower as lets a share 1 − α of D_E pass with δ ≥ 0.95.

    Demonstrations are feasible by definition, and the least of many noisy log ratios falls with their number.
    """

    def lowered(least: Float[Array, " N"]) -> Float[Array, ""]:
        passing = jnp.quantile(least, coefficients.false_alarms) - PASSED_LOGIT / coefficients.sharpness
        return jnp.minimum(jnp.log(coefficients.threshold), passing)

    return Thresholds(step=lowered(least_step_logit(expert)), sequence=lowered(expert.sequence_logit))


def least_step_logit(scores: AnyScores) -> Float[Array, "*N"]:
    """min_t z₁ over the unmasked steps of each trajectory."""
    return jnp.where(scores.mask > 0, scores.step_logit, jnp.inf).min(axis=-1)


def log_step_feasibility(method: Method, coefficients: Coefficients, scores: AnyScores) -> Float[Array, "*N T"]:
    """log δ₁(s_t, a_t) of each step; 0 where masked, or where the method has no per-step factor."""
    if not method.tests_steps:
        return jnp.zeros_like(scores.step_logit)
    return log_delta(method, coefficients, scores.step_logit, jnp.log(coefficients.threshold)) * scores.mask


def log_sequence_feasibility(method: Method, coefficients: Coefficients, scores: AnyScores) -> Float[Array, "*N"]:
    """log δ_seq(τ) of the order-aware encoder; 0 where the method has none."""
    if not method.tests_trajectories:
        return jnp.zeros_like(scores.sequence_logit)
    return log_delta(method, coefficients, scores.sequence_logit, scores.thresholds.sequence)


def log_feasibility(method: Method, coefficients: Coefficients, scores: AnyScores) -> Float[Array, "*N"]:
    """log δ̄(τ) = log δ_seq(τ) + Σ_t log δ(s_t, a_t) (Eq. 4's product), or, for the sharpened test, that of min_t z₁."""
    log_sequence = log_sequence_feasibility(method, coefficients, scores)
    if not method.tests_steps or not method.is_ratio_test:
        return log_sequence + log_step_feasibility(method, coefficients, scores).sum(axis=-1)
    return log_sequence + log_delta(method, coefficients, least_step_logit(scores), scores.thresholds.step)
