"""The robots' constraints as named predicates: a flag on the state after a step, never an end.

A constraint of your own is a function and a row:

    def too_high(qpos, action, limit):
        return qpos[1] > limit

    CONSTRAINTS["height"] = {"walker": Constraint(too_high, limit=1.4)}
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

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


def find_constraint(name: str, body: str) -> Constraint:
    """Find the row of CONSTRAINTS for this body. Raises ValueError where the body has no such constraint."""
    choices = [known for known, bodies in CONSTRAINTS.items() if body in bodies]
    if name not in choices:
        raise ValueError(f"unknown constraint {name!r} of {body}; choose from {', '.join(choices)}")
    return CONSTRAINTS[name][body]
