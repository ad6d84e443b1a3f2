"""Distances of transitions worked by hand, the null models, and a test that finds a bump only where there is one."""

import numpy as np
import pytest

from aircl_jax.analysis.transition_distances import (
    distances,
    exponential_tail,
    frequent_long_pairs,
    histogram,
    largest_rise,
    monotone_trend,
    pair_table,
    rise_test,
    shuffled_counts,
)

EDGES = np.arange(0.0, 11.0)


def falling(seed: int, number: int = 3000) -> tuple[np.ndarray, np.ndarray]:
    generator = np.random.default_rng(seed)
    return np.minimum(generator.exponential(1.5, size=number), 9.9), generator.integers(10, size=number).astype(str)


def test_a_distance_is_euclidean_and_unknown_where_a_position_is():
    start, end = np.array([[0.0, 0, 0], [np.nan] * 3]), np.array([[3.0, 0, 4], [0, 6, 8]])
    np.testing.assert_allclose(distances(start, end), [5, np.nan])
    np.testing.assert_allclose(distances(start, end, fill=np.zeros(3)), [5, 10])


def test_the_monotone_trend_pools_what_rises():
    np.testing.assert_allclose(monotone_trend(np.array([9, 2, 4, 1])), [9, 3, 3, 1])


def test_the_largest_rise_is_worked_by_hand():
    assert largest_rise(np.array([9, 0, 4, 2])) == (1, 2, 2.0)
    assert largest_rise(np.array([3, 2, 1]))[2] <= 0


def test_a_falling_trend_is_not_refuted_and_a_bump_is_found():
    distance, recording = falling(0)
    assert rise_test(distance, recording, EDGES, draws=200, seed=0).p_monotone > 0.05
    bump = np.append(distance, np.full(60, 8.5))
    found = rise_test(bump, np.append(recording, recording[:60]), EDGES, draws=200, seed=0)
    assert found.p_monotone < 0.05
    assert found.high == 8.5
    assert found.bootstrap_share > 0.95


def test_the_way_up_to_the_mode_is_no_rise():
    generator = np.random.default_rng(2)
    distance, recording = 2 + generator.exponential(1.0, size=3000), np.full(3000, "a")
    assert rise_test(distance, recording, EDGES, draws=100, seed=0).low > 2


def test_shuffling_ends_keeps_the_number_and_loses_the_pairing():
    position = np.random.default_rng(0).normal(size=(500, 3)) * 3
    counts = shuffled_counts(position, position + 0.1, np.full(500, "a"), EDGES, draws=5, seed=0)
    assert counts[:, 0].max() < 100
    alone = shuffled_counts(position, position + 0.1, np.arange(500).astype(str), EDGES, draws=2, seed=0)
    assert alone[:, 0].tolist() == [500, 500]


def test_the_histogram_lies_inside_its_own_bootstrap_band():
    distance, recording = falling(1)
    start = np.zeros((len(distance), 3))
    found = histogram(start, start + distance[:, None] / np.sqrt(3), recording, EDGES, draws=200, seed=0)
    assert found.counts.sum() == len(distance)
    assert (found.band[0] <= found.counts).all()
    assert (found.counts <= found.band[1]).all()


def test_an_exponential_tail_is_as_long_as_expected_and_a_heavy_one_longer():
    generator = np.random.default_rng(0)
    recording = generator.integers(10, size=20_000).astype(str)
    plain = exponential_tail(generator.exponential(2.0, size=20_000), recording, 1.0, 6.0, draws=50, seed=0)
    assert plain.observed == pytest.approx(plain.expected, rel=0.1)
    assert plain.ratio_band[0] < 1 < plain.ratio_band[1]
    heavy = exponential_tail(generator.pareto(2.0, size=20_000), recording, 1.0, 6.0, draws=50, seed=0)
    assert heavy.ratio_band[0] > 1


def test_pairs_are_counted_by_hand():
    source, target = np.array([0, 0, 0, 1]), np.array([1, 1, 2, 0])
    pairs = pair_table(source, target, np.array([1.0, 3.0, np.nan, 5.0]), 3)
    np.testing.assert_allclose(pairs.frequency[0], [0, 2 / 3, 1 / 3])
    np.testing.assert_allclose(pairs.mean_distance[[0, 1], [1, 0]], [2, 5])
    assert np.isnan(pairs.mean_distance[0, 2])
    assert frequent_long_pairs(pairs, threshold=1.5, least=1, number=3) == [(1, 0), (0, 1)]
    assert frequent_long_pairs(pairs, threshold=1.5, least=2, number=3) == [(0, 1)]
