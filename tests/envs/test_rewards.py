"""Other rewards and the cost of actions, by hand on two states."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from envs import make_env
from envs.options import PendulumOptions, RobotOptions
from envs.robots.rewards import rewarded
from envs.robots.tasks import ROBOTS, RobotState

DT = 0.5
SIX = jnp.array([0.6, -0.8, 0.0, 0.0, 0.0, 0.0])
ACTION = {
    "swimmer": jnp.array([0.6, -0.8]),
    "walker": SIX,
    "halfcheetah": SIX,
    "hopper": jnp.array([0.6, 0.0, -0.8]),
    "pendulum": jnp.array([2.0]),
}
SIZE = {"swimmer": 5, "walker": 9, "halfcheetah": 9, "hopper": 6, "pendulum": 2}  # joints


def _at(name: str, x: float, second: float) -> RobotState:
    return RobotState(jnp.zeros(SIZE[name]).at[0].set(x).at[1].set(second), jnp.zeros(SIZE[name]))


def _reward(name: str, options: RobotOptions, x: tuple[float, float], second: float) -> float:
    """The reward of a step from x[0] to x[1], where the second coordinate of qpos is `second`."""
    before, after = (_at(name, place, second) for place in x)
    task = rewarded(ROBOTS[name].tasks["wall" if name == "pendulum" else "forward"], name, options)
    return float(task.reward(before, after, ACTION[name], DT))


@pytest.mark.parametrize(
    ("name", "reward", "x", "second", "expected"),
    [
        # from 0.2 to 0.7 m in 0.5 s is 1 m/s; ‖a‖² = 1; walker and hopper are upright at 1.25 m and not at 0.5 m
        ("swimmer", "task", (0.2, 0.7), 0.0, 1.0 - 1e-4),
        ("swimmer", "backwards", (0.2, 0.7), 0.0, -1.0 - 1e-4),
        ("swimmer", "backwards", (0.7, 0.2), 0.0, 1.0 - 1e-4),
        ("swimmer", "stand", (0.2, 0.7), 0.0, -1.0),
        ("swimmer", "stand", (0.7, 0.2), 0.0, -1.0),
        ("swimmer", "target", (0.2, 0.7), 0.0, 0.6 - 1e-4),  # from 0.4 m before its target, 0.6 m, to 0.1 m beyond
        ("walker", "backwards", (0.2, 0.7), 1.25, -1.0 + 1.0 - 1e-3),
        ("walker", "backwards", (0.7, 0.2), 0.5, 1.0 - 1e-3),
        ("walker", "stand", (0.2, 0.7), 1.25, 1.0 - 1e-3),
        ("walker", "stand", (0.2, 0.7), 0.5, -1e-3),
        ("walker", "target", (0.7, 0.2), 1.25, -1.0 + 1.0 - 1e-3),
        ("halfcheetah", "task", (0.2, 0.7), 0.0, 1.0 - 0.1),
        ("halfcheetah", "backwards", (0.2, 0.7), 0.0, -1.0 - 0.1),
        ("halfcheetah", "stand", (0.2, 0.7), 0.0, -1.0),
        ("halfcheetah", "target", (0.7, 0.2), 0.0, -1.0 - 0.1),
        ("hopper", "task", (0.2, 0.7), 1.25, 1.0 + 1.0 - 1e-3),
        ("hopper", "task", (0.2, 0.7), 0.5, 1.0 - 1e-3),
        ("hopper", "backwards", (0.2, 0.7), 1.25, -1.0 + 1.0 - 1e-3),
        ("hopper", "stand", (0.2, 0.7), 1.25, 1.0 - 1e-3),
        ("hopper", "stand", (0.2, 0.7), 0.5, -1e-3),
        ("hopper", "target", (0.7, 0.2), 1.25, -1.0 + 1.0 - 1e-3),
        ("pendulum", "stand", (0.2, 0.7), 0.1, 1.0),
        ("pendulum", "stand", (0.2, 0.7), 0.3, 0.0),
        ("pendulum", "target", (0.2, 0.7), 0.1, 0.7),
        ("pendulum", "target", (0.2, -0.3), 0.1, 0.0),
        ("pendulum", "target", (0.2, 0.7), 0.3, 0.0),
    ],
)
def test_each_reward_by_hand(name: str, reward: str, x: tuple[float, float], second: float, expected: float) -> None:
    target = 0.6 if name == "swimmer" else 1.0
    found = _reward(name, RobotOptions(reward=reward, target=target), x, second)
    assert found == pytest.approx(expected, abs=1e-6)


@pytest.mark.parametrize(
    ("name", "second", "alive", "weight"),
    [("swimmer", 0.0, 0.0, 1e-4), ("walker", 1.25, 1.0, 1e-3), ("halfcheetah", 0.0, 0.0, 0.1), ("hopper", 1.25, 1.0, 1e-3)],
)
def test_before_a_wall_either_way_is_paid_alike(name: str, second: float, alive: float, weight: float) -> None:
    left, right = (_at(name, x, second) for x in (0.2, 0.7))
    reward = ROBOTS[name].tasks["wall"].reward
    ahead, back = (float(reward(*way, ACTION[name], DT)) for way in ((left, right), (right, left)))
    assert ahead == back == pytest.approx(1.0 + alive - weight, abs=1e-6)


@pytest.mark.parametrize("reward", ["task", "backwards"])
def test_the_cost_of_actions_is_quadratic_and_comes_off_any_reward(reward: str) -> None:
    plain, costly = (
        _reward("swimmer", RobotOptions(reward=reward, action_cost=weight), (0.0, 0.1), 0.0) for weight in (0.0, 0.1)
    )
    assert plain - costly == pytest.approx(0.1 * 1.0, abs=1e-6)


def test_a_world_pays_for_the_clipped_action() -> None:
    state = RobotState(jnp.zeros(2), jnp.zeros(2))
    plain, costly = (make_env("pendulum", reward="stand", action_cost=weight) for weight in (0.0, 0.1))
    action = jnp.array([5.0])  # clipped to 3
    earned = [jax.jit(env.step)(jax.random.key(0), state, action)[1].reward for env in (plain, costly)]
    np.testing.assert_allclose(earned, [1.0, 1.0 - 0.9], atol=1e-6)


@pytest.mark.parametrize(
    ("name", "settings", "says"),
    [
        ("swimmer", {"reward": "fly"}, "unknown reward 'fly' of swimmer; choose from task, backwards, stand, target"),
        ("pendulum", {"reward": "backwards"}, "unknown reward 'backwards' of pendulum; choose from task, stand, target"),
        ("swimmer", {"target": float("nan")}, "env.target=nan is not a number"),
        ("swimmer", {"action_cost": -0.1}, "wrong env.action_cost -0.1; choose a number that is not negative"),
    ],
)
def test_a_wrong_reward_names_itself_its_value_and_the_choices(name: str, settings: dict, says: str) -> None:
    with pytest.raises(ValueError, match=says):
        make_env(name, **settings)


def test_another_reward_ships_no_demonstrations_and_shows_what_the_task_shows() -> None:
    plain, still, costly = make_env("swimmer"), make_env("swimmer", reward="stand"), make_env("swimmer", action_cost=0.1)
    assert (plain.shipped_demonstrations, still.shipped_demonstrations, costly.shipped_demonstrations) == (
        "swimmer_torque",
        None,
        None,
    )
    assert still.obs_size == plain.obs_size
    assert PendulumOptions().target == 0.5
