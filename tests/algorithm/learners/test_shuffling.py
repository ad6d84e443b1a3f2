"""An order is one of all, each as likely as another."""

import jax
import numpy as np
import pytest

from aircl_jax.algorithm.learners.shuffling import shuffled


@pytest.mark.parametrize("number", [1, 2, 7, 64, 1400, 8000])
def test_every_number_comes_once(number):
    order = np.asarray(shuffled(jax.random.key(0), number))
    assert order.dtype == np.int32
    assert sorted(order) == list(range(number))


def test_each_number_is_as_often_in_each_place():
    orders = np.asarray(jax.vmap(lambda key: shuffled(key, 5))(jax.random.split(jax.random.key(1), 20_000)))
    counts = np.stack([np.bincount(place, minlength=5) for place in orders.T])
    assert np.abs(counts / 20_000 - 0.2).max() < 0.015  # five standard deviations
    first_two = np.bincount(orders[:, 0] * 5 + orders[:, 1], minlength=25).reshape(5, 5)
    assert np.abs(first_two[~np.eye(5, dtype=bool)] / 20_000 - 0.05).max() < 0.008


def test_a_minibatch_is_of_numbers_from_everywhere():
    first = np.asarray(shuffled(jax.random.key(2), 8000))[:1000]
    assert abs(first.mean() - 3999.5) < 5 * 8000 / np.sqrt(12 * 1000)
    assert np.abs(np.histogram(first, bins=8, range=(0, 8000))[0] - 125).max() < 60


def test_another_key_gives_another_order():
    one, other = (np.asarray(shuffled(jax.random.key(seed), 1400)) for seed in (3, 4))
    assert (one == other).mean() < 0.01
