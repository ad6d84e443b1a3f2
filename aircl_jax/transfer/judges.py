"""Say of one action what a run's constraint says of it, and which action is nearest that passes."""

import math
from collections.abc import Callable
from typing import Literal, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Shaped

from aircl_jax.algorithm.learners.scale_free import Motors
from aircl_jax.analysis.recovered_limits import STEPS, demonstrated_steps, mean_delta, recovered_limits
from aircl_jax.model.feasibility import FORBIDDEN_BELOW, log_step_feasibility
from aircl_jax.model.modules import AdditiveNet
from aircl_jax.model.networks import BoundNetworks
from aircl_jax.runs.result import Result
from aircl_jax.transfer.projections import nearest_by_sum
from aircl_jax.types import FeasibilityScores
from envs import Box, Discrete

VALUES = 201  # that the projection tries of each motor

Kind = Literal["default", "limits", "sum", "draws"]


class Judge(NamedTuple):
    """What decides on one step: functions of (obs, action), the action within its box."""

    delta: Callable[[Array, Array], Float[Array, ""]]  # δ₁, or 1 and 0 within and beyond limits
    nearest: Callable[[Array, Array], Array] | None  # None: choose among draws
    words: str  # how it decides

    def feasible(self, obs: Float[Array, " O"], action: Shaped[Array, "*A"]) -> Bool[Array, ""]:
        return self.delta(obs, action) >= FORBIDDEN_BELOW


class ActionLimits(NamedTuple):
    """The box that a run has recovered, infinite where it draws no limit."""

    low: Float[np.ndarray, " A"]
    high: Float[np.ndarray, " A"]


def judge_of(result: Result, index: int, by: Kind) -> Judge:
    """Choose how a run's constraint judges actions. Raises ValueError, in one line, where it cannot judge any."""
    space, nets, name = result.spec.env.action_space, result.bound(index), result.spec.method_name
    if not nets.method.tests_steps:
        raise ValueError(f"method={name} learns no constraint of single steps; choose aircl_corrected or another row with δ₁")
    if isinstance(space, Discrete):
        if by not in ("default", "draws"):
            raise ValueError(f"by={by!r}: actions of {result.spec.env.name} are numbered; choose draws")
        return _of_next_states(nets) if not _reads_actions(nets) else Judge(step_delta(nets), None, "δ₁ of each action")
    if not _reads_actions(nets):
        raise ValueError(
            f"δ₁ of this run on {result.spec.env.name} is of states alone, and no action can be judged by it; "
            "choose a run on a constraint that reads actions"
        )
    limits = None if by in ("sum", "draws") else action_limits(result, index)
    if limits is not None:
        return _within(limits)
    if by == "limits":
        raise ValueError(f"by='limits': the run drew none for an action of {result.spec.env.name}; choose sum or draws")
    additive = isinstance(nets.networks.step_net, AdditiveNet)
    if by == "sum" and not additive:
        raise ValueError("by='sum': δ₁ of this run is no sum over coordinates; choose draws")
    return _by_sum(nets, space) if additive and by != "draws" else Judge(step_delta(nets), None, "δ₁, nearest of draws")


def action_limits(result: Result, index: int) -> ActionLimits | None:
    """Return the limits of every action that one seed draws; None where it draws none.

    They are those of `recovered_limits`. Where demonstrations also leave out the middle, as a motor does that pushes one way or
    the other, the limit is the outermost value at which the mean of δ₁ is ½. What lies beyond all that was demonstrated is
    left out too, for it was never seen.
    """
    found, space = recovered_limits(result), result.spec.env.action_space
    if found is None or not isinstance(space, Box):
        return None
    low, high = outermost(result, index)
    for motor, name in enumerate(result.spec.env.motor_names):
        place = found.names.index(name)
        lower, upper = found.lower[index, place], found.upper[index, place]
        low[motor] = max(lower if math.isfinite(lower) else low[motor], found.least[place])
        high[motor] = min(upper if math.isfinite(upper) else high[motor], found.greatest[place])
    low, high = np.where(low <= space.low, -np.inf, low), np.where(high >= space.high, np.inf, high)
    return ActionLimits(low, high) if np.isfinite([low, high]).any() else None


def learned_motors(result: Result, number: int) -> Motors | None:
    """Return where the motors of fresh policies stop, [S, A]: at the limits that the learned seeds drew, and at no other.

    Fresh seed i has those of learned seed i, and again from the first where there are fewer. None where no limit is drawn.
    """
    found = recovered_limits(result)
    if found is None:
        return None
    places = [found.names.index(name) for name in result.spec.env.motor_names if name in found.names]
    lower, upper = (np.where(np.isfinite(side), side, end) for side, end in ((found.lower, -np.inf), (found.upper, np.inf)))
    if not places or not np.isfinite([lower[:, places], upper[:, places]]).any():
        return None
    seeds = np.arange(number) % len(lower)
    return jnp.asarray(lower[seeds][:, places], jnp.float32), jnp.asarray(upper[seeds][:, places], jnp.float32)


