"""The robots' constraints, settings and ends; nothing here compiles a physics step but the smallest body's."""

import importlib
from functools import cache
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from aircl_jax.demonstrations.sources import demonstrations
from aircl_jax.settings.train_config import TrainConfig
from envs import Limit, Step, make_env
from envs.measures import measures_of
from envs.registry import options_of
from envs.robots.constraints import CONSTRAINTS, Constraint, find_rule
from envs.robots.robot import compile_model
from envs.robots.tasks import ROBOTS, RobotState

POSE = jnp.zeros(5)


@cache
def _pendulum(**settings: Any) -> Any:
    return jax.jit(make_env("pendulum", **settings).step)


def _step(qpos: list[float], qvel: list[float], action: float, **settings: Any) -> tuple[RobotState, Step]:
    state = RobotState(jnp.array(qpos), jnp.array(qvel))
    return _pendulum(**settings)(jax.random.key(0), state, jnp.array([action]))


@pytest.mark.parametrize(("action", "violates"), [([0.5, -0.5], False), ([0.51, 0.0], True), ([0.0, -0.51], True)])
def test_torque_is_violated_strictly_above_half_of_full_torque_on_either_side(action: list[float], violates: bool) -> None:
    rule = CONSTRAINTS["torque"]["swimmer"]
    assert bool(rule.violated(POSE, jnp.array(action), rule.limit)) is violates


@pytest.mark.parametrize(
    ("body", "x", "violates"),
    [
        ("swimmer", 0.5, False),
        ("swimmer", 0.51, True),
        ("walker", -3.0, False),
        ("walker", -3.01, True),
        ("halfcheetah", -3.0, False),
        ("halfcheetah", -3.01, True),
        ("pendulum", -0.0149, False),
        ("pendulum", -0.0151, True),
    ],
)
def test_position_walls_stand_where_the_benchmark_has_them(body: str, x: float, violates: bool) -> None:
    rule = CONSTRAINTS["position"][body]
    assert bool(rule.violated(POSE.at[0].set(x), jnp.zeros(2), rule.limit)) is violates


@pytest.mark.parametrize(
    ("name", "settings", "says"),
    [
        (
            "pendulum",
            {"constraint": "torque"},
            "unknown constraint 'torque' of pendulum; choose from position, none, speed, tilt, joint",
        ),
        (
            "swimmer",
            {"constraint": "tilt"},
            "unknown constraint 'tilt' of swimmer; choose from torque, position, none, speed, joint",
        ),
        (
            "swimmer",
            {"constraint": "speed"},
            "env.limit=default: env.constraint=speed has no limit of its own; choose a number, in m/s",
        ),
        (
            "swimmer",
            {"constraint": "joint", "limit": 1.0},
            "env.joint=… is no joint of swimmer; choose from x, y, heading, front, rear",
        ),
        (
            "walker",
            {"constraint": "joint", "limit": 1.0, "joint": "elbow"},
            "env.joint=elbow is no joint of walker; choose from x, z, pitch, hip_right",
        ),
        (
            "walker",
            {"constraint": "tilt", "limit": 1.0, "joint": "pitch"},
            "env.joint=pitch is of env.constraint=joint, and env.constraint=tilt",
        ),
        ("walker", {"side": "above"}, "env.side=above: env.constraint=torque of walker has neither side nor joint to choose"),
        ("walker", {"side": "left"}, "env.side=left is not one of default, above, below, outside"),
        ("swimmer", {"limit": "high"}, "env.limit=high is not a number or 'default'"),
        ("swimmer", {"limit": float("nan")}, "env.limit=nan is not a number or 'default'"),
        ("swimmer", {"terminate": 1}, "env.terminate=1 is not true or false"),
        ("walker", {"horizon": 2.5}, "env.horizon=2.5 is not an integer"),
        ("walker", {"horizon": 0}, "wrong env.horizon 0; choose a whole number above 0"),
        ("walker", {"noise": float("inf")}, "env.noise=inf is not a number"),
        ("walker", {"noise": -0.1}, "wrong env.noise -0.1; choose a number that is not negative"),
        ("walker", {"integrator": "verlet"}, "env.integrator=verlet is not one of euler, rk4"),
        ("walker", {"engine": "bullet"}, "env.engine=bullet is not one of planar, mjx"),
        ("swimmer", {"gravity": 3}, "unknown setting env.gravity; choose from constraint, limit"),
    ],
)
def test_a_wrong_setting_names_itself_its_value_and_the_choices(name: str, settings: dict, says: str) -> None:
    with pytest.raises(ValueError, match=says):
        make_env(name, **settings)


