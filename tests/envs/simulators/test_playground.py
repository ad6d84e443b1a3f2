"""Playground's tasks by name, where it is installed, and worlds whose observations have names."""

import importlib.util
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import pytest

from envs import adapt, make_env
from envs.checks import check_env


class State(NamedTuple):
    obs: Any
    reward: Any
    done: Any


class Named:
    """A world that shows two vectors by name: where it is, and the opposite."""

    action_size = 2

    def reset(self, key):
        return self._at(jnp.zeros(2))

    def step(self, state, action):
        return self._at(state.obs["state"] + action)

    def _at(self, place):
        return State({"state": place, "privileged": -jnp.append(place, 1.0)}, jnp.zeros(()), jnp.zeros(()))


class Flat(Named):
    def _at(self, place):
        return State(jnp.zeros((2, 2)), jnp.zeros(()), jnp.zeros(()))


class Plain(Named):
    def _at(self, place):
        return State(jnp.zeros(2), jnp.zeros(()), jnp.zeros(()))


def far(state, action):
    return jnp.zeros((), bool)


def test_one_of_several_observations_is_seen_by_its_name():
    env = adapt(Named(), far, horizon=5, observation="privileged")
    check_env(env)
    state, obs = env.reset(jax.random.key(0))
    assert env.obs_size == 3 and obs.tolist() == [0.0, 0.0, -1.0]
    assert env.step(jax.random.key(0), state, jnp.array([0.5, 1.0]))[1].obs.tolist() == [-0.5, -1.0, -1.0]


@pytest.mark.parametrize(
    ("world", "name", "message"),
    [
        (Named(), "", "observations of Named have names; choose observation from privileged, state"),
        (Named(), "pixels", "observations of Named have names; choose observation from privileged, state"),
        (Plain(), "state", "observation=state: those of Plain have no names; leave it out"),
        (Flat(), "", "observations of Flat are no vector; choose an env with one"),
    ],
)
def test_a_missing_or_a_wrong_name_is_one_line(world, name, message):
    with pytest.raises(ValueError, match=message):
        adapt(world, far, horizon=5, observation=name)


def test_without_playground_one_line_names_the_extra(monkeypatch):
    monkeypatch.setattr("envs.simulators.playground.find_spec", lambda name: None)
    with pytest.raises(
        ValueError, match=r"needs the package playground, which is not installed; install aircl-jax\[playground\]"
    ):
        make_env("playground", task="CartpoleBalance")


@pytest.mark.slow
@pytest.mark.skipif(importlib.util.find_spec("mujoco_playground") is None, reason="the extra `playground` is not installed")
@pytest.mark.filterwarnings("ignore")
def test_cartpole_balance_moves_and_costs_what_qpos_says():
    env = make_env("playground", task="CartpoleBalance", constraint="position", limit=-0.1, horizon=10)
    check_env(env)
    (state, obs), step = jax.jit(env.reset)(jax.random.key(0)), jax.jit(env.step)
    assert env.title == "playground CartpoleBalance" and obs.shape == (5,)
    costs = []
    for _ in range(10):
        state, result = step(jax.random.key(0), state, jnp.array([-1.0]))
        costs.append(float(result.cost))
        assert costs[-1] == float(state.data.qpos[0] < -0.1)
    assert 0 < sum(costs) < 10
    with pytest.raises(ValueError, match="unknown constraint 'height' of CartpoleBalance; choose from none, torque, position"):
        make_env("playground", task="CartpoleBalance", constraint="height")
