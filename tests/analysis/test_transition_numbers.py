"""What is said of transitions' distances and of causal maps, worked by hand on sets so small that chance has no say."""

import numpy as np
import pytest

from aircl_jax.analysis.causal import (
    link_strengths,
    markov_chain,
    mean_difference,
    sample_chain,
    strongest,
    uniform_windows,
    yardsticks,
)
from aircl_jax.analysis.transition_distances import Histogram, exponential_tail, histogram, rise_test

EDGES = np.arange(0.0, 6.0)


def with_counts(*counts: int) -> np.ndarray:
    """Distances in the middle of each bin."""
    return np.repeat(np.arange(len(counts)) + 0.5, counts)


def of_one_line(distance: np.ndarray, recording: np.ndarray) -> Histogram:
    start = np.stack([np.arange(len(distance)) * 0.1, *np.zeros((2, len(distance)))], axis=1)
    return histogram(start, start + distance[:, None] * np.array([1.0, 0, 0]), recording, EDGES, draws=40, seed=0)


def test_a_rise_is_described_by_the_middles_and_the_counts_of_its_two_bins_in_order():
    found = rise_test(with_counts(9, 1, 4, 2, 0), np.full(16, "a"), EDGES, draws=9, seed=0)
    assert (found.bin_width, found.low, found.high, found.counts) == (1.0, 1.5, 2.5, (1, 4))
    assert found.z == pytest.approx(3 / 5**0.5)


def test_a_rise_that_no_draw_reaches_is_as_unlikely_as_the_number_of_draws_can_say():
    found = rise_test(with_counts(900, 0, 400, 0, 0), np.full(1300, "a"), EDGES, draws=19, seed=0)
    assert found.p_monotone == 1 / 20


def test_a_rise_of_every_recording_is_one_of_all_bootstraps():
    distance = with_counts(9, 1, 4, 2, 0)
    found = rise_test(np.tile(distance, 3), np.repeat(["a", "b", "c"], 16), EDGES, draws=20, seed=0)
    assert found.bootstrap_share == 1.0


def test_of_one_recording_the_bootstrap_is_the_histogram_and_the_shuffles_are_not():
    found = of_one_line(with_counts(30, 1, 4, 2, 0), np.full(37, "a"))
    np.testing.assert_array_equal(found.counts, [30, 1, 4, 2, 0])
    np.testing.assert_array_equal(found.band, [found.counts, found.counts])
    assert found.shuffled[0] < 27
    assert found.shuffled_band[0, 0] < found.shuffled_band[1, 0] < 30


def test_of_recordings_with_one_transition_each_the_shuffles_are_the_histogram_and_the_bootstrap_is_not():
    found = of_one_line(with_counts(30, 1, 4, 2, 0), np.arange(37).astype(str))
    np.testing.assert_array_equal(found.shuffled, found.counts)
    np.testing.assert_array_equal(found.shuffled_band, [found.counts, found.counts])
    assert found.band[0, 0] < 30 < found.band[1, 0]


def test_the_trend_of_equal_counts_is_these_and_the_monotone_one_pools_a_rise():
    np.testing.assert_allclose(of_one_line(with_counts(5, 5, 5, 5, 5), np.full(25, "a")).trend, 5.0)
    np.testing.assert_allclose(of_one_line(with_counts(9, 2, 4, 1, 0), np.full(16, "a")).monotone, [9, 3, 3, 1, 0])


def test_the_tail_is_expected_from_the_rate_between_the_bounds_and_observed_from_the_upper_one_on():
    # 100 distances between 2 and 3 whose mean excess is that of rate 1: 1 − 1/(e − 1). Beyond 3: 100 / (e − 1).
    distance = np.concatenate([np.full(50, 1.0), np.full(100, 3 - 1 / (np.e - 1)), [3.0], np.full(6, 9.0)])
    found = exponential_tail(distance, np.full(157, "a"), 2.0, 3.0, draws=5, seed=0)
    assert found.observed == 7
    assert found.expected == pytest.approx(100 / (np.e - 1))
    assert found.ratio_band == pytest.approx([7 * (np.e - 1) / 100] * 2)


def test_smoothing_adds_to_every_count_of_a_chain_and_rows_are_what_follows_a_code():
    _, transition = markov_chain(np.array([[0, 1, 1, 1]]), 3, smoothing=1.0)
    np.testing.assert_allclose(transition, [[1 / 4, 2 / 4, 1 / 4], [1 / 5, 3 / 5, 1 / 5], [1 / 3] * 3])


def test_every_yardstick_is_the_mean_difference_of_its_own_windows_from_the_real_ones():
    windows = sample_chain(np.full(3, 1 / 3), np.random.default_rng(0).dirichlet(np.ones(3), size=3), 20, 12, 0)
    found, real = yardsticks(windows, 3, 1, seed=4), link_strengths(windows, 3)
    chain = sample_chain(*markov_chain(windows, 3), 20, 12, 4)
    assert found["real_strength"] == pytest.approx(np.abs(strongest(real)).mean())
    assert found["markov_chain"] == pytest.approx(mean_difference(link_strengths(chain, 3), real))
    assert found["uniform"] == pytest.approx(mean_difference(link_strengths(uniform_windows(20, 12, 3, 4), 3), real))
    of_pairs = np.abs(strongest(link_strengths(chain, 3)) - strongest(real))
    assert found["markov_chain"] == pytest.approx(of_pairs.sum() / 9)