def test_the_limit_moves_the_wall() -> None:
    assert _step([0.0, 0.0], [0.0, 0.0], 0.0)[1].cost == 0.0
    assert _step([0.0, 0.0], [0.0, 0.0], 0.0, limit=0.5)[1].cost == 1.0


def test_demonstrations_ship_for_the_limit_that_they_were_made_under_and_no_other() -> None:
    assert make_env("swimmer").shipped_demonstrations == "swimmer_torque"
    assert make_env("swimmer", limit=0.5).shipped_demonstrations == "swimmer_torque"
    assert make_env("swimmer", limit=0.3).shipped_demonstrations is None
    with pytest.raises(ValueError, match="env=swimmer ships no demonstrations of these settings"):
        demonstrations(make_env("swimmer", limit=0.3), [0], TrainConfig())


def test_a_constraint_of_ones_own_is_a_function_and_a_row(monkeypatch: pytest.MonkeyPatch) -> None:
    leaning = Constraint(lambda qpos, action, limit: qpos[1] > limit, limit=0.1)
    monkeypatch.setitem(CONSTRAINTS, "leaning", {"pendulum": leaning})
    assert _step([0.0, 0.15], [0.0, 0.0], 0.0, constraint="leaning")[1].cost == 1.0
    assert _step([0.0, 0.05], [0.0, 0.0], 0.0, constraint="leaning")[1].cost == 0.0


@pytest.mark.parametrize(("terminate", "ended"), [(False, 0.0), (True, 1.0)])
def test_a_fallen_pendulum_ends_only_where_ends_are_asked_for(terminate: bool, ended: float) -> None:
    _, step = _step([-0.02, 0.6], [0.0, 0.0], 0.0, terminate=terminate)
    assert step.terminated == ended
    assert step.reward == 0.0  # a fallen pole earns nothing, wherever its cart stands


@pytest.mark.parametrize("broken", [jnp.nan, jnp.inf, 1e9])
def test_a_broken_state_is_counted_as_an_end_and_the_next_state_is_sound(broken: float) -> None:
    state, step = _step([-0.02, 0.0], [broken, 0.0], 0.0)
    assert (step.terminated, step.reward, step.cost) == (1.0, 0.0, 0.0)
    assert jnp.isfinite(step.obs).all()
    assert jnp.abs(jnp.concatenate(state)).max() < 0.1


def test_an_action_that_is_not_a_number_is_counted_as_an_end() -> None:
    assert _step([0.0, 0.0], [0.0, 0.0], jnp.nan)[1].terminated == 1.0


def test_actions_are_clipped_to_the_box() -> None:
    beyond, edge = _step([0.0, 0.0], [0.0, 0.0], 7.0)[0], _step([0.0, 0.0], [0.0, 0.0], 3.0)[0]
    assert jnp.array_equal(beyond.qvel, edge.qvel)


def test_the_reward_is_read_before_the_noise_and_the_cost_after_it() -> None:
    state = RobotState(jnp.array([-0.005, 0.0]), jnp.zeros(2))
    keys = jax.random.split(jax.random.key(0), 64)
    noisy = jax.vmap(_pendulum(noise=0.05), in_axes=(0, None, None))(keys, state, jnp.zeros(1))[1]
    assert jnp.unique(noisy.reward).size == 1
    assert jnp.array_equal(noisy.cost, (noisy.obs[:, 0] < -0.015).astype(jnp.float32))
    assert 0 < noisy.cost.mean() < 1


@cache
def _model(body: str) -> Any:
    return compile_model(ROBOTS[body].body, "euler")


def _poses(body: str, number: int = 200) -> tuple[np.ndarray, np.ndarray]:
    random, model = np.random.default_rng(0), _model(body)
    return model.qpos0 + random.normal(size=(number, model.nq)), random.normal(size=(number, model.nv))


def _violations(body: str, qpos: np.ndarray, qvel: np.ndarray, **settings: Any) -> np.ndarray:
    rule = find_rule(body, options_of(body, settings), _model(body))
    states = RobotState(jnp.asarray(qpos, jnp.float32), jnp.asarray(qvel, jnp.float32))
    return np.asarray(jax.vmap(lambda state: rule.violated(state, jnp.zeros(ROBOTS[body].action_space.shape)))(states))


