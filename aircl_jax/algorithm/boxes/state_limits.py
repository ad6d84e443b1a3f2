"""The limits of states: what was met in the demonstrations against what a policy of f alone meets, one limit after the other.

A policy that has gone beyond one limit meets states in which other coordinates are unusual too. So a coordinate is judged by
what the twin meets before it goes beyond a limit of another one, and the coordinate by which it is most tempted is first.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from aircl_jax.algorithm.boxes.action_limits import EDGES, Made, actions_made, limits, numbers, pooled
from aircl_jax.algorithm.pooling import Pool
from aircl_jax.model.features import UNLIMITED
from aircl_jax.model.networks import STD_FLOOR
from aircl_jax.settings.train_config import Coefficients
from aircl_jax.types import ObsStats, Trajectory

PATIENCE = 15  # iterations of the twin after which a limit is drawn, or none is
MARGIN = 0.05  # of the demonstrations' width: what lies further out is off limits until the limits are known

Reach = tuple[Float[Array, "*S O"], Float[Array, "*S O"]]  # least and greatest of what the demonstrations saw


class Scale(NamedTuple):
    """Where an observation is 0 and ±1: in the middle and at the ends of the world in which both policies practise."""

    middle: Float[Array, "*S O"]
    half: Float[Array, "*S O"]

    def of(self, obs: Float[Array, "*N O"]) -> Float[Array, "*N O"]:
        return jnp.clip((obs - self.middle) / self.half, -1.0, 1.0)


class Met(NamedTuple):
    """What the demonstrations met, what the twin meets, and the limits so far, all in the units of `Scale`."""

    made: Made  # n
    share: Float[Array, "O B"]  # M / steps: mean over the iterations since the last limit was drawn
    iterations: Float[Array, ""]  # their number
    lower: Float[Array, "*S O"]  # −UNLIMITED where there is none
    upper: Float[Array, "*S O"]
    tempted: Float[Array, "2 O"]  # M beyond the lower and the upper limit when it was drawn
    settled: Float[Array, ""]  # 1 once none was drawn for as long as it takes


def scale_of(reach: Reach, margin: float | Float[Array, ""]) -> Scale:
    """The scale of a practice world that ends `margin` widths beyond the demonstrations' reach."""
    low, high = reach
    return Scale((low + high) / 2.0, jnp.maximum((0.5 + margin) * (high - low), STD_FLOOR))


def begin(expert: Trajectory, scale: Scale, pool: Pool) -> Met:
    """Count what the demonstrations of all tasks met, and draw no limit."""
    obs = scale.of(expert.obs).reshape(-1, expert.obs.shape[-1])
    made = pooled(actions_made(obs, expert.mask.ravel()), pool)
    none, zero = jnp.full(obs.shape[-1], UNLIMITED, jnp.float32), jnp.zeros(())
    return Met(made, jnp.zeros_like(made.number), zero, -none, none, jnp.zeros((2, obs.shape[-1])), zero)


def reset(met: Met) -> Met:
    """Keep n alone: no twin has met anything, and no limit is drawn."""
    return Met(met.made, *jax.tree.map(jnp.zeros_like, met[1:]))._replace(
        lower=jnp.full_like(met.lower, -UNLIMITED), upper=jnp.full_like(met.upper, UNLIMITED)
    )


def next_limits(
    met: Met, twin: Trajectory, scale: Scale, coefficients: Coefficients, pool: Pool, steps: Float[Array, ""]
) -> Met:
    """Add an iteration's rollouts of the twin, [N, T, …]; draw the limit with the largest M beyond it, where one is tested.

    The shares that the tasks' twins meet are averaged by the demonstrated `steps` of each task, so that M is a sum over tasks.
    The limit itself is that of `action_limits.limits`, with the share of the twin's steps in each bin for that of its actions.
    """
    at = scale.of(twin.obs)
    counted = twin.mask[..., None] * ~beyond_others(at, twin.mask, met)
    seen = numbers(at.reshape(-1, at.shape[-1]), counted.reshape(-1, at.shape[-1])) / twin.mask.sum()
    seen, iterations = pool.mean(seen, steps), met.iterations + 1.0
    share = met.share + (seen - met.share) / iterations
    lower, upper = limits(met.made, share, coefficients)
    new = jnp.stack([(lower > -UNLIMITED) & (met.lower == -UNLIMITED), (upper < UNLIMITED) & (met.upper == UNLIMITED)])
    outside = jnp.stack([EDGES[1:] <= lower[:, None], EDGES[:-1] >= upper[:, None]])
    tempted = (share * met.made.steps * outside).sum(axis=-1) * new
    ready = iterations >= PATIENCE
    draws = ready & new.any()
    chosen = new & (tempted == tempted.max()) & draws
    return Met(
        met.made,
        jnp.where(draws, 0.0, share),
        jnp.where(draws, 0.0, iterations),
        jnp.where(chosen[0], lower, met.lower),
        jnp.where(chosen[1], upper, met.upper),
        jnp.where(chosen, tempted, met.tempted),
        jnp.where(ready & ~draws, 1.0, met.settled),
    )


def beyond_others(at: Float[Array, "N T O"], mask: Float[Array, "N T"], met: Met) -> Bool[Array, "N T O"]:
    """Whether an earlier step, since the world last began, was beyond a limit of another coordinate than this one."""
    outside = (at < met.lower) | (at > met.upper)

    def step(before: Array, now: tuple[Array, Array]) -> tuple[Array, Array]:
        out, counts = now
        before = before & (counts > 0)[:, None]  # a step that does not count is one at which the world begins anew
        return before | out, before

    _, found = jax.lax.scan(step, jnp.zeros(at[:, 0].shape, bool), (outside.swapaxes(0, 1), mask.T))
    gone = found.swapaxes(0, 1)
    return gone.sum(axis=-1, keepdims=True) > gone


def of_observations(met: Met, scale: Scale) -> tuple[Float[Array, "*S O"], Float[Array, "*S O"]]:
    """The limits in the observation's own units; infinite where there is none."""
    lower, upper = (scale.middle + scale.half * limit for limit in (met.lower, met.upper))
    return jnp.where(met.lower > -UNLIMITED, lower, -jnp.inf), jnp.where(met.upper < UNLIMITED, upper, jnp.inf)


def drawn(met: Met, scale: Scale, stats: ObsStats) -> tuple[Float[Array, " O"], Float[Array, " O"]]:
    """The limits in standard deviations of the demonstrations, ∓UNLIMITED where there is none.

    Until they are settled, whatever the demonstrations never met is beyond one: π would go there else, and f would be changed
    to explain why it should not.
    """
    least, greatest = met.made.least.min(axis=1), met.made.greatest.max(axis=1)
    margin, settled = MARGIN * (greatest - least), met.settled > 0
    held = met._replace(
        lower=jnp.where(settled, met.lower, jnp.maximum(met.lower, least - margin)),
        upper=jnp.where(settled, met.upper, jnp.minimum(met.upper, greatest + margin)),
    )
    lower, upper = ((end - stats.mean) / jnp.maximum(stats.std, STD_FLOOR) for end in of_observations(held, scale))
    return jnp.maximum(lower, -UNLIMITED), jnp.minimum(upper, UNLIMITED)
