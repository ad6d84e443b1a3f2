"""What one episode hands on, on worlds whose only state is the step count, and the scan that it is made by."""

from dataclasses import replace
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jax.experimental import io_callback
from jaxtyping import Array

from aircl_jax.algorithm import hoisting
from aircl_jax.algorithm.hoisting import hoisted_scan
from aircl_jax.algorithm.rollout import rollout, rollouts
from aircl_jax.methods import get_method
from aircl_jax.model.networks import make_networks
from aircl_jax.settings.env_defaults import default_config
from aircl_jax.types import ObsStats, Trajectory
from envs import Step, make_env
from tests.worlds import KNOWN_REWARD, one_state_env, tiny_networks, unit_stats

DRAWS = ("random_bits", "random_split", "random_unwrap", "threefry2x32", "erf_inv")


def one_episode(horizon: int, **kind: bool) -> tuple[Trajectory, list[float], list[float]]:
    """An episode whose step t is paid 10 + t, and V of every observation on its way, and log π of each action."""
    env = one_state_env(lambda t, action: 10.0 + t, horizon=horizon, **kind)
    nets, params = tiny_networks(env, KNOWN_REWARD)
    stats = unit_stats(env)
    found = jax.jit(lambda key: rollout(nets.bind(params, stats), key))(jax.random.key(0))
    value = [float(nets.bind(params, stats).value(jnp.eye(horizon + 1)[t], jnp.asarray(t))) for t in range(horizon + 1)]
    assert min(map(abs, value)) > 1e-3
    log_prob = [
        float(nets.bind(params, stats).policy(jnp.eye(horizon + 1)[t], jnp.asarray(t)).log_prob(found.action[t]))
        for t in range(horizon)
    ]
    return found, value, log_prob


def test_an_episode_that_terminates_in_its_last_step_is_worth_nothing_after_it():
    found, _, _ = one_episode(1, terminates=True, finite_horizon=False)
    np.testing.assert_array_equal(found.mask, [1.0])
    assert found.bootstrap == 0.0


def test_an_episode_that_the_horizon_cuts_is_worth_the_value_of_the_state_after_the_last_step():
    found, value, _ = one_episode(2, finite_horizon=False)
    np.testing.assert_array_equal(found.mask, [1.0, 1.0])
    np.testing.assert_allclose(found.bootstrap, value[2], rtol=1e-5)


def test_an_episode_whose_task_ends_at_the_horizon_is_worth_nothing_after_it():
    found, _, _ = one_episode(2, finite_horizon=True)
    assert found.bootstrap == 0.0


def test_the_step_that_terminates_still_counts_and_none_after_it():
    found, _, _ = one_episode(3, terminates=True, finite_horizon=False)
    np.testing.assert_array_equal(found.mask, [1.0, 0.0, 0.0])


def test_an_episode_that_is_over_stays_over():
    base = one_state_env(lambda t, action: jnp.ones(()), horizon=4, finite_horizon=False)

    def step(key: Array, state: Any, action: Array) -> tuple[Any, Step]:
        after, result = base.step(key, state, action)
        return after, result._replace(terminated=(state == 1).astype(jnp.float32))

    env = replace(base, step=step)
    nets, params = tiny_networks(env, KNOWN_REWARD)
    found = jax.jit(lambda key: rollout(nets.bind(params, unit_stats(env)), key))(jax.random.key(0))
    np.testing.assert_array_equal(found.mask, [1.0, 1.0, 0.0, 0.0])
    assert found.bootstrap == 0.0


@pytest.mark.parametrize("t", [0, 1])
def test_a_step_holds_the_state_before_the_action_with_its_value_and_log_probability_and_the_reward_after_it(t):
    found, value, log_prob = one_episode(2)
    np.testing.assert_array_equal(found.obs[t], np.eye(3)[t])
    np.testing.assert_allclose([found.value[t], found.log_prob[t]], [value[t], log_prob[t]], rtol=1e-5)
    assert found.reward[t] == 10.0 + t


def walk(carry, inputs):
    """A walk that is drawn, pulled back by a constant, and that starts anew, by chance, from a drawn place."""
    place, ended = carry
    time, key = inputs
    moves, anew = jax.random.split(key)
    fresh = jax.random.normal(anew, (3,))
    place = jnp.where(ended, fresh, place * jnp.exp(jnp.full(3, -0.1)) + jax.random.normal(moves, (3,)))
    ended = jnp.abs(place).max() > 1.5
    return (place, ended), {"place": place, "fresh": fresh, "time": time, "constant": jnp.ones(2)}


