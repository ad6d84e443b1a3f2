"""A world that is not JAX: its episodes are Gymnasium's own, and its states are values."""

import json
import time
from functools import cache
from typing import Any

import gymnasium
import jax
import jax.numpy as jnp
import numpy as np
import pytest

import envs
from aircl_jax import train
from envs import Env, Limit, from_gymnasium, make_env
from envs.checks import check_env
from envs.robots.practice_worlds import restarting
from envs.simulators import host as hosts
from tests.envs.simulators.carts import HORIZON, Cart, fast


@cache
def world() -> Env:
    return from_gymnasium(Cart, fast, HORIZON)


@cache
def stepping() -> Any:
    return jax.jit(jax.vmap(world().step))


def begun(number: int = 4) -> Any:
    return jax.vmap(world().reset)(jax.random.split(jax.random.key(0), number))[0]


def pushes(number: int = 4, seed: int = 0) -> np.ndarray:
    return np.random.default_rng(seed).uniform(-1, 1, size=(HORIZON, number, 1)).astype(np.float32)


def played(states: Any, actions: np.ndarray, step: Any = None) -> tuple[Any, list[Any]]:
    steps, keys = [], jax.random.split(jax.random.key(1), actions.shape[1])
    for action in actions:
        states, result = (step or stepping())(keys, states, jnp.asarray(action))
        steps.append(jax.device_get(result))
    return states, steps


def test_episodes_are_gymnasiums_own():
    states, actions = begun(), pushes() + 0.4
    _, steps = played(states, actions)
    for i, seed in enumerate(np.asarray(states.seed)):
        cart, ended = Cart(), False
        obs, _ = cart.reset(seed=int(seed))
        np.testing.assert_array_equal(states.obs[i], obs.astype(np.float32))
        for t in range(HORIZON):
            if not ended:
                obs, reward, ended, *_ = cart.step(np.clip(actions[t, i], -1, 1))
                assert steps[t].reward[i] == np.float32(reward)
                assert steps[t].cost[i] == float(abs(np.float32(obs[1])) > 0.5)
            else:
                assert (steps[t].reward[i], steps[t].cost[i]) == (0.0, 0.0)
            np.testing.assert_array_equal(steps[t].obs[i], obs.astype(np.float32))
            assert steps[t].terminated[i] == ended
    assert 0 < np.mean([step.terminated for step in steps]) < 1


def test_a_state_is_a_value_from_which_two_may_go_on():
    middle, _ = played(begun(), pushes()[:2])
    one, other = pushes(seed=1)[:3], pushes(seed=2)[:3]
    first, second = played(middle, one)[1], played(middle, other)[1]
    alone = played(played(begun(), pushes()[:2])[0], other)[1]
    np.testing.assert_array_equal(second[-1].obs, alone[-1].obs)
    assert (first[-1].obs != second[-1].obs).all()
    np.testing.assert_array_equal(played(middle, one)[1][-1].obs, first[-1].obs)


def test_a_state_goes_on_in_another_process_as_a_resumed_run_has_it():
    middle, _ = played(begun(), pushes()[:3])
    expected = played(middle, pushes()[3:])[1][-1].obs
    another = from_gymnasium(Cart, fast, HORIZON)
    step = jax.jit(jax.vmap(another.step))
    np.testing.assert_array_equal(played(middle, pushes()[3:], step)[1][-1].obs, expected)


def test_an_episode_is_the_same_alone_and_among_others():
    states, actions = begun(), pushes()
    together = played(states, actions)[1][-1].obs
    alone = played(jax.tree.map(lambda leaf: leaf[2:3], states), actions[:, 2:3])[1][-1].obs
    np.testing.assert_array_equal(alone[0], together[2])
    by_two = jax.vmap(jax.vmap(world().step))
    pairs = jax.tree.map(lambda leaf: leaf.reshape(2, 2, *leaf.shape[1:]), states)
    keys = jax.random.split(jax.random.key(1), (2, 2))
    first = by_two(keys, pairs, jnp.asarray(actions[0]).reshape(2, 2, 1))[1].obs
    np.testing.assert_array_equal(first.reshape(4, 2), played(states, actions[:1])[1][0].obs)


def test_what_the_host_has_no_room_for_is_played_again(monkeypatch):
    expected = played(begun(), pushes())[1][-1].obs
    monkeypatch.setattr(hosts, "KEPT", 0)
    np.testing.assert_array_equal(played(begun(), pushes())[1][-1].obs, expected)


