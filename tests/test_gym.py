"""Gymnasium's own checker passes every world, and a step there is a step of ours."""

import re
import subprocess
import sys
import time
import warnings
from pathlib import Path
from typing import Any

import gymnasium
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env

import aircl_jax
from aircl_jax import gym
from envs import ENVS, Box
from envs.simulators.options import GuestOptions
from tests.worlds import one_state_env, tiny_grid

SMALL = {"meerkat": {"horizon": 6}, "labyrinth": {"horizon": 6}}


@pytest.mark.parametrize("name", [name for name, row in ENVS.items() if not issubclass(row.options, GuestOptions)])
def test_the_checker_passes_every_world(name):
    world = gym.make(name, **SMALL.get(name, {}))
    with warnings.catch_warnings():
        for advice in (
            "infinity",
            "recommend using a symmetric",
        ):  # robots' coordinates are unbounded; the pendulum's box is ±3
            warnings.filterwarnings("ignore", message=f".*{advice}")
        check_env(world, skip_render_check=True, skip_close_check=True)
    obs, info = world.reset(seed=3)
    assert world.observation_space.contains(obs) and info == {}
    obs, reward, *_, info = world.step(world.action_space.sample())
    assert world.observation_space.contains(obs) and np.isfinite(reward)
    assert info.get("cost", 0.0) in (0.0, 1.0) and ("cost" in info or name in ("meerkat", "labyrinth"))


def test_steps_are_the_worlds_own():
    world = gym.World(tiny_grid(horizon=6))
    world.reset(seed=0)
    for t, action in enumerate((1, 1, 3, 3, 0, 2)):
        key, state = world._key, world._state
        obs, reward, terminated, truncated, info = world.step(action)
        expected = world.env.step(jax.random.split(key)[0], state, jnp.asarray(action))[1]
        np.testing.assert_array_equal(obs, expected.obs)
        assert (reward, info["cost"]) == (float(expected.reward), float(expected.cost))
        assert (terminated, truncated) == (t == 5, False)  # the grid's task ends at its horizon


def test_an_episode_is_truncated_at_the_horizon_and_ends_where_it_terminates():
    def run(**ends):
        world = gym.World(one_state_env(lambda t, action: action.sum(), horizon=3, action_space=Box(1), **ends))
        world.reset(seed=0)
        return [world.step(np.ones(1))[1:4] for _ in range(1 if ends.get("terminates") else 3)]

    assert run(finite_horizon=False) == [(1.0, False, False)] * 2 + [(1.0, False, True)]
    assert run(finite_horizon=True)[-1] == (1.0, True, False)
    assert run(finite_horizon=False, terminates=True) == [(1.0, True, False)]


def test_a_seed_begins_the_same_episodes_and_the_next_one_is_another():
    world = gym.make("swimmer", horizon=4)
    first, second = world.reset(seed=1)[0], world.reset()[0]
    assert (first != second).all()
    np.testing.assert_array_equal(world.reset(seed=1)[0], first)
    moved = world.step(np.zeros(2))[0]
    world.reset(seed=1)
    np.testing.assert_array_equal(world.step(np.zeros(2))[0], moved)


def test_no_step_is_taken_before_a_reset_or_after_an_end():
    world = gym.World(tiny_grid(horizon=4))
    with pytest.raises(RuntimeError, match="call reset first"):
        world.step(0)
    world.reset(seed=0)
    for _ in range(4):
        world.step(0)
    with pytest.raises(RuntimeError, match="call reset first"):
        world.step(0)


@pytest.mark.parametrize(
    ("world", "action", "said"),
    [
        (lambda: gym.World(tiny_grid(horizon=4)), 4, "action=4 is none of gridworld; choose from 0 to 3"),
        (lambda: gym.World(tiny_grid(horizon=4)), -1, "action=-1 is none"),
        (lambda: gym.World(tiny_grid(horizon=4)), 1.0, r"action=1\.0 is none"),
        (lambda: gym.World(tiny_grid(horizon=4)), [1], r"action has shape \[1\]; gridworld needs \[\]"),
        (lambda: gym.make("swimmer", horizon=4), np.zeros(3), r"action has shape \[3\]; swimmer needs \[2\]"),
        (lambda: gym.make("swimmer", horizon=4), [0.0, np.nan], r"action=\[0\.0, nan\] is not finite"),
    ],
)
def test_what_is_no_action_is_refused_and_costs_no_step(world, action, said):
    made = world()
    made.reset(seed=0)
    with pytest.raises(ValueError, match=said):
        made.step(action)
    assert made._steps == 0


def test_worlds_are_registered_and_wrong_names_are_one_line():
    world = gymnasium.make("aircl/pendulum-v0", horizon=3, disable_env_checker=True)
    assert world.reset(seed=0)[0].shape == (4,)
    assert aircl_jax.gym is gym
    with pytest.raises(ValueError, match="unknown env 'cheetah'; choose from gridworld"):
        gym.make("cheetah")


def test_without_gymnasium_one_line_names_the_extra():
    code = "import sys; sys.modules['gymnasium'] = None\ntry:\n import aircl_jax.gym\nexcept ImportError as error: print(error)"
    said = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True, timeout=120).stdout
    assert said == "aircl_jax.gym needs the package gymnasium, which is not installed; install aircl-jax[gym]\n"


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore")  # of torch and of stable-baselines3
def test_the_documented_example_trains_ppo_of_stable_baselines_on_the_swimmer():
    pytest.importorskip("stable_baselines3", reason="stable-baselines3 is not installed")
    page = (Path(__file__).parents[1] / "docs" / "deploy.md").read_text(encoding="utf-8")
    [example] = re.findall(r"^```python\n(from stable_baselines3.*?)^```$", page, flags=re.MULTILINE | re.DOTALL)
    names: dict[str, Any] = {"aircl_jax": aircl_jax}
    exec(compile(example, "docs/deploy.md", "exec"), names)
    print(names["earned"], names["violations"])
    assert names["earned"] > 15  # at random it swims nowhere: −7 to 11
    assert names["violations"] > 100  # PPO knows of no cost; random actions violate in three steps of four


@pytest.mark.slow
def test_a_step_takes_less_than_a_millisecond():
    world = gym.make("swimmer")
    world.reset(seed=0)
    world.step(np.zeros(2))
    started = time.perf_counter()
    for _ in range(200):
        world.step(np.zeros(2))
    assert (time.perf_counter() - started) / 200 < 1e-3
