"""Half-cheetah and hopper as worlds: what is seen, where they start, what ends and costs."""

from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from envs import Box, make_env
from envs.robots.robot import compile_model
from envs.robots.tasks import ROBOTS, RobotState
from envs.views import Coordinates

JOINTS = {
    "halfcheetah": ("x", "z", "pitch", *(f"{joint} {leg}" for leg in ("back", "front") for joint in ("hip", "knee", "ankle"))),
    "hopper": ("x", "z", "pitch", "hip", "knee", "ankle"),
}


@pytest.mark.parametrize(("constraint", "hidden", "limit"), [("torque", 1, 0.5), ("position", 0, -3.0)])
@pytest.mark.parametrize("name", JOINTS)
def test_a_legged_body_hides_its_x_but_before_a_wall_and_acts_in_the_unit_box(
    name: str, constraint: str, hidden: int, limit: float
) -> None:
    env, joints = make_env(name, constraint=constraint), JOINTS[name]
    assert (env.horizon, env.obs_size, env.action_space) == (500, 2 * len(joints) - hidden, Box(len(joints) - 3))
    assert isinstance(env.view, Coordinates)
    assert env.view.names == (*joints[hidden:], *(f"velocity of {joint}" for joint in joints))
    assert env.view.motors == tuple(f"motor {joint}" for joint in joints[3:])
    assert env.limit is not None
    assert (env.limit.value, env.limit.bounds) == (limit, "actions" if constraint == "torque" else 0)


@pytest.mark.parametrize(("name", "noise", "height"), [("halfcheetah", 0.1, 0.0), ("hopper", 0.005, 1.25)])
def test_a_legged_body_starts_at_rest_within_gymnasiums_noise(name: str, noise: float, height: float) -> None:
    states, obs = jax.vmap(make_env(name).reset)(jax.random.split(jax.random.key(0), 200))
    off = np.concatenate(states, axis=1)
    off[:, 1] -= height
    assert np.abs(off).max() <= noise + 1e-6
    assert (np.abs(off).max(axis=0) > 0.9 * noise).all()  # every coordinate fills its range
    np.testing.assert_array_equal(obs, np.concatenate(states, axis=1)[:, 1:])


@pytest.mark.parametrize(
    ("coordinate", "value", "healthy"),
    [
        (1, 0.71, True),
        (1, 0.7, False),
        (1, 9.0, True),
        (2, 0.19, True),
        (2, -0.2, False),
        (3, -99.0, True),
        (6, 101.0, False),  # the velocity of x
        (11, -100.0, False),
    ],
)
def test_a_hopper_is_healthy_above_07_m_and_within_02_rad(coordinate: int, value: float, healthy: bool) -> None:
    state = jnp.zeros(12).at[1].set(1.25).at[coordinate].set(value)
    assert bool(ROBOTS["hopper"].tasks["forward"].healthy(RobotState(state[:6], state[6:]))) is healthy


def test_the_velocities_of_the_hopper_alone_are_clipped() -> None:
    fast = {name: RobotState(jnp.zeros(len(joints)), jnp.full(len(joints), -20.0)) for name, joints in JOINTS.items()}
    assert jnp.array_equal(ROBOTS["hopper"].tasks["forward"].observe(fast["hopper"])[5:], jnp.full(6, -10.0))
    assert jnp.array_equal(ROBOTS["hopper"].tasks["wall"].observe(fast["hopper"])[6:], jnp.full(6, -20.0))
    assert jnp.array_equal(ROBOTS["halfcheetah"].tasks["forward"].observe(fast["halfcheetah"])[8:], jnp.full(9, -20.0))


def test_a_half_cheetah_pays_by_its_place_before_a_wall_and_a_fall_never_ends_it() -> None:
    step = jax.jit(make_env("halfcheetah", constraint="position", terminate=True, noise=0.0).step)

    def after(x: float, pitch: float, torque: float) -> Any:
        state = RobotState(jnp.zeros(9).at[0].set(x).at[2].set(pitch), jnp.zeros(9))
        return step(jax.random.key(0), state, jnp.full(6, torque))[1]

    assert after(-3.2, 0.0, 0.0).cost == 1.0
    assert after(-2.8, 0.0, 1.0).cost == 0.0  # torques are free there
    assert after(0.0, 3.0, 0.0).terminated == 0.0  # on its back


@pytest.mark.parametrize("name", JOINTS)
def test_only_the_floor_touches_the_body(name: str) -> None:
    model = compile_model(ROBOTS[name].body, "euler")
    floor = model.geom_bodyid == 0
    assert (model.geom_conaffinity[floor] == 1).all()
    assert not model.geom_conaffinity[~floor].any()
