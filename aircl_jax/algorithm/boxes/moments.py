"""The reward of a world without a table: θ of Σ θ_k φ_k(s) by the moments of Eq. 6, sparse, and of a fixed norm."""

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Int

from aircl_jax.model.features import features
from aircl_jax.model.networks import BoundNetworks
from aircl_jax.settings.train_config import MomentConfig
from aircl_jax.types import Trajectory


class Weights(NamedTuple):
    """θ, and its mean over the later part of the run: what is learned."""

    now: Float[Array, " K"]
    mean: Float[Array, " K"]


def next_weights(
    weights: Weights, gap: Float[Array, " K"], step: Int[Array, ""], iterations: int, config: MomentConfig
) -> Weights:
    """θ ← shrink(θ + α (E_E φ − E_π φ)), its norm at most B and never less than before, and B from `sphere` iterations on.

    shrink(θ)_k = θ_k max(0, 1 − α λ / |θ_k|), so that what explains nothing is 0; a θ that would vanish whole is not shrunk.
    The gradient of Eq. 6 has no unit of time, so it is descended plainly: θ adds up the gaps. Without the kept norm θ would
    fall to 0 once the means agree, and chance would say where it goes next.
    """
    moved = weights.now + config.rate * gap
    shrunk = moved * jnp.maximum(0.0, 1.0 - config.rate * config.sparsity / jnp.maximum(jnp.abs(moved), 1e-12))
    now = jnp.where(jnp.linalg.norm(shrunk) > 1e-3, shrunk, moved)
    least = jnp.where(step >= config.sphere, config.norm, jnp.linalg.norm(weights.now))
    size = jnp.linalg.norm(now) + 1e-9
    now = now * jnp.clip(size, least, config.norm) / size
    first = config.averaged_from * iterations
    averaged = weights.mean + (now - weights.mean) / jnp.maximum(1.0, 1.0 + step - first)
    return Weights(now, jnp.where(step < first, now, averaged))


def size_of(gap: Float[Array, " K"]) -> Float[Array, ""]:
    """Root mean square over the features."""
    return jnp.sqrt((gap**2).mean())


def mean_features(nets: BoundNetworks, trajectories: Trajectory) -> Float[Array, " K"]:
    """Mean of φ(s̃) over the unmasked steps of a set, [N, T, …]."""
    phi = jax.vmap(jax.vmap(lambda obs: features(nets.normalise(obs))))(trajectories.obs)
    return jnp.einsum("ntk,nt->k", phi, trajectories.mask) / trajectories.mask.sum()
