"""The limits of actions: those made in the demonstrations against those that a tempted policy would make in the same states."""

from functools import partial
from typing import NamedTuple

import jax
import jax.numpy as jnp
from jax.scipy.stats import norm
from jaxtyping import Array, Float

from aircl_jax.model.features import UNLIMITED
from aircl_jax.settings.train_config import Coefficients

BINS = 180  # of an action's box
EDGES = jnp.linspace(-1.0, 1.0, BINS + 1)  # half-widths from the middle


class Made(NamedTuple):
    """The actions of the demonstrations: how many fall in each bin, and the one in it that is furthest out on either side."""

    number: Float[Array, "A B"]  # n
    least: Float[Array, "A B"]
    greatest: Float[Array, "A B"]
    steps: Float[Array, ""]


def actions_made(action: Float[Array, "M A"], mask: Float[Array, " M"]) -> Made:
    """Count actions, in half-widths of their box and clipped to it."""
    index = jnp.clip(((action + 1.0) / 2.0 * BINS).astype(jnp.int32), 0, BINS - 1)

    def of_one(values: Float[Array, " M"], bins: Array) -> tuple[Array, Array, Array]:
        number = jnp.zeros(BINS).at[bins].add(mask)
        least = jnp.full(BINS, UNLIMITED).at[bins].min(jnp.where(mask > 0, values, UNLIMITED))
        greatest = jnp.full(BINS, -UNLIMITED).at[bins].max(jnp.where(mask > 0, values, -UNLIMITED))
        return number, least, greatest

    return Made(*jax.vmap(of_one, 1)(action, index), mask.sum())


def share_expected(mean: Float[Array, "M A"], std: Float[Array, " A"], mask: Float[Array, " M"]) -> Float[Array, "A B"]:
    """Mean over states of P(clip(ã_i) in each bin), ã ~ N(mean(s), std): nothing is drawn."""
    below = norm.cdf((EDGES[1:-1] - mean[..., None]) / std[:, None])  # [M, A, B − 1]
    below = jnp.einsum("mab,m->ab", below, mask) / mask.sum()
    ends = jnp.zeros((below.shape[0], 1))
    return jnp.diff(jnp.concatenate([ends, below, ends + 1.0], axis=1), axis=1)


def limits(made: Made, share: Float[Array, "A B"], coefficients: Coefficients) -> tuple[Float[Array, " A"], Float[Array, " A"]]:
    """Return the lower and the upper limit of each action; ∓UNLIMITED where there is none.

    A bin is used where (n + ε) / (M + ε) ≥ ϑ, M = share × steps. The limit is the outermost demonstrated action of the bins
    up to the last used one, where at least `least_expected` actions would have been beyond it and hardly any was: n ≤ ϑ M.
    """
    expected = share * made.steps
    ratio = (made.number + coefficients.pseudo_count) / (expected + coefficients.pseudo_count)
    used = ratio >= coefficients.threshold
    outermost = jax.vmap(partial(_outermost, coefficients))
    upper = outermost(used, made.number, expected, made.greatest)
    lower = outermost(used[:, ::-1], made.number[:, ::-1], expected[:, ::-1], -made.least[:, ::-1])
    return -lower, upper


def _outermost(coefficients: Coefficients, used: Array, number: Array, expected: Array, greatest: Array) -> Float[Array, ""]:
    last = jnp.where(used, jnp.arange(BINS), -1).max()
    outside = jnp.arange(BINS) > last
    made, tempted = (jnp.where(outside, count, 0.0).sum() for count in (number, expected))
    limit = jnp.where(outside, -UNLIMITED, greatest).max()
    known = (tempted >= coefficients.least_expected) & (made <= coefficients.threshold * tempted) & (last >= 0)
    return jnp.where(known, limit, UNLIMITED)
