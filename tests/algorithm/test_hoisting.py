"""A hoisted scan gives what a scan gives; of its loop are left only what the carry enters, and what is large."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jax.experimental import io_callback

from aircl_jax.algorithm import hoisting
from aircl_jax.algorithm.hoisting import hoisted_scan
from aircl_jax.algorithm.rollout import rollouts
from aircl_jax.methods import get_method
from aircl_jax.model.networks import make_networks
from aircl_jax.settings.env_defaults import default_config
from aircl_jax.types import ObsStats
from envs import make_env

DRAWS = ("random_bits", "random_split", "random_unwrap", "threefry2x32", "erf_inv")


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


def test_it_gives_what_a_scan_gives():
    expected, found = jax.lax.scan(walk, *given()), hoisted_scan(walk, *given())
    assert jax.tree.structure(expected) == jax.tree.structure(found)
    for one, other in zip(jax.tree.leaves(expected), jax.tree.leaves(found), strict=True):
        np.testing.assert_allclose(one, other, rtol=1e-6, atol=1e-6)
    assert len(set(np.asarray(found[1]["fresh"]).ravel())) == 120  # each step has draws of its own


def test_it_gives_the_same_within_a_batch_with_parameters_of_its_own():
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


def test_what_is_large_is_computed_within_the_loop(monkeypatch):
    monkeypatch.setattr(hoisting, "MOST", 2)
    assert "erf_inv" in loop_of(lambda *inputs: hoisted_scan(walk, *inputs), *given())
    np.testing.assert_allclose(
        hoisted_scan(walk, *given())[1]["place"], jax.lax.scan(walk, *given())[1]["place"], rtol=1e-6, atol=1e-6
    )


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
