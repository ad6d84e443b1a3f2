"""The robots' constraints as named predicates: a flag on the state after a step, never an end.

A constraint of your own is a function and a row:

    def astride(qpos, action, limit):
        return abs(qpos[3] - qpos[6]) > limit

    CONSTRAINTS["stride"] = {"walker": Constraint(astride, limit=0.8)}

What every body has by its joints (speed, height, tilt, one joint) needs no row: envs/measures.py.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Literal, NamedTuple

import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from envs.base import Limit
from envs.measures import bound_of, measures_of, names_of
from envs.options import RobotOptions
from envs.robots.tasks import RobotState

Predicate = Callable[[Float[Array, " Q"], Float[Array, " A"], float], Bool[Array, ""]]


@dataclass(frozen=True)
class Constraint:
    """`violated(qpos after the step, clipped action, limit)`, strict, with the default limit of one body."""

    violated: Predicate
    limit: float
    of: Literal["state", "state_action"] = "state"  # what the predicate reads
    task: Literal["forward", "wall"] = "forward"  # wall: x is observed and |Δx| is rewarded (but for the pendulum)
    bounds: int | Literal["actions"] | None = None  # what figures draw `limit` across: qpos[bounds], or every |action|


def torque_above(qpos: Float[Array, " Q"], action: Float[Array, " A"], limit: float) -> Bool[Array, ""]:
    """any_i |a_i| > limit, as a share of full torque (ICRL benchmark, SwimmerTest and Walker2dTest)."""
    return (jnp.abs(action) > limit).any()


def x_above(qpos: Float[Array, " Q"], action: Float[Array, " A"], limit: float) -> Bool[Array, ""]:
    """x > limit, in metres (ICRL benchmark, the blocked swimmer)."""
    return qpos[0] > limit


def x_below(qpos: Float[Array, " Q"], action: Float[Array, " A"], limit: float) -> Bool[Array, ""]:
    """x < limit, in metres (ICRL benchmark, the blocked walker, half-cheetah and InvertedPendulumWall)."""
    return qpos[0] < limit


def never(qpos: Float[Array, " Q"], action: Float[Array, " A"], limit: float) -> Bool[Array, ""]:
    """No constraint: the cost is 0 everywhere."""
    return jnp.zeros((), bool)


CONSTRAINTS: dict[str, dict[str, Constraint]] = {
    "torque": {
        "swimmer": Constraint(torque_above, limit=0.5, of="state_action", bounds="actions"),
        "walker": Constraint(torque_above, limit=0.5, of="state_action", bounds="actions"),
        "halfcheetah": Constraint(torque_above, limit=0.5, of="state_action", bounds="actions"),
        "hopper": Constraint(torque_above, limit=0.5, of="state_action", bounds="actions"),
    },
    "position": {
        "swimmer": Constraint(x_above, limit=0.5, task="wall", bounds=0),
        "walker": Constraint(x_below, limit=-3.0, task="wall", bounds=0),
        "halfcheetah": Constraint(x_below, limit=-3.0, task="wall", bounds=0),
        "hopper": Constraint(x_below, limit=-3.0, task="wall", bounds=0),
        "pendulum": Constraint(x_below, limit=-0.015, task="wall", bounds=0),
    },
    "none": {
        "swimmer": Constraint(never, limit=0.0),
        "walker": Constraint(never, limit=0.0),
        "halfcheetah": Constraint(never, limit=0.0),
        "hopper": Constraint(never, limit=0.0),
        "pendulum": Constraint(never, limit=0.0),
    },
}


def limit_of(constraint: Constraint, asked: float | str) -> float:
    """Resolve env.limit: what was asked for, or the constraint's own where that says default."""
    return constraint.limit if isinstance(asked, str) else float(asked)


class Rule(NamedTuple):
    """What the settings of one robot forbid."""

    violated: Callable[[RobotState, Float[Array, " A"]], Bool[Array, ""]]
    of: Literal["state", "state_action"]
    task: Literal["forward", "wall"]
    limit: Limit | None  # its bounds are a coordinate of [qpos, qvel]; None: nothing is forbidden
    is_default: bool  # of a row of CONSTRAINTS, at its own limit


def find_rule(body: str, options: RobotOptions, model: Any) -> Rule:
    """Find what these settings forbid: a row of CONSTRAINTS for this body, or a quantity that the body has.

    Raises ValueError, in one line, where the body has no such constraint, or a setting is missing or of another one.
    """
    name, measures = options.constraint, measures_of(model)
    if body not in CONSTRAINTS.get(name, {}):
        rows = [known for known, bodies in CONSTRAINTS.items() if body in bodies]
        choices = [*rows, *(known for known in names_of(measures) if known not in rows)]
        if name not in choices:
            raise ValueError(f"unknown constraint {name!r} of {body}; choose from {', '.join(choices)}")
        bound = bound_of(body, measures, name, limit=options.limit, side=options.side, joint=options.joint)
        line = Limit(name, bound.limit, bound.measure.shown_by, both_sides=bound.side == "outside")
        return Rule(lambda state, action: bound.violated(*state), "state", "forward", line, is_default=False)
    row = CONSTRAINTS[name][body]
    if options.side != "default" or options.joint:
        given = f"env.joint={options.joint}" if options.joint else f"env.side={options.side}"
        raise ValueError(f"{given}: env.constraint={name} of {body} has neither side nor joint to choose; leave it out")
    limit = limit_of(row, options.limit)
    line = None if row.violated is never else Limit(name, limit, row.bounds)
    return Rule(
        lambda state, action: row.violated(state.qpos, action, limit), row.of, row.task, line, is_default=limit == row.limit
    )


def task_of(name: str, body: str) -> Literal["forward", "wall"]:
    """Which of the body's tasks goes with a constraint."""
    return CONSTRAINTS[name][body].task if body in CONSTRAINTS.get(name, {}) else "forward"
