"""Average over the unmasked steps of trajectories."""

import jax.numpy as jnp
from jaxtyping import Array, Float


def mean_over_steps(x: Float[Array, "N T"], mask: Float[Array, "N T"]) -> Float[Array, " N"]:
    """Average over the unmasked steps of each trajectory."""
    return (x * mask).sum(axis=-1) / jnp.maximum(mask.sum(axis=-1), 1.0)


def masked_mean(x: Float[Array, "*B"], mask: Float[Array, "*B"]) -> Float[Array, ""]:
    """Average over unmasked steps; 0 where there is none."""
    return (x * mask).sum() / jnp.maximum(mask.sum(), 1.0)
