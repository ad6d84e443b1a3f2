"""Compute the limits that δ₁ draws: for each coordinate, where demonstrated steps become infeasible as it alone is moved."""

from functools import partial
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from aircl_jax.algorithm.boxes import state_limits
from aircl_jax.model.feasibility import FORBIDDEN_BELOW, log_step_feasibility
from aircl_jax.model.features import UNLIMITED
from aircl_jax.model.networks import Networks
from aircl_jax.runs.result import Result
from aircl_jax.types import FeasibilityScores, TrainState
from envs import Box

STEPS = 100  # demonstrated steps that are moved
POINTS = 81  # values that each coordinate takes
LAPSES = 0.01  # share of the demonstrated steps that may lie beyond a limit: what is done more often is not forbidden


class Limits(NamedTuple):
    """The limits of every seed and coordinate, NaN where δ₁ draws none, and how far the demonstrations go."""

    names: tuple[str, ...]
    lower: Float[np.ndarray, "S I"]
    upper: Float[np.ndarray, "S I"]
    least: Float[np.ndarray, " I"]  # of the demonstrations
    greatest: Float[np.ndarray, " I"]


def recovered_limits(result: Result) -> Limits | None:
    """Move one coordinate of demonstrated steps at a time; None where δ₁ is not of a robot's coordinates.

    A limit is the first value, going out from the demonstrations' median, at which the mean of δ₁ falls below ½. It is NaN
    where more than 1 % of the demonstrated steps lie beyond it: δ₁ then flags what is rare with the other coordinates as
    they are, and bounds nothing.
    """
    nets, space = result.networks, result.spec.env.action_space
    if not nets.method.tests_steps or not isinstance(space, Box):
        return None
    if nets.method.has_twin:
        return _limits_as_parameters(result)
    seen, number = demonstrated_steps(result), result.spec.env.obs_size
    least, greatest = seen.min(axis=0), seen.max(axis=0)
    width = greatest - least
    low, high = least - width, greatest + width  # as far again as the demonstrations go
    low[number:], high[number:] = space.low, space.high
    grid = np.linspace(low, high, POINTS)  # [K, I]
    moved = seen[np.linspace(0, len(seen) - 1, min(STEPS, len(seen))).astype(int)]
    delta = np.asarray(
        jax.vmap(partial(mean_delta, nets), (0, None, None))(result.states, jnp.asarray(grid), jnp.asarray(moved))
    )
    middle = np.median(seen, axis=0)
    names = (*result.spec.env.coordinate_names, *result.spec.env.motor_names)
    shown = [
        index
        for index in range(len(names))
        if (nets.feasibility_sees_state if index < number else nets.feasibility_sees_action)
    ]
    ends = np.array([[limits_of(grid[:, i], one[:, i], float(middle[i])) for i in shown] for one in delta])
    lower, upper = (
        np.where(beyond(seen[:, shown], ends[..., side], side) <= LAPSES, ends[..., side], np.nan) for side in (0, 1)
    )
    return Limits(tuple(names[i] for i in shown), lower, upper, least[shown], greatest[shown])


def measures_of_limits(nets: Networks, states: TrainState) -> dict[str, Float[np.ndarray, " S"]]:
    """{recovered_limit/COORDINATE/upper|lower: [S]} of a row that has limits as parameters, NaN where none; else empty.

    `untested` is the share of these that are none.
    """
    if not nets.method.has_twin:
        return {}
    lower, upper = _drawn(nets, states)
    return {"untested": np.isnan([lower, upper]).mean(axis=(0, 2))} | {
        f"recovered_limit/{name}/{side}": values[:, index]
        for index, name in enumerate(names_of_inputs(nets))
        for side, values in (("upper", upper), ("lower", lower))
    }


def names_of_inputs(nets: Networks) -> tuple[str, ...]:
    """Name what the limits are of: coordinates of the state, or motors."""
    return nets.env.coordinate_names if nets.feasibility_sees_state else nets.env.motor_names