@pytest.mark.parametrize(
    ("body", "settings", "naive"),
    [
        ("swimmer", {"constraint": "speed", "limit": 0.3}, lambda qpos, qvel: qvel[:, 0] > 0.3),
        ("walker", {"constraint": "speed", "limit": -0.2, "side": "below"}, lambda qpos, qvel: qvel[:, 0] < -0.2),
        ("pendulum", {"constraint": "speed", "limit": 0.4, "side": "outside"}, lambda qpos, qvel: np.abs(qvel[:, 0]) > 0.4),
        ("walker", {"constraint": "height", "limit": 1.4}, lambda qpos, qvel: qpos[:, 1] > 1.4),
        ("walker", {"constraint": "height", "limit": 1.1, "side": "below"}, lambda qpos, qvel: qpos[:, 1] < 1.1),
        ("walker", {"constraint": "tilt", "limit": 0.5}, lambda qpos, qvel: np.abs(qpos[:, 2]) > 0.5),
        ("pendulum", {"constraint": "tilt", "limit": 0.1, "side": "above"}, lambda qpos, qvel: qpos[:, 1] > 0.1),
        ("swimmer", {"constraint": "joint", "joint": "rear", "limit": 0.7}, lambda qpos, qvel: np.abs(qpos[:, 4]) > 0.7),
        (
            "walker",
            {"constraint": "joint", "joint": "knee_left", "limit": -1.0, "side": "below"},
            lambda qpos, qvel: qpos[:, 7] < -1.0,
        ),
    ],
)
def test_speed_height_tilt_and_joint_are_what_qpos_and_qvel_say(body: str, settings: dict, naive: Any) -> None:
    qpos, qvel = _poses(body)
    found = _violations(body, qpos, qvel, **settings)
    assert 0 < found.mean() < 1
    np.testing.assert_array_equal(found, naive(qpos.astype(np.float32), qvel.astype(np.float32)))


FREE_BODY = """<mujoco><worldbody><body name="torso" pos="0 0 0.75"><freejoint name="root"/><geom size="0.2"/>
<body><joint name="hip" axis="0 0 1"/><geom size="0.1"/></body></body></worldbody></mujoco>"""
RAISED = """<mujoco><worldbody><body name="torso" pos="0 0 0.7"><joint name="x" type="slide" axis="1 0 0"/>
<joint name="z" type="slide" axis="0 0 1"/><joint name="pitch" axis="0 1 0"/><geom size="0.2"/></body></worldbody></mujoco>"""
ARM = """<mujoco><worldbody><body><joint name="shoulder" axis="0 0 1"/><geom size="0.2"/></body>
<body><joint name="target" type="slide" axis="1 0 0"/><geom size="0.1"/></body></worldbody></mujoco>"""


@pytest.mark.parametrize("mjcf", [FREE_BODY, RAISED])
def test_height_and_tilt_of_any_body_are_those_that_mujoco_has(mjcf: str) -> None:
    mujoco: Any = importlib.import_module("mujoco")
    model = mujoco.MjModel.from_xml_string(mjcf)
    measures, data, random = measures_of(model), mujoco.MjData(model), np.random.default_rng(1)
    for _ in range(20):
        data.qpos[:] = random.normal(size=model.nq)
        mujoco.mj_normalizeQuat(model, data.qpos)
        mujoco.mj_kinematics(model, data)
        state = jnp.asarray(data.qpos, jnp.float32), jnp.asarray(data.qvel, jnp.float32)
        found = {name: float(measure.of(*state)) for name, measure in measures.of_root.items()}
        assert found["height"] == pytest.approx(data.xpos[1, 2], abs=1e-5)
        assert found["position"] == pytest.approx(data.xpos[1, 0], abs=1e-5)
        assert np.cos(found["tilt"]) == pytest.approx(data.xmat[1].reshape(3, 3)[2, 2], abs=1e-5)


def test_an_arm_has_no_place_and_its_target_is_none() -> None:
    mujoco: Any = importlib.import_module("mujoco")
    measures = measures_of(mujoco.MjModel.from_xml_string(ARM))
    assert not measures.of_root and list(measures.joints) == ["shoulder", "target"]


def test_a_line_is_drawn_across_the_observed_coordinate_and_on_both_sides_where_both_violate() -> None:
    speed = make_env("walker", constraint="speed", limit=0.5)
    assert speed.limit == Limit("speed", 0.5, 8) and speed.coordinate_names[8] == "velocity of x"
    tilt = make_env("pendulum", constraint="tilt", limit=0.1)
    assert tilt.limit is not None and tilt.limit.lines == (-0.1, 0.1) and tilt.coordinate_names[1] == "tilt"
    assert tilt.constraint_input == "state" and tilt.shipped_demonstrations is None
