import jax
import jax.numpy as jnp
import numpy as np
import pytest

from aircl_jax.algorithm.adversary import minibatch
from aircl_jax.algorithm.sampler import SAMPLERS, effective_sample_size, reject, resample, take
from aircl_jax.algorithm.terms.logits import Batches
from tests.worlds import random_trajectories, tiny_grid

DELTA = np.array([0.9, 0.6, 0.3, 0.0001, 0.6])


@pytest.mark.parametrize("name", SAMPLERS)
def test_draws_are_in_proportion_to_the_feasibility(name):
    draw = jax.vmap(lambda key: SAMPLERS[name](jnp.log(DELTA), 5, key))
    index = np.asarray(jax.jit(draw)(jax.random.split(jax.random.key(0), 4000)))
    frequency = np.bincount(index.ravel(), minlength=5) / index.size
    if name == "resample":
        np.testing.assert_allclose(frequency, DELTA / DELTA.sum(), atol=0.006)  # 1.4 σ of 20,000 independent draws
    else:
        np.testing.assert_allclose(frequency, accepted_share(DELTA), atol=0.012)


def accepted_share(delta):
    """Expected share of each among the accepted, uniform where none is: the mean over all 2^n coins."""
    share = np.zeros(len(delta))
    for coins in np.ndindex(*[2] * len(delta)):
        accepted = np.array(coins, float)
        probability = np.prod(np.where(accepted > 0, delta, 1 - delta))
        share += probability * (accepted / accepted.sum() if accepted.any() else 1 / len(delta))
    return share


def test_resampling_gives_every_index_its_expected_count_rounded():
    index = resample(jnp.log(jnp.asarray([0.2, 0.4, 0.4])), 10, jax.random.key(0))
    np.testing.assert_array_equal(np.bincount(index, minlength=3), [2, 4, 4])


@pytest.mark.parametrize(("delta", "expected"), [([0.3] * 4, 1.0), ([1.0, 0.0, 0.0, 0.0], 0.25), ([0.5, 0.5, 0.0, 0.0], 0.5)])
def test_effective_sample_size_is_kishs_as_a_share_of_the_pool(delta, expected):
    np.testing.assert_allclose(effective_sample_size(jnp.log(jnp.asarray(delta) + 1e-30)), expected, rtol=1e-6)


def test_effective_sample_size_is_defined_where_every_feasibility_underflows():
    np.testing.assert_allclose(effective_sample_size(jnp.full(4, -5000.0)), 1.0, rtol=1e-3)


def test_degenerate_weights_fall_back_to_uniform():
    log_delta = jnp.full(20, -300.0).at[7].set(0.0)
    np.testing.assert_array_equal(np.sort(resample(log_delta, 20, jax.random.key(0))), np.arange(20))


def test_rejection_draws_uniformly_where_nothing_is_accepted():
    index = reject(jnp.full(20, -300.0), 20, jax.random.key(0))
    np.testing.assert_array_equal(np.sort(index), np.arange(20))


def test_rejection_draws_by_another_key_than_it_accepts_by():
    key = jax.random.key(3)
    by_first, by_second = (int(1000 * jax.random.uniform(one)) for one in jax.random.split(key))
    (index,) = reject(jnp.zeros(1000), 1, key)  # all are accepted, and the one offset says which is drawn
    assert index == by_second != by_first


def test_rejection_never_draws_what_is_infeasible():
    log_delta = jnp.asarray([0.0, -300.0, 0.0, -300.0])
    assert set(np.asarray(reject(log_delta, 50, jax.random.key(1)))) == {0, 2}


def test_a_minibatch_is_of_distinct_trajectories_and_a_small_set_is_taken_whole():
    sets = Batches(*(random_trajectories(tiny_grid(), seed, number) for seed, number in enumerate([6, 2, 6, 6])))
    drawn = minibatch(sets, 3, jax.random.key(0))
    assert [len(one.mask) for one in drawn.sets] == [3, 2, 3, 3]
    rows = [tuple(row) for row in np.asarray(drawn.expert.reward)]
    assert len(set(rows)) == 3
    assert set(rows) <= {tuple(row) for row in np.asarray(sets.expert.reward)}
    np.testing.assert_array_equal(drawn.sampled.reward, sets.sampled.reward)


def test_every_leaf_of_a_drawn_trajectory_is_of_the_same_trajectory():
    pool = random_trajectories(tiny_grid(), 0, 6)
    taken = take(pool, jnp.asarray([4, 4, 1]))
    jax.tree.map(lambda new, old: np.testing.assert_array_equal(new, old[np.array([4, 4, 1])]), taken, pool)
