"""A robot's body by factors, 1 as shipped: the settings `env.body`, and what each changes in its MJCF."""

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

from envs.robots.planar.chain import CAPSULE

FEET = 0.1  # m, height of the axes of the feet of walker and hopper at rest


@dataclass(frozen=True)
class Motors:
    """Factors of single motors, named as their joints."""


@dataclass(frozen=True)
class BodyOptions:
    """Factors that every body has. Raises ValueError on a factor that no body can have."""

    mass: float = 1.0  # of all masses and inertias; the motors' own (armature) stay
    gear: float = 1.0  # of every motor; a negative factor mirrors it, 0 breaks it

    def __post_init__(self) -> None:
        for name, factor in vars(self).items():
            if name not in ("gear", "gears") and factor <= 0:
                raise ValueError(f"wrong env.body.{name} {factor!r}; choose a number above 0")


@dataclass(frozen=True)
class SwimmerMotors(Motors):
    front: float = 1.0
    rear: float = 1.0


@dataclass(frozen=True)
class SwimmerBody(BodyOptions):
    """The swimmer's factors; `gear` and a motor's own in `gears` multiply."""

    length: float = 1.0  # of the links; their radii and density stay, so that mass grows too
    viscosity: float = 1.0  # of the fluid; its density, which makes nearly all of the drag, stays
    gears: SwimmerMotors = field(default_factory=SwimmerMotors)


@dataclass(frozen=True)
class WalkerMotors(Motors):
    hip_right: float = 1.0
    knee_right: float = 1.0
    ankle_right: float = 1.0
    hip_left: float = 1.0
    knee_left: float = 1.0
    ankle_left: float = 1.0


@dataclass(frozen=True)
class WalkerBody(BodyOptions):
    """The walker's factors; `gear` and a motor's own in `gears` multiply.

    With `length` it starts as high above the floor as before, measured at its soles, and it is upright at heights
    (0.8 to 2 m) times that factor.
    """

    length: float = 1.0  # of the links; their radii and density stay, so that mass grows too
    gears: WalkerMotors = field(default_factory=WalkerMotors)


@dataclass(frozen=True)
class HalfCheetahMotors(Motors):
    hip_back: float = 1.0
    knee_back: float = 1.0
    ankle_back: float = 1.0
    hip_front: float = 1.0
    knee_front: float = 1.0
    ankle_front: float = 1.0


@dataclass(frozen=True)
class HalfCheetahBody(BodyOptions):
    """The half-cheetah's factors; `gear` and a motor's own in `gears` multiply. The springs in its joints stay."""

    length: float = 1.0  # of the links, and of the height at which it starts; radii and density stay, so that mass grows too
    gears: HalfCheetahMotors = field(default_factory=HalfCheetahMotors)


@dataclass(frozen=True)
class HopperMotors(Motors):
    hip: float = 1.0
    knee: float = 1.0
    ankle: float = 1.0


@dataclass(frozen=True)
class HopperBody(BodyOptions):
    """The hopper's factors; `gear` and a motor's own in `gears` multiply.

    With `length` it starts as high above the floor as before, measured at its sole, and it is healthy at heights
    (above 0.7 m) times that factor.
    """

    length: float = 1.0  # of the links; their radii and density stay, so that mass grows too
    gears: HopperMotors = field(default_factory=HopperMotors)


@dataclass(frozen=True)
class PendulumBody(BodyOptions):
    """The pendulum's factors. It has one motor, so `gear` is that one's."""

    pole: float = 1.0  # of the pole's length; its radius and density stay, so that mass grows too


AS_SHIPPED = BodyOptions()


def change(spec: Any, body: BodyOptions) -> None:
    """Multiply the numbers of a MuJoCo `MjSpec` by the body's factors, in place."""
    for name, factor in vars(body).items():
        _CHANGES[name](spec, factor)


def _mass(spec: Any, factor: float) -> None:
    for geom in spec.geoms:
        geom.density *= factor


def _gear(spec: Any, factor: float) -> None:
    for motor in spec.actuators:
        motor.gear = factor * motor.gear


def _gears(spec: Any, gears: Motors) -> None:
    for motor in spec.actuators:
        motor.gear = getattr(gears, motor.target) * motor.gear


def _length(spec: Any, factor: float) -> None:
    _stretch(spec.geoms, factor)
    for part in (*spec.bodies, *spec.joints):
        part.pos = factor * part.pos
    for joint in spec.joints:
        if joint.ref:  # the height of walker and hopper above the floor
            joint.ref = factor * (joint.ref - FEET) + FEET
            joint.parent.pos = [0, 0, joint.ref]


def _pole(spec: Any, factor: float) -> None:
    _stretch(spec.body("pole").geoms, factor)


def _stretch(geoms: Any, factor: float) -> None:
    for geom in geoms:
        if int(geom.type) == CAPSULE:
            geom.fromto = factor * geom.fromto  # NaN, and so nothing, for a link that is given by its middle, as below
            geom.pos = factor * geom.pos
            geom.size[1] *= factor


def _viscosity(spec: Any, factor: float) -> None:
    spec.option.viscosity *= factor


_CHANGES: dict[str, Callable[[Any, Any], None]] = {
    "mass": _mass,
    "gear": _gear,
    "gears": _gears,
    "length": _length,
    "pole": _pole,
    "viscosity": _viscosity,
}
