"""What the discriminator says of trajectories or steps: the logits that the loss terms are made of."""

from typing import Any, NamedTuple

import jax
from jaxtyping import Array, Float

from aircl_jax.algorithm.masks import mean_over_steps
from aircl_jax.methods import Method
from aircl_jax.settings.train_config import TrainConfig
from aircl_jax.types import Scores


class Batches(NamedTuple):
    """The four sets of trajectories of one update, or their scores: D_E, D_S, D_P and earlier policies' trajectories."""

    expert: Any
    sampled: Any
    policy: Any
    replay: Any


def trajectory_logit(scores: Scores, reduction: str) -> Float[Array, " N"]:
    """log exp(f(τ)) / π(τ) = f(τ) − log π(τ), f(τ) = Σ_t f; P(s'|s, a) cancels against the model's (Eq. 7 after Eq. 9)."""
    logit = (scores.f - scores.log_pi) * scores.mask
    return logit.sum(axis=-1) if reduction == "sum" else mean_over_steps(logit, scores.mask)


def judge(method: Method, config: TrainConfig, expert: Scores, sampled: Scores) -> tuple[Array, Array]:
    """Logits [N, K] of "expert is high" for both sets; K is 1 for a judge of trajectories, T for a judge of steps.

    centred: h − b with h = f − β log π and b = ½ (mean_E h + mean_S h), no gradient through b.
    """
    if method.judge == "trajectory":
        reduction = config.adversary.trajectory_logit
        return trajectory_logit(expert, reduction)[:, None], trajectory_logit(sampled, reduction)[:, None]
    if method.judge == "feasibility":
        return expert.step_logit, sampled.step_logit
    temperature = config.temperature if method.judge == "centred" else 1.0
    expert_logit, sampled_logit = (one.f - temperature * one.log_pi for one in (expert, sampled))
    if method.judge == "centred":
        expert_mean = mean_over_steps(expert_logit, expert.mask).mean()
        sampled_mean = mean_over_steps(sampled_logit, sampled.mask).mean()
        centre = jax.lax.stop_gradient(0.5 * (expert_mean + sampled_mean))
        return expert_logit - centre, sampled_logit - centre
    return expert_logit, sampled_logit


def verdict(logit: Float[Array, "N K"], mask: Float[Array, "N T"]) -> Float[Array, " N"]:
    """One number a trajectory, of logits or losses: the mean over its steps. D(τ) > ½ where that of the logits is positive."""
    return logit[:, 0] if logit.shape[-1] == 1 else mean_over_steps(logit, mask)
