"""Brax's tasks by name: the constraint is what (q, qd) say, and what does not run is one line."""

import json
from types import SimpleNamespace
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from envs import Limit, make_env
from envs.checks import check_env
from envs.robots.robot import compile_model
from envs.robots.tasks import ROBOTS
from experiments.run import main

pytestmark = pytest.mark.filterwarnings("ignore:Brax System:UserWarning", "ignore:JAXopt:DeprecationWarning")
library: Any = pytest.importorskip("brax.envs", reason="brax is not installed")


class Pipeline(NamedTuple):
    q: Any
    qd: Any


class State(NamedTuple):
    pipeline_state: Pipeline
    obs: Any
    reward: Any
    done: Any


class Walking:
    """A world of the walker's joints whose state is what its action says: qpos from the first two, qvel from the third."""

    action_size = 3
    sys = SimpleNamespace(mj_model=compile_model(ROBOTS["walker"].body, "euler"))

    def reset(self, key):
        return self._at(jnp.zeros(3))

    def step(self, state, action):
        return self._at(action)

    def _at(self, action):
        q = jnp.zeros(9).at[0].set(action[0]).at[2].set(action[1])
        qd = jnp.zeros(9).at[0].set(action[2])
        return State(Pipeline(q, qd), jnp.concatenate([q, qd]), jnp.zeros(()), jnp.zeros(()))


@pytest.fixture
def walking(monkeypatch):
    monkeypatch.setattr(library, "get_environment", lambda name, backend: Walking())


@pytest.mark.parametrize(
    ("settings", "naive"),
    [
        ({"constraint": "position", "limit": -0.3}, lambda action: action[:, 0] < -0.3),
        ({"constraint": "tilt", "limit": 0.4}, lambda action: np.abs(action[:, 1]) > 0.4),
        ({"constraint": "speed", "limit": 0.2}, lambda action: action[:, 2] > 0.2),
        ({"constraint": "torque", "limit": 0.8}, lambda action: (np.abs(action) > 0.8).any(axis=1)),
        ({"constraint": "none"}, lambda action: np.zeros(len(action), bool)),
    ],
)
def test_the_cost_is_what_q_qd_and_the_action_say(walking, settings, naive):
    env = make_env("brax", task="walker2d", **settings)
    actions = np.random.default_rng(0).uniform(-1, 1, size=(100, 3)).astype(np.float32)
    state, _ = env.reset(jax.random.key(0))
    _, steps = jax.vmap(lambda action: env.step(jax.random.key(0), state, action))(jnp.asarray(actions))
    np.testing.assert_array_equal(np.asarray(steps.cost) > 0, naive(actions))


def test_the_world_is_named_with_its_task_and_a_torque_limit_is_drawn(walking):
    env = make_env("brax", task="walker2d", constraint="torque", limit=0.5, horizon=20)
    assert (env.name, env.title, env.horizon, env.registered) == ("brax", "brax walker2d", 20, True)
    assert env.limit == Limit("torque", 0.5, "actions") and env.constraint_input == "state_action"


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"task": "horse"}, "unknown env.task 'horse' of brax; choose from ant, halfcheetah"),
        ({"constraint": "colour"}, "unknown constraint 'colour' of ant; choose from none, torque, position, speed, height"),
        ({"constraint": "speed"}, "env.limit=default: env.constraint=speed has no limit of its own; choose a number, in m/s"),
        ({"backend": "bullet"}, "env.backend=bullet is not one of generalized, spring, positional, mjx"),
        ({"horizon": 0}, "wrong env.horizon 0; choose a whole number above 0"),
    ],
)
def test_a_mistake_is_one_line(walking, settings, message):
    with pytest.raises(ValueError, match=message.replace("(", r"\(")):
        make_env("brax", **{"task": "ant", **settings})


def test_a_task_that_does_not_run_with_the_versions_installed_is_one_line(monkeypatch):
    def broken(name, backend):
        raise TypeError("clip() got an unexpected keyword argument 'a_min'\nmore")

    monkeypatch.setattr(library, "get_environment", broken)
    with pytest.raises(ValueError, match=r"env.task=swimmer of brax does not run here \(TypeError: clip\(\) got .*; brax .*\)"):
        make_env("brax", task="swimmer")


@pytest.mark.slow
def test_braxs_own_swimmer_is_refused_and_its_ant_is_taken():
    check_env(make_env("brax", task="ant", constraint="position", limit=-3.0))
    with pytest.raises(ValueError, match=r"^env=brax swimmer: step cannot be traced \(TypeError: clip"):
        check_env(make_env("brax", task="swimmer"))


@pytest.mark.slow
@pytest.mark.usefixtures("no_figures")
def test_a_task_trains_from_the_command_line(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    world = "env=brax env.task=inverted_pendulum env.backend=spring env.horizon=8 env.constraint=speed env.limit=0.05"
    small = "scale=smoke seeds=1 iterations=2 train.num_trajectories=4 train.num_evaluation=4 train.hidden=[4]"
    obs, action = np.zeros((3, 8, 4), np.float32), np.zeros((3, 8, 1), np.float32)
    np.savez("mine.npz", obs=obs + np.random.default_rng(0).normal(size=obs.shape), action=action)
    assert main(f"{world} {small} demonstrations=mine.npz run_dir=out".split()) == 0
    assert json.loads((tmp_path / "out/summary.json").read_text())["env"] == "brax inverted_pendulum"
