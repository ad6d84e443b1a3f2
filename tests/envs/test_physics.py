"""The bodies against C MuJoCo, MJX and Gymnasium; one compiled control step per body and engine serves all tests."""

import importlib
import sys
from collections.abc import Callable
from functools import cache
from pathlib import Path
from types import ModuleType
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from envs import make_env
from envs.robots.bodies import Body
from envs.robots.robot import ENGINES, compile_model
from envs.robots.tasks import ROBOTS, RobotState

mujoco: Any = importlib.import_module("mujoco")
ROBOT_NAMES = tuple(ROBOTS)
STATES, PART = 1000, 250
LEGGED = ("walker", "halfcheetah", "hopper")  # whose floor makes RK4 compile for long
SLOW = [pytest.param(name, "rk4", marks=pytest.mark.slow) for name in LEGGED]
FAST = [(name, "euler") for name in ROBOT_NAMES] + [(name, "rk4") for name in ROBOT_NAMES if name not in LEGGED]


@pytest.fixture(autouse=True)
def _elsewhere(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)  # MuJoCo logs its warnings about Gymnasium's files where it runs


class Moves(NamedTuple):
    """Control steps of C MuJoCo, fully converged, from states that random actions lead to: [N, …] float64."""

    qpos: np.ndarray
    qvel: np.ndarray
    action: np.ndarray
    next_qpos: np.ndarray
    next_qvel: np.ndarray


def _converged(body: Body, integrator: str) -> Any:
    model = compile_model(body, integrator)
    model.opt.iterations, model.opt.ls_iterations, model.opt.tolerance = 100, 50, 1e-12
    return model


@cache
def moves(name: str, integrator: str) -> Moves:
    """Episodes of 60 random control steps, enough for the walker and the pole to fall and lie; every third is kept."""
    robot, generator = ROBOTS[name], np.random.default_rng(0)
    body, model = robot.body, _converged(robot.body, integrator)
    data, kept = mujoco.MjData(model), []
    while len(kept) < STATES:
        mujoco.mj_resetData(model, data)
        data.qpos += generator.uniform(-body.reset_noise, body.reset_noise, model.nq)
        data.qvel += generator.uniform(-body.reset_noise, body.reset_noise, model.nv)
        for time in range(60):
            high = robot.action_space.high
            data.ctrl = np.clip(generator.normal(size=model.nu) * high, -high, high)
            before = data.qpos.copy(), data.qvel.copy(), data.ctrl.copy()
            mujoco.mj_step(model, data, nstep=body.frame_skip)
            if time % 3 == 2:
                kept.append((*before, data.qpos.copy(), data.qvel.copy()))
    return Moves(*(np.stack(column) for column in zip(*kept[:STATES], strict=True)))


@cache
def physics(name: str, integrator: str, engine: str) -> Callable[..., Any]:
    """One jitted control step of a batch, in parts: on two cores MJX's walker never returns from one of 1000."""
    body = ROBOTS[name].body
    one = ENGINES[engine](compile_model(body, integrator), body, integrator)
    return jax.jit(lambda *states: jax.lax.map(lambda state: one(*state), states, batch_size=PART))


def _deviation(found: tuple[Any, Any], qpos: np.ndarray, qvel: np.ndarray) -> tuple[np.ndarray, str]:
    """Which steps are within |Δqpos| ≤ 1e-5 + 1e-4|qpos| and |Δqvel| ≤ 1e-3 + 1e-3|qvel|, and the worst in words."""
    error_pos, error_vel = np.abs(found[0] - qpos), np.abs(found[1] - qvel)
    close = (error_pos <= 1e-5 + 1e-4 * np.abs(qpos)).all(1) & (error_vel <= 1e-3 + 1e-3 * np.abs(qvel)).all(1)
    return close, f"{close.mean():.1%} within; worst |Δqpos| {error_pos.max():.1e}, |Δqvel| {error_vel.max():.1e}"


@pytest.mark.parametrize(("name", "integrator"), FAST + SLOW)
def test_a_control_step_is_that_of_c_mujoco_at_full_convergence(name: str, integrator: str) -> None:
    step = moves(name, integrator)
    found = physics(name, integrator, "planar")(*(jnp.float32(x) for x in step[:3]))
    close, words = _deviation(found, step.next_qpos, step.next_qvel)
    print(f"{name} {integrator}: {words}")
    assert close.mean() >= 0.99, words


