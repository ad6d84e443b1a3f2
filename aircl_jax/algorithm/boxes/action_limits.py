"""The limits of actions: those made in the demonstrations against those that a tempted policy would make in the same states."""

from functools import partial
from typing import NamedTuple

import jax
import jax.numpy as jnp
from jax.scipy.stats import norm
from jaxtyping import Array, Bool, Float, Int

from aircl_jax.algorithm.pooling import Pool
from aircl_jax.model.features import UNLIMITED
from aircl_jax.settings.train_config import Coefficients

BINS = 180  # of an action's box
WINDOW = 50.0  # expected actions by which a bin is judged together with those next to it: fewer than a lapse would outweigh
EDGE = 5  # bins beyond the last that is used often, in which a few demonstrations still say where the limit is
EDGES = jnp.linspace(-1.0, 1.0, BINS + 1)  # half-widths from the middle


class Made(NamedTuple):
    """The actions of the demonstrations: how many fall in each bin, and the one in it that is furthest out on either side."""

    number: Float[Array, "A B"]  # n
    least: Float[Array, "A B"]
    greatest: Float[Array, "A B"]
    steps: Float[Array, ""]


def actions_made(action: Float[Array, "M A"], mask: Float[Array, " M"]) -> Made:
    """Count actions, in half-widths of their box and clipped to it."""

    def ends(values: Float[Array, " M"], bins: Array) -> tuple[Array, Array]:
        least = jnp.full(BINS, UNLIMITED).at[bins].min(jnp.where(mask > 0, values, UNLIMITED))
        greatest = jnp.full(BINS, -UNLIMITED).at[bins].max(jnp.where(mask > 0, values, -UNLIMITED))
        return least, greatest

    number = numbers(action, jnp.broadcast_to(mask[:, None], action.shape))
    return Made(number, *jax.vmap(ends, 1)(action, _bins(action)), mask.sum())


def pooled(made: Made, pool: Pool) -> Made:
    """What the demonstrations of all tasks made."""
    return Made(pool.total(made.number), pool.least(made.least), pool.greatest(made.greatest), pool.total(made.steps))


def numbers(values: Float[Array, "M I"], counts: Float[Array, "M I"]) -> Float[Array, "I B"]:
    """Sum the counts of each coordinate's values in each bin."""
    return jax.vmap(lambda bins, weights: jnp.zeros(BINS).at[bins].add(weights), 1)(_bins(values), counts)


def _bins(values: Float[Array, "M I"]) -> Int[Array, "M I"]:
    return jnp.clip(((values + 1.0) / 2.0 * BINS).astype(jnp.int32), 0, BINS - 1)


def share_expected(
    mean: Float[Array, "M A"], std: Float[Array, " A"], action: Float[Array, "M A"], mask: Float[Array, " M"]
) -> Float[Array, "A B"]:
    """Mean over states of P(clip(ã_i) in each bin), ã ~ N(mean(s), std), where the demonstrated a_i is on that bin's side.

    Sides are those of the box's middle. Elsewhere the two do not want the same, and no limit says why. Nothing is drawn.
    """
    below = norm.cdf((EDGES[1:-1] - mean[..., None]) / std[:, None])  # [M, A, B − 1]
    weight = jnp.stack([action < 0.0, action > 0.0]) * mask[:, None] / mask.sum()  # [2, M, A]
    inner = jnp.einsum("mab,sma->sab", below, weight)
    whole = weight.sum(axis=1)[..., None]
    of_sides = jnp.diff(jnp.concatenate([jnp.zeros_like(whole), inner, whole], axis=-1), axis=-1)
    return jnp.where(jnp.arange(BINS) < BINS // 2, of_sides[0], of_sides[1])


def limits(made: Made, share: Float[Array, "A B"], coefficients: Coefficients) -> tuple[Float[Array, " A"], Float[Array, " A"]]:
    """Return the lower and the upper limit of each action; ∓UNLIMITED where there is none.

    M = share × steps. A bin is used where (n + ε) / (M + ε) ≥ ϑ, both summed from it outwards until M is at least `WINDOW`.
    So are those of the next `EDGE` bins in which more was done than by lapses, whose number in a bin is the mean further out.
    The limit is the outermost demonstrated action of the bins up to the last used one, where at least `least_expected` actions
    would have been beyond it and hardly any was: n ≤ ϑ M.
    """
    expected = share * made.steps
    outermost = jax.vmap(partial(_outermost, coefficients))
    upper = outermost(made.number, expected, made.greatest)
    lower = outermost(made.number[:, ::-1], expected[:, ::-1], -made.least[:, ::-1])
    return -lower, upper


def _outermost(coefficients: Coefficients, number: Array, expected: Array, greatest: Array) -> Float[Array, ""]:
    bins = jnp.arange(BINS)
    first = jnp.where(_used(coefficients, number, expected), bins, -1).max()
    further = bins > first + EDGE
    lapses = jnp.where(further, number, 0.0).sum() / jnp.maximum(further.sum(), 1)
    done = ~further & (bins > first) & (number > lapses + 3.0 * jnp.sqrt(lapses))
    last = jnp.where(done, bins, first).max()
    outside = bins > last
    made, tempted = (jnp.where(outside, count, 0.0).sum() for count in (number, expected))
    limit = jnp.where(outside, -UNLIMITED, greatest).max()
    known = (tempted >= coefficients.least_expected) & (made <= coefficients.threshold * tempted) & (first >= 0)
    return jnp.where(known, limit, UNLIMITED)


def _used(coefficients: Coefficients, number: Float[Array, " B"], expected: Float[Array, " B"]) -> Bool[Array, " B"]:
    """Whether n/M is ϑ or more from each bin outwards; where too little is expected outwards, nothing is known.

    A bin with no more than lapses explain is not used: from it outwards at most ϑ of all M was done, and in it not more than
    chance makes of the mean of these bins.
    """
    up_to = jnp.cumsum(expected)
    end = jnp.searchsorted(up_to, up_to - expected + WINDOW)  # the first bin up to which M is that much
    known, end = end < BINS, jnp.minimum(end, BINS - 1)
    made, tempted = (jnp.cumsum(count)[end] - jnp.cumsum(count) + count for count in (number, expected))
    often = (made + coefficients.pseudo_count) / (tempted + coefficients.pseudo_count) >= coefficients.threshold
    all_made, all_tempted, bins = (jnp.cumsum(count[::-1])[::-1] for count in (number, expected, jnp.ones(BINS)))
    by_chance = number <= all_made / bins + 5.0 * jnp.sqrt(all_made / bins)  # five deviations: none of all bins by chance
    return known & often & ~(by_chance & (all_made <= coefficients.threshold * all_tempted))
