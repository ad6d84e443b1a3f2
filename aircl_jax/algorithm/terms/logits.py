"""Compute the discriminator's logits of trajectories or steps, from which the loss terms are built."""

from collections.abc import Callable
from typing import Any, NamedTuple

import jax
from jaxtyping import Array, Float

from aircl_jax.algorithm.masks import mean_over_steps
from aircl_jax.methods import Method
from aircl_jax.settings.train_config import TrainConfig
from aircl_jax.types import Scores


class StateScores(NamedTuple):
    """What is said of each observed state O of a finite world, and how often it was entered in D_E."""

    reward: Float[Array, " O"]  # g(s)
    potential: Float[Array, " P"]  # the slopes of h
    step_logit: Float[Array, " O"]  # z(s) of entering s
    entered: Float[Array, " O"]  # n: how often D_E's actions aim at s from another state
    expected: Float[Array, " O"]  # M: how often they would, were entering s alone ordinary
    demonstrations: Float[Array, ""]  # N of D_E
    expert_f: Float[Array, ""]  # E_E[f(τ)]
    model_f: Float[Array, ""]  # E_p[f(τ)] of the model, exactly, of episodes that begin where D_E's do


class Batches(NamedTuple):
    """The four sets of trajectories of one update, or their scores: D_E, D_S, D_P and earlier policies' trajectories."""

    expert: Any
    sampled: Any
    policy: Any
    replay: Any
    states: Any = None  # StateScores, beside the scores of a row with a reward of states

    @property
    def sets(self) -> tuple[Any, Any, Any, Any]:
        """Return the four sets without what is said of states."""
        return self.expert, self.sampled, self.policy, self.replay


def trajectory_logit(scores: Scores, reduction: str) -> Float[Array, " N"]:
    """log exp(f(τ)) / π(τ) = f(τ) − log π(τ), f(τ) = Σ_t f; P(s'|s, a) cancels against the model's (Eq. 7 after Eq. 9)."""
    logit = (scores.f - scores.log_pi) * scores.mask
    return logit.sum(axis=-1) if reduction == "sum" else mean_over_steps(logit, scores.mask)


def of_trajectories(config: TrainConfig, scores: Scores) -> Float[Array, "N 1"]:
    """Return one logit per trajectory, f(τ) − log π(τ)."""
    return trajectory_logit(scores, config.adversary.trajectory_logit)[:, None]


def of_steps(config: TrainConfig, scores: Scores) -> Float[Array, "N T"]:
    """Return one logit per step, f − log π."""
    return scores.f - scores.log_pi


def of_feasibility(config: TrainConfig, scores: Scores) -> Float[Array, "N T"]:
    """Return one logit per step, the feasibility's own, which is GACL's discriminator."""
    return scores.step_logit


LOGITS: dict[str, Callable[[TrainConfig, Scores], Array]] = {
    "trajectory": of_trajectories,
    "step": of_steps,
    "feasibility": of_feasibility,
}


def discriminator_logits(method: Method, config: TrainConfig, expert: Scores, sampled: Scores) -> tuple[Array, Array]:
    """Compute both sets' logits [N, K], high for the expert; K is 1 for a discriminator of trajectories, T for one of steps."""
    if method.centred:
        return centred_logits(config, expert, sampled)
    logit = LOGITS[method.discriminator_of]
    return logit(config, expert), logit(config, sampled)


def centred_logits(config: TrainConfig, expert: Scores, sampled: Scores) -> tuple[Float[Array, "N T"], Float[Array, "M T"]]:
    """h − b of each step, with h = f − β log π and b = ½ (mean_E h + mean_S h); no gradient through b."""
    expert_logit, sampled_logit = (batch.f - config.temperature * batch.log_pi for batch in (expert, sampled))
    expert_mean = mean_over_steps(expert_logit, expert.mask).mean()
    sampled_mean = mean_over_steps(sampled_logit, sampled.mask).mean()
    centre = jax.lax.stop_gradient(0.5 * (expert_mean + sampled_mean))
    return expert_logit - centre, sampled_logit - centre


def per_trajectory(logit: Float[Array, "N K"], mask: Float[Array, "N T"]) -> Float[Array, " N"]:
    """Average logits or losses over each trajectory's steps. D(τ) > ½ where the average of the logits is positive."""
    return logit[:, 0] if logit.shape[-1] == 1 else mean_over_steps(logit, mask)