def _limits_as_parameters(result: Result) -> Limits:
    """Read the limits that the row has as parameters."""
    nets, number = result.networks, result.spec.env.obs_size
    steps = demonstrated_steps(result)
    seen = steps[:, :number] if nets.feasibility_sees_state else steps[:, number:]
    return Limits(names_of_inputs(nets), *_drawn(nets, result.states), seen.min(axis=0), seen.max(axis=0))


def _drawn(nets: Networks, states: TrainState) -> tuple[Float[np.ndarray, "S I"], Float[np.ndarray, "S I"]]:
    """Lower and upper limits, [S, I], in the unit of each coordinate; NaN where there is none.

    Of states those that were drawn: until they are settled, δ₁ also forbids whatever the demonstrations never met.
    """
    space, of, contrast = nets.env.action_space, states.params.feasibility["step"]["params"], states.adversary_opt
    if not isinstance(space, Box):
        raise TypeError(f"actions of {nets.env.name} are numbered")
    if nets.feasibility_sees_state:
        ends = state_limits.of_observations(contrast.met, state_limits.scale_of(contrast.reach, nets.config.moments.margin))
    else:
        ends = (
            jnp.where(jnp.abs(of[side]) < UNLIMITED, space.from_half_widths(of[side]), jnp.inf) for side in ("lower", "upper")
        )
    lower, upper = (np.asarray(jnp.where(jnp.isfinite(end), end, jnp.nan), float) for end in ends)
    return lower, upper


def demonstrated_steps(result: Result) -> Float[np.ndarray, "N I"]:
    """Return the unmasked steps of the first seed's D_E, (s, a), as the world takes the action. Raises TypeError off a Box."""
    space, unmasked = result.spec.env.action_space, np.asarray(result.expert.mask[0]) > 0
    if not isinstance(space, Box):
        raise TypeError(f"actions of {result.spec.env.name} are numbered")
    obs, action = np.asarray(result.expert.obs[0])[unmasked], np.asarray(result.expert.action[0])[unmasked]
    return np.concatenate([obs, np.clip(action, space.low, space.high)], axis=1)


def beyond(seen: Float[np.ndarray, "N I"], limits: Float[np.ndarray, "S I"], side: int) -> Float[np.ndarray, "S I"]:
    """Compute the share of demonstrated steps below the limits (side 0) or above them (side 1); 0 where there is none."""
    outside = [(seen < limit if side == 0 else seen > limit).mean(axis=0) for limit in limits]
    return np.array(outside)


def mean_delta(nets: Networks, state: TrainState, grid: Float[Array, "K I"], steps: Float[Array, "M I"]) -> Float[Array, "K I"]:
    """Compute the mean of δ₁ over the steps with coordinate i at each of its values, the others as they are."""
    bound, number = nets.bind(state.params, state.obs_stats), nets.env.obs_size

    def delta(step: Float[Array, " I"]) -> Float[Array, ""]:
        logit = bound.step_logit(step[:number], step[number:])
        scores = FeasibilityScores(logit[None], jnp.zeros(()), jnp.ones(1), state.params.thresholds)
        return jnp.exp(log_step_feasibility(nets.method, nets.config.coefficients, scores)[0])

    def at(index: Array, value: Array) -> Float[Array, ""]:
        return jax.vmap(lambda step: delta(step.at[index].set(value)))(steps).mean()

    return jax.vmap(jax.vmap(at), (None, 0))(jnp.arange(grid.shape[1]), grid)


def limits_of(grid: Float[np.ndarray, " K"], delta: Float[np.ndarray, " K"], middle: float) -> tuple[float, float]:
    """Find the first values below and above the middle at which δ falls below ½, interpolated; NaN where it never does."""

    def first(values: np.ndarray, along: np.ndarray) -> float:
        below = np.flatnonzero(along < FORBIDDEN_BELOW)
        if not len(below):
            return float("nan")
        at = below[0]
        if at == 0:
            return float(values[0])
        return float(np.interp(FORBIDDEN_BELOW, along[[at, at - 1]], values[[at, at - 1]]))

    under, over = grid <= middle, grid >= middle
    return first(grid[under][::-1], delta[under][::-1]), first(grid[over], delta[over])