@pytest.mark.slow
@pytest.mark.parametrize("integrator", ["euler", "rk4"])
@pytest.mark.parametrize("name", ROBOT_NAMES)
def test_the_planar_engine_and_mjx_take_the_same_control_step(name: str, integrator: str) -> None:
    step = moves(name, integrator)
    state = [jnp.float32(x) for x in step[:3]]
    mjx = physics(name, integrator, "mjx")(*state)
    close, words = _deviation(physics(name, integrator, "planar")(*state), np.asarray(mjx[0]), np.asarray(mjx[1]))
    print(f"{name} {integrator}, planar against MJX: {words}")
    assert close.mean() >= 0.97, words


@pytest.mark.parametrize("name", ROBOT_NAMES)
def test_fifty_open_loop_control_steps_stay_with_c_mujoco(name: str) -> None:
    robot, generator, episodes = ROBOTS[name], np.random.default_rng(1), 20
    body, model = robot.body, _converged(robot.body, "euler")
    qpos = model.qpos0 + generator.uniform(-body.reset_noise, body.reset_noise, (episodes, model.nq))
    qvel = generator.uniform(-body.reset_noise, body.reset_noise, (episodes, model.nv))
    actions = np.clip(0.3 * robot.action_space.high * generator.normal(size=(50, episodes, model.nu)), -1, 1)
    ours = jnp.float32(qpos), jnp.float32(qvel)
    for action in actions:
        ours = physics(name, "euler", "planar")(*ours, jnp.float32(action))
    deviation = []
    for episode in range(episodes):
        data = mujoco.MjData(model)
        data.qpos, data.qvel = qpos[episode], qvel[episode]
        for action in actions[:, episode]:
            data.ctrl = action
            mujoco.mj_step(model, data, nstep=body.frame_skip)
        deviation.append(np.abs(np.asarray(ours[0][episode]) - data.qpos).max())
    print(f"{name}: |Δqpos| after 50 steps, median {np.median(deviation):.1e}, worst {max(deviation):.1e}")
    assert np.median(deviation) <= 1e-2


def test_a_batch_and_derivatives_are_those_of_one_environment() -> None:
    step = moves("swimmer", "euler")
    states = [jnp.float32(x[:3]) for x in step[:3]]
    body = ROBOTS["swimmer"].body
    one = ENGINES["planar"](compile_model(body, "euler"), body, "euler")
    together = jax.vmap(one, in_axes=(0, 0, None))(states[0], states[1], states[2][0])
    alone = [one(qpos, qvel, states[2][0]) for qpos, qvel in zip(states[0], states[1], strict=True)]
    for found, expected in zip(together, zip(*alone, strict=True), strict=True):
        np.testing.assert_allclose(found, np.stack(expected), rtol=1e-5, atol=1e-6)

    def speed(action: jax.Array) -> jax.Array:
        return jax.vmap(one, in_axes=(0, 0, None))(states[0], states[1], action)[1].sum()

    action, nudge = states[2][0], 0.1
    slopes = [(speed(action.at[i].add(nudge)) - speed(action.at[i].add(-nudge))) / (2 * nudge) for i in range(action.size)]
    np.testing.assert_allclose(jax.jit(jax.grad(speed))(action), jnp.stack(slopes), rtol=1e-2)


def _gymnasium(name: str, constraint: str) -> Any:
    sys.modules.setdefault("imageio", ModuleType("imageio"))  # Gymnasium imports it for films alone
    gymnasium: Any = importlib.import_module("gymnasium")
    settings: dict[str, dict[str, Any]] = {
        "swimmer": {"id": "Swimmer-v5"},
        "walker": {"id": "Walker2d-v5", "xml_file": "walker2d.xml"},  # v4's body, whose feet differ in friction
        "halfcheetah": {"id": "HalfCheetah-v5"},
        "hopper": {"id": "Hopper-v5"},
        "pendulum": {"id": "InvertedPendulum-v5"},
    }
    if name != "pendulum":
        settings[name]["exclude_current_positions_from_observation"] = constraint != "position"
    return gymnasium.make(**settings[name]).unwrapped


