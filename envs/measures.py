"""What a constraint can bound of any body that MuJoCo describes: `env.constraint=speed|height|tilt|joint|position`.

Each is one quantity of (qpos, qvel) and a side of `env.limit` on which it violates.
"""

from collections.abc import Callable, Iterator, Mapping
from functools import partial
from typing import Any, Literal, NamedTuple

import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

FREE, SLIDE, HINGE = 0, 2, 3  # `mujoco.mjtJoint`; a ball (1) has no single angle

Positions = Float[Array, " Q"]
Velocities = Float[Array, " V"]
Scalar = Float[Array, ""]
Side = Literal["above", "below", "outside"]  # outside: the size of it is above the limit

SIDES: dict[str, Side] = {
    "position": "below",
    "speed": "above",
    "height": "above",
    **dict.fromkeys(("tilt", "joint", "coordinate"), "outside"),
}
MARGIN: dict[Side, Callable[[Scalar, float], Scalar]] = {
    "above": lambda value, limit: value - limit,
    "below": lambda value, limit: limit - value,
    "outside": lambda value, limit: jnp.abs(value) - limit,
}


class Measure(NamedTuple):
    """A quantity of a state, in its unit, and the coordinate of [qpos, qvel] that shows it as it is, where one does."""

    of: Callable[[Positions, Velocities], Scalar]
    unit: str
    shown_by: int | None = None


class Measures(NamedTuple):
    """The quantities of one body."""

    of_root: Mapping[str, Measure]  # position and speed along x, height, tilt: those that it has
    joints: Mapping[str, Measure]  # hinges (rad) and slides (m), by name


class Bound(NamedTuple):
    """A quantity, and the side of a limit on which it violates, strictly."""

    measure: Measure
    side: Side
    limit: float

    def violated(self, qpos: Positions, qvel: Velocities) -> Bool[Array, ""]:
        return beyond(self.measure.of(qpos, qvel), self.side, self.limit)


def beyond(value: Scalar, side: Side, limit: float) -> Bool[Array, ""]:
    """Whether the value is on that side of the limit, strictly."""
    return MARGIN[side](value, limit) > 0


def measures_of(model: Any) -> Measures:
    """Find the quantities of a compiled `MjModel` by its joints."""
    of_root: dict[str, Measure] = {}
    joints: dict[str, Measure] = {}
    for name, measure in _of_root(model):
        of_root.setdefault(name, measure)  # the first joint is the root's
    for joint in range(model.njnt):
        if model.jnt_type[joint] in (SLIDE, HINGE):
            unit = "m" if model.jnt_type[joint] == SLIDE else "rad"
            joints[model.joint(joint).name] = _position(int(model.jnt_qposadr[joint]), unit)
    return Measures(of_root, joints)


def names_of(measures: Measures) -> list[str]:
    """List the names of `env.constraint` that this body has."""
    return [*measures.of_root, *(["joint"] if measures.joints else [])]


def bound_of(whose: str, measures: Measures, name: str, *, limit: float | str, side: str, joint: str) -> Bound:
    """Choose the quantity that the settings name. Raises ValueError, in one line, for a joint or a limit that is missing."""
    if name == "joint" and joint not in measures.joints:
        raise ValueError(f"env.joint={joint or '…'} is no joint of {whose}; choose from {', '.join(measures.joints)}")
    if name != "joint" and joint:
        raise ValueError(f"env.joint={joint} is of env.constraint=joint, and env.constraint={name}; choose one")
    measure = measures.joints[joint] if name == "joint" else measures.of_root[name]
    return Bound(measure, side_of(name, side), given(name, limit, measure.unit))


def side_of(name: str, side: str) -> Side:
    """Resolve env.side: what was asked for, or the constraint's own where that says default."""
    return SIDES[name] if side == "default" else side  # pyright: ignore[reportReturnType]


def given(name: str, limit: float | str, unit: str) -> float:
    """Return the limit. Raises ValueError where none was given: no body has one of its own for such a constraint."""
    if isinstance(limit, str):
        raise ValueError(f"env.limit={limit}: env.constraint={name} has no limit of its own; choose a number, in {unit}")
    return limit


def _of_root(model: Any) -> Iterator[tuple[str, Measure]]:
    """Go through the joints of the first body that moves, and for its tilt through all: a cart's is that of its pole."""
    has_place = False
    for joint in range(model.njnt):
        kind, at, speed = int(model.jnt_type[joint]), int(model.jnt_qposadr[joint]), int(model.jnt_dofadr[joint])
        x, _, z = (float(part) for part in model.jnt_axis[joint])
        body, is_root = int(model.jnt_bodyid[joint]), model.jnt_bodyid[joint] == model.jnt_bodyid[0]
        if is_root and (kind == FREE or (kind == SLIDE and x == 1.0)):
            has_place = True
            yield "position", _position(at, "m")
            yield "speed", Measure(lambda qpos, qvel, speed=speed: qvel[speed], "m/s", int(model.nq) + speed)
        if is_root and kind == FREE:
            yield "height", _position(at + 2, "m")
            yield "tilt", Measure(partial(_lean, at + 3), "rad")
        if is_root and kind == SLIDE and z == 1.0:
            yield "height", _position(at, "m", float(model.body_pos[body, 2] - model.qpos0[at]))
        if has_place and kind == HINGE and z == 0.0:
            yield "tilt", _position(at, "rad")


def _position(index: int, unit: str, offset: float = 0.0) -> Measure:
    return Measure(lambda qpos, qvel: qpos[index] + offset, unit, None if abs(offset) > 1e-9 else index)


def _lean(first: int, qpos: Positions, qvel: Velocities) -> Scalar:
    """Compute the angle of a free body's z axis from the vertical, arccos(1 − 2(x² + y²)) of its quaternion (w, x, y, z)."""
    x, y = qpos[first + 1], qpos[first + 2]
    return jnp.arccos(jnp.clip(1.0 - 2.0 * (x**2 + y**2), -1.0, 1.0))