def test_worlds_are_used_again_and_their_number_stays():
    played(begun(), pushes())
    made = Cart.made
    for seed in range(5):
        played(begun(), pushes(seed=seed))
    assert Cart.made - made <= 4


def test_a_step_beyond_the_horizon_does_not_count_and_a_practice_world_begins_anew():
    last, steps = played(begun(), pushes() * 0.1)
    assert all(step.counts.all() for step in steps) and not steps[-1].terminated.any()
    again, (beyond,) = played(last, pushes()[:1])
    assert beyond.terminated.all() and not beyond.counts.any() and not beyond.reward.any()
    np.testing.assert_array_equal(again.steps, last.steps)
    practice = restarting(world(), 0.0)
    step = jax.jit(jax.vmap(practice.step))
    (inner, _), (_, reset) = played((last, jnp.zeros(4)), pushes()[:2], step)
    assert not reset.counts.any() and not inner.steps.any() and not inner.over.any()


def test_its_own_cost_may_be_the_cost():
    env = from_gymnasium(Cart, "info", HORIZON)
    state, _ = env.reset(jax.random.key(0))
    for push, costs in ((-1.0, 0.0), (1.0, 0.0), (1.0, 1.0)):
        state, step = env.step(jax.random.key(0), state, jnp.array([push]))
        assert step.cost == costs == float(step.obs[1] > 0.5)


def test_a_registered_world_has_a_limit_across_its_coordinate():
    env = make_env("gymnasium", task="Pendulum-v1", constraint="coordinate", coordinate=2, limit=6.0)
    check_env(env)
    assert env.title == "gymnasium Pendulum-v1" and env.limit == Limit("coordinate", 6.0, 2, both_sides=True)
    assert (env.horizon, env.obs_size, env.action_space) == (200, 3, envs.Box(1, -2.0, 2.0))
    again = from_gymnasium(gymnasium.make("Pendulum-v1"), fast, 200)
    assert again.name == "pendulumenv" and not again.registered


@pytest.mark.slow
@pytest.mark.usefixtures("no_figures")
def test_a_resumed_run_has_the_same_bytes_as_an_uninterrupted_one(tmp_path):
    steps = np.concatenate([pushes(3), np.zeros((HORIZON, 3, 1), np.float32)], axis=-1).swapaxes(0, 1)
    np.savez(tmp_path / "mine.npz", obs=steps, action=steps[..., :1])
    config = {"num_trajectories": 6, "num_evaluation": 5, "hidden": [4], "checkpoint_every": 2, "iterations": 4}
    common: Any = {"env": world(), "method": "airl", "seeds": 2, "demonstrations": tmp_path / "mine.npz", "config": config}
    train(**common, run_dir=tmp_path / "whole")
    train(**common, iterations=2, run_dir=tmp_path / "resumed")
    train(**common, run_dir=tmp_path / "resumed", resume=True)
    whole, resumed = ((tmp_path / name / "metrics.jsonl").read_bytes() for name in ("whole", "resumed"))
    assert whole == resumed and len(whole.splitlines()) == 4
    assert json.loads((tmp_path / "whole" / "summary.json").read_text())["env"] == "cart"


def _microseconds_a_step(env: Env) -> float:
    """Of this process's processors, in rollouts of 50 episodes of 100 steps of random actions; the least of three."""

    def episode(key):
        def one_step(state, key):
            action = jax.random.normal(key, env.action_space.shape)
            state, step = env.step(key, state, action)
            return state, step.reward

        return jax.lax.scan(one_step, env.reset(key)[0], jax.random.split(key, 100))[1].sum()

    run = jax.jit(jax.vmap(episode))
    spent = []
    for seed in range(4):
        started = time.process_time()
        jax.block_until_ready(run(jax.random.split(jax.random.key(seed), 50)))
        spent.append(time.process_time() - started)
    return min(spent[1:]) / 5000 * 1e6


@pytest.mark.slow
def test_a_call_of_the_host_costs_many_steps_of_a_world_in_jax():
    bare = gymnasium.make("Pendulum-v1").unwrapped
    bare.reset(seed=0)
    started = time.process_time()
    for _ in range(5000):
        bare.step(np.zeros(1, np.float32))
    alone = (time.process_time() - started) / 5000 * 1e6
    hosted, ours = (_microseconds_a_step(make_env(*args)) for args in (("gymnasium",), ("pendulum",)))
    print(f"\nPendulum-v1 {hosted:.1f} µs a step, {alone:.1f} of them Gymnasium's own; our pendulum in JAX {ours:.2f}")
    assert ours < alone < hosted < 20 * alone