@pytest.mark.parametrize(
    ("name", "constraint"),
    [
        ("swimmer", "torque"),
        ("swimmer", "position"),
        ("pendulum", "position"),
        *(pytest.param(name, task, marks=pytest.mark.slow) for name in LEGGED for task in ("torque", "position")),
    ],
)
def test_observation_reward_and_end_are_gymnasiums(name: str, constraint: str) -> None:
    world = _gymnasium(name, constraint)
    env = make_env(name, constraint=constraint, integrator=_integrator(name), terminate=True, noise=0.0)
    step, generator = jax.jit(env.step), np.random.default_rng(2)
    world.reset(seed=0)
    ended = []
    for _ in range(40):
        qpos, qvel = world.data.qpos.copy(), world.data.qvel.copy()
        high = env.action_space.high  # type: ignore[union-attr]
        action = np.clip(generator.normal(size=world.model.nu) * high, -high, high)
        state = RobotState(jnp.float32(qpos), jnp.float32(qvel))
        _, ours = step(jax.random.key(0), state, jnp.float32(action))
        obs, reward, terminated, _, info = world.step(action)
        speed = abs(info.get("x_velocity", 0))
        expected = {
            ("swimmer", "position"): speed - 1e-4 * (action**2).sum(),
            ("walker", "position"): speed + (not terminated) - 1e-3 * (action**2).sum(),
            ("halfcheetah", "position"): speed - 0.1 * (action**2).sum(),
            ("hopper", "position"): speed + (not terminated) - 1e-3 * (action**2).sum(),
            ("pendulum", "position"): (not terminated) * np.interp(world.data.qpos[0], [-0.01, 0.0], [1.0, 0.1]),
        }.get((name, constraint), reward)
        unclipped = np.concatenate([world.data.qpos, world.data.qvel])
        np.testing.assert_allclose(ours.obs, unclipped if constraint == "position" else obs, atol=2e-3, rtol=1e-3)
        np.testing.assert_allclose(ours.reward, expected, atol=1e-2, rtol=1e-3)
        assert ours.terminated == float(terminated)
        ended.append(terminated)
        if terminated:
            world.reset()
    assert any(ended) is (name not in ("swimmer", "halfcheetah"))


def _integrator(name: str) -> str:
    return "euler" if name == "halfcheetah" else "rk4"  # as Gymnasium has it


@pytest.mark.parametrize("name", ROBOT_NAMES)
def test_the_models_are_gymnasiums(name: str) -> None:
    ours = compile_model(ROBOTS[name].body, _integrator(name))
    theirs = _gymnasium(name, "torque").model
    assert ours.opt.timestep == theirs.opt.timestep
    assert ours.opt.integrator == theirs.opt.integrator
    for field in (
        "body_mass",
        "body_inertia",
        "body_pos",
        "jnt_pos",
        "dof_armature",
        "dof_damping",
        "dof_invweight0",
        "jnt_stiffness",
        "qpos0",
    ):
        np.testing.assert_allclose(getattr(ours, field), getattr(theirs, field), atol=1e-9, err_msg=field)
    if name in LEGGED:
        np.testing.assert_allclose(ours.geom_friction[:, 0], theirs.geom_friction[:, 0])
        for field in ("geom_solimp", "geom_solref", "geom_margin", "jnt_solimp", "jnt_solref"):
            np.testing.assert_allclose(getattr(ours, field), getattr(theirs, field), err_msg=field)
    for field in ("actuator_gear", "actuator_ctrlrange", "jnt_limited", "jnt_axis"):
        np.testing.assert_array_equal(getattr(ours, field), getattr(theirs, field), err_msg=field)
    limited = ours.jnt_limited.astype(bool)
    np.testing.assert_allclose(ours.jnt_range[limited], theirs.jnt_range[limited])


def test_mjx_is_imported_without_its_lines_about_warp(capfd: pytest.CaptureFixture[str]) -> None:
    importlib.import_module("envs.robots.robot").import_mjx()
    assert "warp" not in capfd.readouterr().out


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore:Brax System:UserWarning", "ignore:JAXopt:DeprecationWarning")
def test_brax_hopper_runs_through_the_adapter_with_a_torque_limit() -> None:
    from brax import envs as brax_envs

    from envs.brax_adapter import adapt

    world = brax_envs.get_environment("hopper", backend="spring")
    env = adapt(world, lambda state, action: jnp.abs(action).max() > 0.5, horizon=20)

    def episode(key: Any) -> Any:
        state, _ = env.reset(key)
        keys = jax.random.split(key, env.horizon)
        return jax.lax.scan(lambda s, k: env.step(k, s, jax.random.normal(k, (world.action_size,))), state, keys)[1]

    steps = jax.jit(jax.vmap(episode))(jax.random.split(jax.random.key(0), 8))
    assert steps.obs.shape == (8, 20, env.obs_size)
    assert jnp.isfinite(steps.obs).all()
    assert 0.8 < steps.cost.mean() < 1.0  # 1 − (1 − 0.617)³ = 0.944 of a standard normal draw
    assert steps.terminated.sum() == 0
