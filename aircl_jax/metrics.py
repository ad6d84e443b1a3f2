"""What is measured: the paper's metrics and ours, per iteration on the training batches, and on fresh samples at the end."""

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from aircl_jax.adversary import judge, verdict
from aircl_jax.networks import Networks
from aircl_jax.sampler import effective_sample_size
from aircl_jax.types import Metrics, ObsStats, Params, Trajectory


def violation_rate(trajectories: Trajectory) -> Float[Array, ""]:
    """The paper's: the share of unmasked timesteps that violate."""
    return (trajectories.cost * trajectories.mask).sum() / jnp.maximum(trajectories.mask.sum(), 1.0)


def infeasible(trajectories: Trajectory) -> Float[Array, " N"]:
    """1 for each trajectory with a violation in any unmasked step."""
    return (trajectories.cost * trajectories.mask).max(axis=-1)


def undiscounted_return(trajectories: Trajectory) -> Float[Array, ""]:
    """Mean over trajectories of Σ_t r_t, the true one."""
    return (trajectories.reward * trajectories.mask).sum(axis=-1).mean()


def step_metrics(
    nets: Networks,
    params: Params,
    stats: ObsStats,
    expert: Trajectory,
    sampled: Trajectory,
    policy: Trajectory,
    log_delta: Float[Array, " P"],
) -> Metrics:
    """The measures of one iteration's batches, before its update."""
    return {
        "violation_rate": violation_rate(sampled),
        "violation_rate_policy": violation_rate(policy),
        "infeasible_share": infeasible(sampled).mean(),
        "infeasible_share_policy": infeasible(policy).mean(),
        "return": undiscounted_return(policy),
        "return_sampled": undiscounted_return(sampled),
        "effective_sample_size": effective_sample_size(log_delta),
        "entropy": -(policy.log_prob * policy.mask).sum() / policy.mask.sum(),
    }
