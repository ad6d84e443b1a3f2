"""Find the nearest action that passes a test: within limits, by a test that is a sum over motors, or among draws."""

from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Shaped

HALVINGS = 24  # of the multiplier: it is then exact to a part in 10⁷
HALVINGS_OF_A_WAY = 10  # between two actions: a thousandth of their distance is left
STEEPEST = 1e4  # greatest multiplier, in squared distance per unit of the test's logit


def nearest_by_sum(
    wanted: Float[Array, " A"], values: Float[Array, "A K"], gain: Float[Array, "A K"], least: Float[Array, ""]
) -> Float[Array, " A"]:
    """argmin_a Σ_i (a_i − w_i)² subject to Σ_i g_i(a_i) ≥ c, where a_i takes the values of its row; g_i are their gains.

    For a multiplier λ each a_i minimises (a_i − w_i)² − λ g_i(a_i) by itself; the least λ that passes is found by halving
    log λ. Where not even the greatest λ passes, the a with the greatest sum is returned.
    """
    apart = (values - wanted[:, None]) ** 2

    def chosen(multiplier: Float[Array, ""]) -> Shaped[Array, " A"]:
        return jnp.argmin(apart - multiplier * gain, axis=1)

    def of(places: Shaped[Array, " A"], table: Float[Array, "A K"]) -> Float[Array, " A"]:
        return jnp.take_along_axis(table, places[:, None], axis=1)[:, 0]

    def halve(_: Any, ends: tuple[Array, Array]) -> tuple[Array, Array]:
        low, high = ends
        middle = (low + high) / 2
        passes = of(chosen(jnp.exp(middle)), gain).sum() >= least
        return jnp.where(passes, low, middle), jnp.where(passes, middle, high)

    span = jnp.log(jnp.asarray(STEEPEST))
    _, passing = jax.lax.fori_loop(0, HALVINGS, halve, (-span, span))
    places = chosen(jnp.exp(passing))
    best = jnp.argmax(gain, axis=1)
    return of(jnp.where(of(places, gain).sum() >= least, places, best), values)


def nearest_of(
    wanted: Shaped[Array, "*A"],
    candidates: Shaped[Array, "M *A"],
    feasible: Bool[Array, " M"],
    score: Float[Array, " M"],
) -> Shaped[Array, "*A"]:
    """Return the feasible candidate that is nearest to what was wanted; where none is feasible, that of the greatest score."""
    apart = ((candidates - wanted) ** 2).reshape(len(candidates), -1).sum(axis=1)
    place = jnp.where(feasible.any(), jnp.argmin(jnp.where(feasible, apart, jnp.inf)), jnp.argmax(score))
    return candidates[place]


def closer(
    wanted: Float[Array, " A"], other: Float[Array, " A"], passes: Callable[[Array], Bool[Array, ""]]
) -> Float[Array, " A"]:
    """Move a feasible action towards the wanted one by halving their distance, as far as it passes."""

    def halve(_: Any, ends: tuple[Array, Array]) -> tuple[Array, Array]:
        far, near = ends  # shares of the way: passes, does not
        middle = (far + near) / 2
        passing = passes(other + middle * (wanted - other))
        return jnp.where(passing, middle, far), jnp.where(passing, near, middle)

    share, _ = jax.lax.fori_loop(0, HALVINGS_OF_A_WAY, halve, (jnp.zeros(()), jnp.ones(())))
    return other + share * (wanted - other)


def first_of(draws: Shaped[Array, " M"], feasible: Bool[Array, " M"], best: Shaped[Array, ""]) -> Shaped[Array, ""]:
    """Return the first feasible draw, whose law is the controller's on what is feasible; `best` where none is."""
    return jnp.where(feasible.any(), draws[jnp.argmax(feasible)], best)
