"""Changed bodies: what each factor makes of the compiled model, worked by hand, and that both engines move it alike."""

from functools import cache
from math import pi
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from envs import make_env
from envs.robots.factors import (
    BodyOptions,
    HalfCheetahBody,
    HalfCheetahMotors,
    HopperBody,
    HopperMotors,
    PendulumBody,
    SwimmerBody,
    SwimmerMotors,
    WalkerBody,
    WalkerMotors,
)
from envs.robots.robot import ENGINES, compile_model
from envs.robots.tasks import ROBOTS, RobotState

LEGGED = ("walker", "halfcheetah", "hopper")  # whose floor makes MJX compile for long
CHANGED: dict[str, BodyOptions] = {
    "swimmer": SwimmerBody(mass=1.3, gear=0.8, length=0.7, viscosity=3.0, gears=SwimmerMotors(front=-1.0, rear=0.4)),
    "walker": WalkerBody(mass=0.8, gear=1.2, length=1.2, gears=WalkerMotors(knee_left=-0.5)),
    "halfcheetah": HalfCheetahBody(mass=1.2, gear=0.9, length=1.1, gears=HalfCheetahMotors(ankle_front=-0.5)),
    "hopper": HopperBody(mass=0.8, gear=1.2, length=1.2, gears=HopperMotors(knee=-0.5)),
    "pendulum": PendulumBody(mass=1.5, gear=-0.6, pole=1.7),
}


def _model(name: str, body: BodyOptions) -> Any:
    return compile_model(ROBOTS[name].body, "euler", body)


def _capsule(radius: float, length: float) -> float:
    """Mass in kg, at 1000 kg/m³, of a cylinder with half a ball at either end."""
    return 1000 * pi * radius**2 * (length + 4 / 3 * radius)


@cache
def _step(name: str, body: BodyOptions, engine: str = "planar") -> Any:
    model = _model(name, body)
    return jax.jit(jax.vmap(ENGINES[engine](model, ROBOTS[name].body, "euler")))


def _states(name: str) -> tuple[jax.Array, jax.Array, jax.Array]:
    model, generator = _model(name, CHANGED[name]), np.random.default_rng(0)
    qpos = model.qpos0 + generator.uniform(-0.05, 0.05, (50, model.nq))
    qvel, action = generator.normal(size=(50, model.nv)), generator.uniform(-1, 1, (50, model.nu))
    return jnp.float32(qpos), jnp.float32(qvel), jnp.float32(action)


def test_mass_multiplies_masses_and_inertias_and_nothing_else_of_the_links() -> None:
    plain, heavy = _model("swimmer", SwimmerBody()), _model("swimmer", SwimmerBody(mass=1.5))
    np.testing.assert_allclose(heavy.body_mass[1:], 1.5 * _capsule(0.1, 1.0), rtol=1e-12)
    np.testing.assert_allclose(heavy.body_inertia, 1.5 * plain.body_inertia, rtol=1e-12)
    np.testing.assert_array_equal(heavy.dof_armature, plain.dof_armature)
    np.testing.assert_array_equal(heavy.geom_size, plain.geom_size)


def test_length_moves_the_swimmers_joints_apart_and_keeps_its_density() -> None:
    model = _model("swimmer", SwimmerBody(length=2.0))
    np.testing.assert_allclose(model.body_mass[1:], _capsule(0.1, 2.0), rtol=1e-12)
    np.testing.assert_allclose(model.body_pos[1:, 0], [0.0, 1.0, -2.0])  # torso, mid, back
    np.testing.assert_allclose(model.geom_size[:, :2], [[0.1, 1.0]] * 3)  # radius, half the length


@pytest.mark.parametrize(("name", "body"), [("walker", WalkerBody(length=2.0)), ("hopper", HopperBody(length=2.0))])
def test_a_longer_walker_or_hopper_starts_with_its_soles_as_high_above_the_floor(name: str, body: BodyOptions) -> None:
    model = _model(name, body)
    assert model.qpos0[1] == pytest.approx(0.1 + 2 * 1.15)  # feet at 0.1 m, 1.15 m below the torso's middle
    assert model.body_pos[1, 2] == pytest.approx(model.qpos0[1])
    np.testing.assert_allclose(model.body_pos[2:5, 2], [-0.4, -1.4, -0.7])
    np.testing.assert_allclose(model.jnt_pos[4], [0, 0, 0.5])  # the right knee, in the shin's frame
    np.testing.assert_allclose(model.body_mass[1], _capsule(0.05, 0.8), rtol=1e-12)


def test_length_stretches_links_that_are_given_by_their_middle() -> None:
    plain, long = _model("halfcheetah", HalfCheetahBody()), _model("halfcheetah", HalfCheetahBody(length=2.0))
    np.testing.assert_allclose(plain.body_mass.sum(), 14.0)
    np.testing.assert_allclose(long.geom_size[1:, 1], 2 * plain.geom_size[1:, 1])
    np.testing.assert_allclose(long.geom_pos[1:], 2 * plain.geom_pos[1:], atol=1e-12)
    np.testing.assert_allclose(long.body_pos[1:], 2 * plain.body_pos[1:], atol=1e-12)
    whole = 2 * (2 * plain.geom_size[1:, 1]) + 4 / 3 * 0.046
    np.testing.assert_allclose(long.body_mass.sum() / 14, whole.sum() / (whole.sum() / 2 + 8 * 2 / 3 * 0.046), rtol=1e-9)


