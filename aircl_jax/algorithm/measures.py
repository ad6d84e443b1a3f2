"""Measure trajectories by pure functions: the paper's measures and ours."""

from typing import Any

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from aircl_jax.algorithm.sampler import effective_sample_size
from aircl_jax.types import Metrics, Trajectory
from envs import Env

GOAL_TOLERANCE = 1e-3
FINITE = "finite"  # name among the metrics of a step


def all_finite(tree: Any) -> Bool[Array, ""]:
    """Say whether every number of a tree is finite."""
    return jnp.stack([jnp.isfinite(leaf).all() for leaf in jax.tree.leaves(tree)]).all()


def violation_rate(trajectories: Trajectory) -> Float[Array, ""]:
    """Compute the paper's violation rate: the share of unmasked timesteps that violate."""
    return (trajectories.cost * trajectories.mask).sum() / jnp.maximum(trajectories.mask.sum(), 1.0)


def infeasible(trajectories: Trajectory) -> Float[Array, " N"]:
    """Return 1 for each trajectory with a violation in any unmasked step, else 0."""
    return (trajectories.cost * trajectories.mask).max(axis=-1)


def undiscounted_return(trajectories: Trajectory) -> Float[Array, ""]:
    """Average Σ_t r_t of the true reward over trajectories."""
    return (trajectories.reward * trajectories.mask).sum(axis=-1).mean()


def feasible_return(trajectories: Trajectory) -> Float[Array, ""]:
    """Average Σ_t r_t up to the first violation over trajectories (Liu et al. 2022)."""
    clean = jnp.cumprod(1.0 - trajectories.cost * trajectories.mask, axis=-1)
    return (trajectories.reward * trajectories.mask * clean).sum(axis=-1).mean()


def goal_rate(trajectories: Trajectory, success_return: float | Float[Array, ""] | None) -> Float[Array, ""]:
    """Compute the share of episodes that end in the goal; NaN in a world without a goal."""
    if success_return is None:
        return jnp.full((), jnp.nan)
    returns = (trajectories.reward * trajectories.mask).sum(axis=-1)
    reached = (returns >= success_return - GOAL_TOLERANCE).astype(returns.dtype)
    return jnp.where(jnp.isnan(returns), jnp.nan, reached).mean()


def auroc(score: Float[Array, " N"], positive: Float[Array, " N"], negative: Float[Array, " N"]) -> Float[Array, ""]:
    """P(score of a positive > score of a negative), ties counted half, both labels weighted; NaN where one is missing."""
    order = jnp.argsort(score)
    ranked = score[order]
    up_to = jnp.cumsum(negative[order] / negative.sum())
    new = jnp.append(True, ranked[1:] != ranked[:-1])  # the first of each group of ties
    below = jax.lax.cummax(jnp.where(new, jnp.append(0.0, up_to[:-1]), 0.0))
    below_or_tied = jax.lax.cummin(jnp.where(jnp.append(new[1:], True), up_to, 1.0), reverse=True)
    area = (positive[order] / positive.sum() * 0.5 * (below + below_or_tied)).sum()
    return jnp.clip(area, 0.0, 1.0)  # of shares whose rounded sum may be a little above 1


def correlation(x: Float[Array, "*B"], y: Float[Array, "*B"], weight: Float[Array, "*B"]) -> Float[Array, ""]:
    """Compute Pearson's correlation with weights; NaN where either variable is constant."""
    weight = weight / weight.sum()
    x, y = x - (weight * x).sum(), y - (weight * y).sum()
    return (weight * x * y).sum() / jnp.sqrt((weight * x**2).sum() * (weight * y**2).sum())


def step_metrics(
    env: Env, sampled: Trajectory, policy: Trajectory, log_delta: Float[Array, " P"], expert_log_delta: Float[Array, " N"]
) -> Metrics:
    """Measure one iteration's batches as drawn before its updates, and δ̄ of D_E after the adversary's update."""
    known = 1.0 if env.has_reward else jnp.nan  # NaN also for a row that assumes r = 0
    return {
        "violation_rate": violation_rate(sampled),
        "violation_rate_policy": violation_rate(policy),
        "infeasible_share": infeasible(sampled).mean(),
        "infeasible_share_policy": infeasible(policy).mean(),
        "return": known * undiscounted_return(policy),
        "return_sampled": known * undiscounted_return(sampled),
        "effective_sample_size": effective_sample_size(log_delta),
        "feasibility_expert": jnp.exp(expert_log_delta).mean(),
        "feasibility_policy": jnp.exp(log_delta).mean(),
        "entropy": -(policy.log_prob * policy.mask).sum() / jnp.maximum(policy.mask.sum(), 1.0),
    }
