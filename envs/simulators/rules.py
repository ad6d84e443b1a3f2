"""What the settings forbid in a world of another library: `env.constraint` as in our own robots, by the body's joints."""

from collections.abc import Callable
from typing import Any, Literal, NamedTuple

import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from envs.base import Limit
from envs.measures import Measures, bound_of, given, names_of
from envs.simulators.options import GuestOptions

Pose = Callable[[Any], tuple[Float[Array, " Q"], Float[Array, " V"]]]
ACTIONS = "share of full torque"


class Rule(NamedTuple):
    """`violated(state after the step, clipped action)`, and what figures and networks need to know of it."""

    violated: Callable[[Any, Float[Array, " A"]], Bool[Array, ""]]
    of: Literal["state", "action", "state_action"]
    limit: Limit | None


def find_rule(options: GuestOptions, measures: Measures, pose: Pose, own: tuple[str, ...] = ()) -> Rule:
    """Find the rule of the settings; `pose` reads (qpos, qvel) of a state, and `own` are further names that the world has.

    Raises ValueError, in one line, where the world has no such constraint, or a setting is missing.
    """
    name = options.constraint
    choices = ["none", "torque", *own, *names_of(measures)]
    if name not in choices:
        raise ValueError(f"unknown constraint {name!r} of {options.task}; choose from {', '.join(choices)}")
    if name == "none":
        return Rule(lambda state, action: jnp.zeros((), bool), "state", None)
    if name == "torque":
        most = given(name, options.limit, ACTIONS)
        return Rule(lambda state, action: (jnp.abs(action) > most).any(), "state_action", Limit(name, most, "actions"))
    bound = bound_of(options.task, measures, name, limit=options.limit, side=options.side, joint=options.joint)
    line = Limit(name, bound.limit, None, both_sides=bound.side == "outside")
    return Rule(lambda state, action: bound.violated(*pose(state)), "state", line)
