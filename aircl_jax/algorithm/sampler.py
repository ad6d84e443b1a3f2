"""Draw D_S from policy trajectories by their feasibility, q(τ) ∝ π(τ) · δ̄(τ) (Eq. 9; Algorithm 1, line 3); keep a replay."""

from typing import Any

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Int, PRNGKeyArray

from aircl_jax.types import Trajectory

MIN_EFFECTIVE_SHARE = 0.1  # effective sample size below which a few trajectories hold all weight, so that draws are uniform


def effective_sample_size(log_delta: Float[Array, " N"]) -> Float[Array, ""]:
    """(Σ w)² / (N Σ w²) of the weights w = δ̄: 1 when all are equal, 1/N when one has everything (Kish 1965)."""
    log_sum = jax.nn.logsumexp(log_delta)
    log_sum_squares = jax.nn.logsumexp(2.0 * log_delta)
    return jnp.exp(2.0 * log_sum - log_sum_squares) / log_delta.shape[0]


def resample(log_delta: Float[Array, " P"], number: int, key: PRNGKeyArray) -> Int[Array, " N"]:
    """Draw N indices with p ∝ δ̄ by systematic resampling; uniformly where the effective share is below a tenth."""
    degenerate = effective_sample_size(log_delta) < MIN_EFFECTIVE_SHARE
    probability = jax.nn.softmax(jnp.where(degenerate, jnp.zeros_like(log_delta), log_delta))
    return _systematic(probability, number, key)


def reject(log_delta: Float[Array, " P"], number: int, key: PRNGKeyArray) -> Int[Array, " N"]:
    """Draw N indices among those accepted with probability δ̄(τ) (Eq. 9 read as rejection); uniformly where none is."""
    key_accept, key_draw = jax.random.split(key)
    accepted = (jnp.log(jax.random.uniform(key_accept, log_delta.shape)) < log_delta).astype(jnp.float32)
    weight = jnp.where(accepted.sum() > 0, accepted, jnp.ones_like(accepted))
    return _systematic(weight / weight.sum(), number, key_draw)


SAMPLERS = {"resample": resample, "reject": reject}


def take(tree: Any, index: Int[Array, " N"]) -> Any:
    """Take the rows of these indices from every leaf of a tree such as trajectories, [N, T, …]."""
    return jax.tree.map(lambda leaf: leaf[index], tree)


def _systematic(probability: Float[Array, " P"], number: int, key: PRNGKeyArray) -> Int[Array, " N"]:
    """Draw one uniform offset and take N even strides through the cumulative probability: unbiased as N draws, less noisy."""
    positions = (jnp.arange(number) + jax.random.uniform(key)) / number
    cumulative = jnp.cumsum(probability)
    return jnp.searchsorted(cumulative / cumulative[-1], positions, method="compare_all").clip(0, len(probability) - 1)


def refresh(replay: Trajectory, policy: Trajectory, key: PRNGKeyArray, rate: float) -> Trajectory:
    """Overwrite each slot of the replay with this iteration's trajectory with probability `rate`."""
    fresh = jax.random.bernoulli(key, rate, (policy.mask.shape[0],))
    return jax.tree.map(lambda old, new: jnp.where(fresh.reshape(-1, *[1] * (old.ndim - 1)), new, old), replay, policy)
