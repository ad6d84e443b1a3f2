"""The limits of states: which coordinate is drawn first, what is counted after it, and what π is held to meanwhile."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from aircl_jax.algorithm.boxes import state_limits
from aircl_jax.algorithm.pooling import ALONE
from aircl_jax.model.features import UNLIMITED
from aircl_jax.settings.train_config import Coefficients
from aircl_jax.types import ObsStats
from envs import make_env
from tests.finished_runs import random_episodes

COEFFICIENTS = Coefficients(threshold=0.05, pseudo_count=0.5, least_expected=20.0)
LOW, HIGH = -1.0, 1.0  # what the demonstrations reach, about; the practice world goes on to ±3


def episodes(obs, mask=None):
    """Episodes of these observations, [N, T, O]."""
    obs = jnp.asarray(obs, jnp.float32)
    number, horizon = obs.shape[:2]
    some = random_episodes(make_env("swimmer", horizon=horizon), 0, number)
    zeros = jnp.zeros((number, horizon))
    return some._replace(
        obs=obs, mask=zeros + 1.0 if mask is None else jnp.asarray(mask, jnp.float32), cost=zeros, reward=zeros
    )


def uniform(low, high, shape=(20, 50), seed=0):
    return np.random.default_rng(seed).uniform(low, high, shape)


DEMONSTRATED = episodes(np.stack([uniform(LOW, HIGH, seed=1), uniform(LOW, HIGH, seed=2)], axis=-1))
SCALE = state_limits.scale_of((jnp.full(2, LOW), jnp.full(2, HIGH)), 1.0)


def after(twin, iterations=state_limits.PATIENCE, met=None):
    met = state_limits.begin(DEMONSTRATED, SCALE, ALONE) if met is None else met
    step = jax.jit(lambda met, twin: state_limits.next_limits(met, twin, SCALE, COEFFICIENTS, ALONE, DEMONSTRATED.mask.sum()))
    for _ in range(iterations):
        met = step(met, twin)
    return met


def limits(met):
    lower, upper = state_limits.of_observations(met, SCALE)
    return np.asarray(lower), np.asarray(upper)


def test_what_was_met_keeps_its_types_so_that_a_step_compiles_once():
    begun = state_limits.begin(DEMONSTRATED, SCALE, ALONE)
    assert [jax.typeof(leaf) for leaf in jax.tree.leaves(begun)] == [
        jax.typeof(leaf) for leaf in jax.tree.leaves(after(DEMONSTRATED, iterations=1))
    ]


def test_the_scale_ends_where_the_practice_world_does():
    np.testing.assert_allclose(SCALE.of(jnp.array([[-3.0, 3.0], [0.0, 1.5]])), [[-1.0, 1.0], [0.0, 0.5]])
    np.testing.assert_allclose(SCALE.of(jnp.array([[-9.0, 9.0]])), [[-1.0, 1.0]])


def test_the_limit_is_the_outermost_demonstrated_value_of_what_the_twin_goes_beyond():
    twin = episodes(np.stack([uniform(0.0, 2.5), uniform(LOW, HIGH, seed=3)], axis=-1))
    lower, upper = limits(after(twin))
    greatest = np.asarray(DEMONSTRATED.obs)[..., 0].max()
    np.testing.assert_allclose(upper, [greatest, np.inf], rtol=1e-5)
    np.testing.assert_array_equal(lower, [-np.inf, -np.inf])


def test_none_is_drawn_before_its_time_and_what_was_settled_is_said():
    twin = episodes(np.stack([uniform(0.0, 2.5), uniform(LOW, HIGH, seed=3)], axis=-1))
    early = after(twin, state_limits.PATIENCE - 1)
    assert np.isinf(limits(early)).all()
    drawn = after(twin, 1, early)
    assert np.isfinite(limits(drawn)[1][0])
    assert (float(early.settled), float(drawn.settled), float(drawn.iterations)) == (0.0, 0.0, 0.0)
    assert float(after(twin, state_limits.PATIENCE, drawn).settled) == 1.0


def test_m_beyond_a_limit_is_the_share_of_the_twins_steps_times_the_demonstrations():
    twin = episodes(np.stack([uniform(0.0, 2.5), uniform(LOW, HIGH, seed=3)], axis=-1))
    met = after(twin)
    beyond = (np.asarray(twin.obs)[..., 0] > np.asarray(DEMONSTRATED.obs)[..., 0].max()).mean() * 1000
    assert float(met.tempted[1, 0]) == pytest.approx(beyond, rel=0.05)  # to a bin
    assert np.asarray(met.tempted).sum() == pytest.approx(float(met.tempted[1, 0]))


def fast(number=20, horizon=50):
    """A twin whose first coordinate goes up to 2.5; the second follows it beyond the demonstrations, half of the time."""
    first = np.linspace(0.0, 2.5, horizon) * np.ones((number, 1))
    second = np.where(first > 1.4, np.where(np.arange(number)[:, None] % 2, 2.0, 0.0), 0.0)
    return np.stack([first, second], axis=-1)


def test_what_is_unusual_only_beyond_another_limit_is_not_forbidden():
    met = after(episodes(fast()), 3 * state_limits.PATIENCE)
    lower, upper = limits(met)
    assert np.isfinite(upper[0])
    assert np.isinf(upper[1])  # though the twin was there in a tenth of its steps
    assert np.isinf(lower).all()


def test_the_other_side_of_a_coordinate_is_judged_beyond_its_first_limit():
    swinging = 2.0 * np.sin(np.arange(50) / 3.0) * np.ones((20, 1))
    lower, upper = limits(after(episodes(np.stack([swinging, np.zeros((20, 50))], axis=-1)), 3 * state_limits.PATIENCE))
    assert np.isfinite([lower[0], upper[0]]).all()
    assert np.isinf([lower[1], upper[1]]).all()


def test_a_world_that_begins_anew_is_within_its_limits_again():
    mask = np.ones((1, 6))
    mask[0, 3] = 0.0  # a restart
    at = jnp.zeros((1, 6, 2)).at[0, 1, 0].set(0.9)
    met = state_limits.begin(DEMONSTRATED, SCALE, ALONE)._replace(upper=jnp.array([0.5, UNLIMITED]))
    found = np.asarray(state_limits.beyond_others(at, jnp.asarray(mask, jnp.float32), met))[0]
    np.testing.assert_array_equal(found[:, 1], [False, False, True, False, False, False])
    np.testing.assert_array_equal(found[:, 0], [False] * 6)


def test_masked_steps_are_not_counted():
    obs = np.stack([np.full((20, 50), 2.0), np.zeros((20, 50))], axis=-1)
    mask = np.ones((20, 50))
    obs[:, 25:, 0] = 0.0
    mask[:, :25] = 0.0
    assert np.isinf(limits(after(episodes(obs, mask)))).all()


def test_until_the_limits_are_settled_what_was_never_met_lies_beyond_one():
    stats = ObsStats(jnp.array([0.5, 0.0]), jnp.array([2.0, 0.5]))
    begun = state_limits.begin(DEMONSTRATED, SCALE, ALONE)
    seen = np.asarray(DEMONSTRATED.obs).reshape(-1, 2)
    width = seen.max(axis=0) - seen.min(axis=0)
    lower, upper = state_limits.drawn(begun, SCALE, stats)
    np.testing.assert_allclose(upper, (seen.max(axis=0) + 0.05 * width - [0.5, 0.0]) / [2.0, 0.5], rtol=1e-4)
    np.testing.assert_allclose(lower, (seen.min(axis=0) - 0.05 * width - [0.5, 0.0]) / [2.0, 0.5], rtol=1e-4)
    settled = begun._replace(settled=jnp.ones(()), upper=jnp.array([0.25, UNLIMITED]))
    lower, upper = state_limits.drawn(settled, SCALE, stats)
    np.testing.assert_allclose(upper, [(0.75 - 0.5) / 2.0, UNLIMITED])
    np.testing.assert_allclose(lower, [-UNLIMITED, -UNLIMITED])
