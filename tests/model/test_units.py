"""What is learned does not depend on the units of observations and actions."""

from functools import cache
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from aircl_jax.algorithm.trainer import make_trainer
from aircl_jax.demonstrations.files import from_arrays
from aircl_jax.methods import get_method
from aircl_jax.types import ObsStats
from envs import Box, Env, Step
from tests.worlds import TINY, UNOPTIMISED, tiny_networks, unit_stats

FAR = Box(2, 100.0, 200.0)
HORIZON = 4


def point(size: float, box: Box) -> Env:
    """A point that is pushed about the plane, seen in a unit of its own."""

    def step(key: Any, place: Any, action: Any) -> tuple[Any, Step]:
        place = place + 0.1 * box.in_half_widths(box.clip(action))
        return place, Step(size * place, -(place**2).sum(), (place[0] > 0.5).astype(jnp.float32), jnp.zeros(()))

    def reset(key: Any) -> tuple[Any, Any]:
        place = jax.random.normal(key, (2,))
        return place, size * place

    return Env("point", HORIZON, 2, box, reset, step)


@cache
def learned(method: str, size: float, box: Box) -> Any:
    """The networks' parameters after two fused steps on the same episodes in the units of the world."""
    env, random = point(size, box), np.random.default_rng(0)
    pushed = jnp.asarray(random.uniform(-1, 1, (5, HORIZON, 2)), jnp.float32)
    obs = size * random.normal(size=(5, HORIZON, 2))
    zeros = np.zeros((5, HORIZON))
    expert = from_arrays({"obs": obs, "action": np.asarray(box.from_half_widths(pushed)), "reward": zeros, "cost": zeros}, env)
    trainer = make_trainer(env, get_method(method, of_box=True), TINY)

    def run(key: Any) -> Any:
        state = trainer.init(key, expert)
        return trainer.step(trainer.step(state, expert)[0], expert)[0].params

    return jax.jit(run, compiler_options=UNOPTIMISED)(jax.random.key(0))


TINY_BOX = pytest.param(1e6, Box(2, -1e-3, 0.0), marks=pytest.mark.slow)


@pytest.mark.parametrize(
    "method", ["bc", "aircl_contrast", *(pytest.param(name, marks=pytest.mark.slow) for name in ("aircl_corrected", "aircl"))]
)
@pytest.mark.parametrize(("size", "box"), [(1e-6, FAR), TINY_BOX])
def test_what_is_learned_is_the_same_in_any_unit(method, size, box):
    leaves = (jax.tree.leaves(learned(method, *unit)) for unit in ((1.0, Box(2)), (size, box)))
    for one, other in zip(*leaves, strict=True):
        np.testing.assert_allclose(other, one, rtol=1e-3, atol=1e-4)


def test_a_policy_begins_in_the_middle_of_its_box():
    env = point(1.0, FAR)
    nets, params = tiny_networks(env, "airl")
    policy = nets.bind(params, unit_stats(env)).policy(jnp.ones(2), jnp.asarray(0))
    np.testing.assert_allclose(policy.mean(), 150.0, atol=2.0)
    np.testing.assert_allclose(policy.stddev(), 50.0 * np.exp(TINY.ppo.log_std_init), rtol=1e-6)
    drawn, log_prob = policy.sample_and_log_prob(seed=jax.random.key(0), sample_shape=(3,))
    assert drawn.shape == (3, 2)
    np.testing.assert_allclose(policy.log_prob(drawn), log_prob, rtol=1e-5)
    spread = np.exp(TINY.ppo.log_std_init)
    np.testing.assert_allclose(policy.log_prob(policy.mode()), -np.log(2 * np.pi * spread**2), rtol=1e-5)  # per half-width
    np.testing.assert_allclose(policy.entropy(), np.log(2 * np.pi * np.e * spread**2), rtol=1e-5)


def test_a_box_without_bounds_is_acted_in_as_it_is():
    box = Box(2, -np.inf, np.inf)
    assert box.is_unit
    assert FAR.features(jnp.asarray([100.0, 230.0])).tolist() == [-1.0, 1.0]


def test_a_coordinate_that_hardly_moves_is_seen_as_a_share_of_its_size():
    mean = jnp.asarray([0.0, 2e-6, 300.0, 300.0, 0.0, 5.0])
    std = jnp.asarray([1e-6, 0.0, 0.1, 1e-5, 0.0, 2.0])
    np.testing.assert_allclose(ObsStats.of(mean, std).std, [1e-6, 2e-9, 0.1, 1e-3, 1e-3, 2.0], rtol=1e-6)