@pytest.mark.parametrize(("length", "height", "earns"), [(1.0, 0.9, 1.0), (2.0, 0.9, 0.0), (2.0, 3.9, 1.0), (1.0, 2.1, 0.0)])
def test_a_longer_walker_is_upright_at_greater_heights(length: float, height: float, earns: float) -> None:
    env = make_env("walker", body={"length": length}, reward="stand", terminate=True, noise=0.0)
    state = RobotState(jnp.zeros(9).at[1].set(height), jnp.zeros(9))
    _, step = jax.jit(env.step)(jax.random.key(0), state, jnp.zeros(6))
    assert (step.reward, step.terminated) == (earns, 1 - earns)


def test_pole_lengthens_the_pole_alone() -> None:
    plain, long = _model("pendulum", PendulumBody()), _model("pendulum", PendulumBody(pole=2.0))
    assert long.body_mass[1] == plain.body_mass[1]
    assert long.geom_size[1, 1] == pytest.approx(2 * plain.geom_size[1, 1])
    np.testing.assert_allclose(long.body_ipos[2], [0.001, 0.0, 0.6])  # half of twice 0.6 m
    assert long.body_mass[2] == pytest.approx(_capsule(0.049, 2 * plain.geom_size[1, 1] * 2))


def test_gear_and_gears_multiply_and_viscosity_is_the_fluids() -> None:
    model = _model("swimmer", SwimmerBody(gear=2.0, viscosity=3.0, gears=SwimmerMotors(front=-1.0, rear=0.4)))
    np.testing.assert_allclose(model.actuator_gear[:, 0], [-300.0, 120.0])
    assert model.opt.viscosity == pytest.approx(0.3)
    assert model.opt.density == 4000
    model = _model("walker", WalkerBody(gears=WalkerMotors(ankle_left=0.0)))
    np.testing.assert_allclose(model.actuator_gear[:, 0], [100, 100, 100, 100, 100, 0])


def test_a_mirrored_motor_moves_as_the_negated_action_does() -> None:
    qpos, qvel, action = _states("swimmer")
    front = _step("swimmer", SwimmerBody(gears=SwimmerMotors(front=-1.0)))(qpos, qvel, action)
    both = _step("swimmer", SwimmerBody(gear=-1.0))(qpos, qvel, action)
    plain = _step("swimmer", SwimmerBody())
    for found, sign in ((front, jnp.array([-1.0, 1.0])), (both, -jnp.ones(2))):
        for one, other in zip(found, plain(qpos, qvel, sign * action), strict=True):
            np.testing.assert_allclose(one, other, atol=1e-6)


@pytest.mark.parametrize("name", ["swimmer", "pendulum", *(pytest.param(name, marks=pytest.mark.slow) for name in LEGGED)])
def test_both_engines_move_a_changed_body_alike(name: str) -> None:
    states = _states(name)
    planar, mjx = _step(name, CHANGED[name])(*states), _step(name, CHANGED[name], "mjx")(*states)
    close = (jnp.abs(planar[0] - mjx[0]) <= 1e-5 + 1e-4 * jnp.abs(mjx[0])).all(1)
    close &= (jnp.abs(planar[1] - mjx[1]) <= 1e-3 + 1e-3 * jnp.abs(mjx[1])).all(1)
    assert close.mean() >= 0.97
    assert jnp.abs(planar[1] - _step(name, BodyOptions())(*states)[1]).max() > 0.1  # another body indeed


@pytest.mark.parametrize("name", list(ROBOTS))
def test_factors_of_one_compile_the_model_of_the_mjcf_bit_by_bit(name: str) -> None:
    mujoco: Any = pytest.importorskip("mujoco")
    plain, ours = mujoco.MjModel.from_xml_string(ROBOTS[name].body.mjcf), _model(name, type(CHANGED[name])())
    for field in dir(plain):
        value = getattr(plain, field)
        if isinstance(value, np.ndarray):
            np.testing.assert_array_equal(value, getattr(ours, field), err_msg=field)


@pytest.mark.parametrize(
    ("name", "body", "says"),
    [
        ("swimmer", {"pole": 2.0}, "unknown setting env.body.pole; choose from mass, gear, length, viscosity, gears"),
        ("pendulum", {"length": 2.0}, "unknown setting env.body.length; choose from mass, gear, pole"),
        ("walker", {"viscosity": 2.0}, "unknown setting env.body.viscosity; choose from mass, gear, length, gears"),
        ("swimmer", {"gears": {"knee": -1.0}}, "unknown setting env.body.gears.knee; choose from front, rear"),
        ("swimmer", {"gears": {"rear": float("nan")}}, "env.body.gears.rear=nan is not a number"),
        ("swimmer", {"mass": 0.0}, "wrong env.body.mass 0.0; choose a number above 0"),
        ("walker", {"gear": float("inf")}, "env.body.gear=inf is not a number"),
        ("walker", 1.5, "env.body=1.5 is not a group of settings"),
        ("walker", SwimmerBody(), "is not a group of settings"),
    ],
)
def test_a_wrong_factor_names_itself_its_value_and_the_choices(name: str, body: Any, says: str) -> None:
    with pytest.raises(ValueError, match=says):
        make_env(name, body=body)


def test_a_changed_body_ships_no_demonstrations() -> None:
    assert make_env("swimmer", body={"mass": 1.0}).shipped_demonstrations == "swimmer_torque"
    assert make_env("swimmer", body={"mass": 1.5}).shipped_demonstrations is None
    assert make_env("swimmer", body=SwimmerBody(gears=SwimmerMotors(rear=0.4))).shipped_demonstrations is None
