"""The reward and the limits of the contrast row where actions are of a box: a sum of features, and a box for each step."""

import flax.linen as nn
import jax.numpy as jnp
from jaxtyping import Array, Float

FEATURE_BOUND = 3.0  # standard deviations of a coordinate, beyond which its square says no more
UNLIMITED = 100.0  # half-widths of a box, or standard deviations: a limit that no action and no observation reaches
LIMIT_SLOPE = 50.0  # of a logit, in the same units: a tenth beyond a limit is as good as forbidden


def features(x: Float[Array, " I"]) -> Float[Array, " K"]:
    """φ(s̃): each coordinate, and half of each one's square, of at most 3 standard deviations."""
    return jnp.concatenate([x, 0.5 * jnp.minimum(x**2, FEATURE_BOUND**2)])


class FeatureReward(nn.Module):
    """Σ_k θ_k φ_k(s̃), 0 at the start."""

    @nn.compact
    def __call__(self, x: Float[Array, " I"]) -> Float[Array, " 1"]:
        phi = features(x)
        return (phi @ self.param("weights", nn.initializers.zeros, phi.shape))[None]


class Limits(nn.Module):
    """How far within its limits a step is, times a slope: 0 on the line. There is no limit at the start.

    States are in standard deviations of the demonstrations, actions in half-widths of their box.
    """

    @nn.compact
    def __call__(self, x: Float[Array, " I"]) -> Float[Array, " 1"]:
        lower = self.param("lower", nn.initializers.constant(-UNLIMITED), x.shape)
        upper = self.param("upper", nn.initializers.constant(UNLIMITED), x.shape)
        within = jnp.minimum(upper - x, x - lower).min()
        return (LIMIT_SLOPE * within)[None]