def given(steps=40):
    return (jnp.zeros(3), jnp.array(False)), (jnp.arange(steps), jax.random.split(jax.random.key(0), steps))


def primitives(jaxpr):
    for equation in jaxpr.eqns:
        yield equation.primitive.name
        for value in equation.params.values():
            inner = getattr(value, "jaxpr", value)
            if hasattr(inner, "eqns"):
                yield from primitives(inner)


def loop_of(function, *inputs):
    """The names of all that the program's one scan does."""
    (scan,) = [each for each in jax.make_jaxpr(function)(*inputs).jaxpr.eqns if each.primitive.name == "scan"]
    return set(primitives(scan.params["jaxpr"].jaxpr))


def test_a_hoisted_scan_gives_what_a_scan_gives():
    expected, found = jax.lax.scan(walk, *given()), hoisted_scan(walk, *given())
    assert jax.tree.structure(expected) == jax.tree.structure(found)
    for one, other in zip(jax.tree.leaves(expected), jax.tree.leaves(found), strict=True):
        np.testing.assert_allclose(one, other, rtol=1e-6, atol=1e-6)
    assert len(set(np.asarray(found[1]["fresh"]).ravel())) == 120  # each step has draws of its own


def test_a_hoisted_scan_gives_the_same_within_a_batch_with_parameters_of_its_own():
    def of_one(pull, key):
        def step(carry, inputs):
            (place, ended), out = walk((carry[0] * pull, carry[1]), inputs)
            return (place, ended), out["place"]

        return [scan(step, given()[0], (jnp.arange(9), jax.random.split(key, 9)))[1] for scan in (jax.lax.scan, hoisted_scan)]

    expected, found = jax.vmap(of_one)(jnp.linspace(0.1, 0.9, 5), jax.random.split(jax.random.key(1), 5))
    np.testing.assert_allclose(expected, found, rtol=1e-5, atol=1e-6)


def test_no_draw_is_left_in_the_loop():
    assert set(DRAWS) & loop_of(lambda *inputs: jax.lax.scan(walk, *inputs), *given())
    assert not set(DRAWS) & loop_of(lambda *inputs: hoisted_scan(walk, *inputs), *given())


@pytest.mark.parametrize("name", ["LARGEST", "MOST"])
def test_what_is_large_is_computed_within_the_loop(name, monkeypatch):
    monkeypatch.setattr(hoisting, name, 2)
    assert "erf_inv" in loop_of(lambda *inputs: hoisted_scan(walk, *inputs), *given())
    np.testing.assert_allclose(
        hoisted_scan(walk, *given())[1]["place"], jax.lax.scan(walk, *given())[1]["place"], rtol=1e-6, atol=1e-6
    )


def test_a_hoisted_scan_takes_what_a_scan_takes():
    """No input that is read, an input that is handed on, literals as carry and output, a single step."""

    def step(carry, x):
        return (jnp.float32(1.0), carry[1] + 1), (x, 2.0, carry[0])

    for length in (1, 3):
        start, xs = (jnp.zeros(()), jnp.zeros((), jnp.int32)), jnp.arange(length)
        for one, other in zip(
            *map(jax.tree.leaves, (hoisted_scan(step, start, xs), jax.lax.scan(step, start, xs))), strict=True
        ):
            np.testing.assert_array_equal(one, other)
    ended, _ = hoisted_scan(lambda carry, x: (carry + 1, None), jnp.zeros(()), jnp.arange(4))
    assert float(ended) == 4.0
    with pytest.raises(TypeError, match="carry"):
        hoisted_scan(lambda carry, x: ((carry, carry), x), jnp.zeros(()), jnp.arange(3))


def test_side_effects_keep_their_place():
    seen = []

    def step(carry, x):
        io_callback(lambda each: seen.append(int(each)), None, x, ordered=True)
        return carry + x, x * 2

    end, doubled = hoisted_scan(step, jnp.zeros((), jnp.int32), jnp.arange(5))
    jax.effects_barrier()
    assert (int(end), doubled.tolist(), seen) == (10, [0, 2, 4, 6, 8], [0, 1, 2, 3, 4])


@pytest.mark.parametrize("name", ["pendulum", "swimmer"])
def test_a_rollout_of_a_robot_draws_nothing_step_by_step(name):
    env = make_env(name)
    method = get_method("aircl_corrected")
    nets = make_networks(env, method, default_config(name, method.settings))
    params, stats = nets.init(jax.random.key(0)), ObsStats.of(jnp.zeros(env.obs_size), jnp.ones(env.obs_size))
    assert not set(DRAWS) & loop_of(lambda key: rollouts(nets.bind(params, stats), key, 3), jax.random.key(1))
