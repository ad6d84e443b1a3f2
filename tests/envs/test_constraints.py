"""The robots' constraints, settings and ends; nothing here compiles a physics step but the smallest body's."""

from functools import cache
from typing import Any

import jax
import jax.numpy as jnp
import pytest

from aircl_jax.demonstrations.sources import demonstrations
from aircl_jax.settings.train_config import TrainConfig
from envs import Step, make_env
from envs.robots.constraints import CONSTRAINTS, Constraint, find_constraint
from envs.robots.tasks import RobotState

POSE = jnp.zeros(5)


@cache
def _pendulum(**settings: Any) -> Any:
    return jax.jit(make_env("pendulum", **settings).step)


def _step(qpos: list[float], qvel: list[float], action: float, **settings: Any) -> tuple[RobotState, Step]:
    state = RobotState(jnp.array(qpos), jnp.array(qvel))
    return _pendulum(**settings)(jax.random.key(0), state, jnp.array([action]))


@pytest.mark.parametrize(("action", "violates"), [([0.5, -0.5], False), ([0.51, 0.0], True), ([0.0, -0.51], True)])
def test_torque_is_violated_strictly_above_half_of_full_torque_on_either_side(action: list[float], violates: bool) -> None:
    rule = find_constraint("torque", "swimmer")
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
    rule = find_constraint("position", body)
    assert bool(rule.violated(POSE.at[0].set(x), jnp.zeros(2), rule.limit)) is violates


@pytest.mark.parametrize(
    ("name", "settings", "says"),
    [
        ("pendulum", {"constraint": "torque"}, "unknown constraint 'torque' of pendulum; choose from position, none"),
        (
            "swimmer",
            {"constraint": "speed"},
            "unknown constraint 'speed' of swimmer; choose from torque, position, none",
        ),
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