def outermost(result: Result, index: int) -> ActionLimits:
    """Find the outermost values of each motor at which the mean of δ₁ over demonstrated steps is at least ½, interpolated."""
    space, number = result.spec.env.action_space, result.spec.env.obs_size
    if not isinstance(space, Box):
        raise TypeError("actions are numbered")
    steps = demonstrated_steps(result)
    across = np.linspace(space.low, space.high, VALUES)
    grid = np.concatenate([np.zeros((VALUES, number)), np.tile(across[:, None], space.size)], axis=1)
    moved = jnp.asarray(steps[np.linspace(0, len(steps) - 1, min(STEPS, len(steps))).astype(int)])
    curves = np.asarray(mean_delta(result.networks, result.state(index), jnp.asarray(grid, jnp.float32), moved))[:, number:]
    ends = [[_first(across, one), _first(across[::-1], one[::-1])] for one in curves.T]
    return ActionLimits(*np.array(ends).T)


def _first(values: Float[np.ndarray, " K"], delta: Float[np.ndarray, " K"]) -> float:
    """The first value at which δ reaches ½, between it and the one before; the first of all where none does."""
    passing = np.flatnonzero(delta >= FORBIDDEN_BELOW)
    if not len(passing) or passing[0] == 0:
        return float(values[0])
    at = passing[0]
    return float(np.interp(FORBIDDEN_BELOW, delta[[at - 1, at]], values[[at - 1, at]]))


def _within(limits: ActionLimits) -> Judge:
    low, high = (jnp.asarray(end, jnp.float32) for end in limits)

    def delta(_: Array, action: Array) -> Float[Array, ""]:
        return ((action >= low) & (action <= high)).all().astype(jnp.float32)

    return Judge(delta, lambda _, action: jnp.clip(action, low, high), "recovered limits")


def _by_sum(nets: BoundNetworks, space: Box) -> Judge:
    """Project by an additive δ₁: z(s, a) = z(s, a₀) + Σ_i [z(s, a₀ with a_i) − z(s, a₀)], whose terms do not depend on s."""
    grid = jnp.linspace(space.low, space.high, VALUES)
    middle, nowhere = jnp.full(space.size, space.middle), jnp.zeros(nets.env.obs_size)
    at_middle = nets.step_logit(nowhere, middle)
    motors = jnp.arange(space.size)

    def gain(motor: Array, value: Array) -> Float[Array, ""]:
        return nets.step_logit(nowhere, middle.at[motor].set(value)) - at_middle

    table = jax.jit(jax.vmap(jax.vmap(gain, (None, 0)), (0, None)))(motors, grid)
    least = least_logit(nets)

    def nearest(obs: Array, action: Array) -> Array:
        values = jnp.concatenate([jnp.tile(grid, (space.size, 1)), action[:, None]], axis=1)
        gains = jnp.concatenate([table, jax.vmap(gain)(motors, action)[:, None]], axis=1)
        scaled = space.in_half_widths(values)
        found = nearest_by_sum(space.in_half_widths(action), scaled, gains, least - nets.step_logit(obs, middle))
        return space.from_half_widths(found)

    return Judge(step_delta(nets), nearest, "δ₁, a sum over coordinates")


def _of_next_states(nets: BoundNetworks) -> Judge:
    """Judge an action by E[δ₁(s')] of the state that it leads to, on a table whose states are seen."""
    env = nets.env
    if env.tabular is None or env.restore is None:
        raise ValueError(
            f"δ₁ of this run on {env.name} is of states alone, and where an action leads cannot be told from what is seen; "
            "choose a world whose obs is its state"
        )
    still = jnp.zeros((), jnp.int32)
    of_state = jax.vmap(lambda seen: step_delta(nets)(seen, still))(jnp.asarray(env.tabular.obs))
    table, restore = jnp.asarray(env.tabular.transition) @ of_state, env.restore
    return Judge(lambda obs, action: table[restore(obs), action], None, "δ₁ of the state that an action leads to")


def least_logit(nets: BoundNetworks) -> Float[Array, ""]:
    """The logit at which δ₁ is ½."""
    return jnp.log(jnp.asarray(nets.config.coefficients.threshold)) if nets.method.is_ratio_test else jnp.zeros(())


def step_delta(nets: BoundNetworks) -> Callable[[Array, Array], Float[Array, ""]]:
    """Return δ₁ as a function of one step."""

    def delta(obs: Float[Array, " O"], action: Shaped[Array, "*A"]) -> Float[Array, ""]:
        scores = FeasibilityScores(nets.step_logit(obs, action)[None], jnp.zeros(()), jnp.ones(1), nets.params.thresholds)
        return jnp.exp(log_step_feasibility(nets.method, nets.config.coefficients, scores)[0])

    return delta


def _reads_actions(nets: BoundNetworks) -> bool:
    return nets.networks.feasibility_sees_action and not nets.method.tests_entries
