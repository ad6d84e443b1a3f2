"""The causal maps: equal to stock tigramite, safe on constant and collinear columns, and their yardsticks."""

import numpy as np
import pytest
from tigramite.data_processing import DataFrame
from tigramite.independence_tests.parcorr import ParCorr

from aircl_jax.analysis.causal import (
    CachedParCorr,
    Links,
    difference,
    halves,
    link_strengths,
    markov_chain,
    mean_difference,
    sample_chain,
    strongest,
    uniform_windows,
    yardsticks,
)


def chain_of(num_codes: int, seed: int) -> np.ndarray:
    transition = np.random.default_rng(seed).dirichlet(np.full(num_codes, 0.5), size=num_codes)
    return sample_chain(np.full(num_codes, 1 / num_codes), transition, 60, 15, seed)


@pytest.mark.parametrize("tau_max", [1, 2])
@pytest.mark.parametrize("seed", [0, 1])
def test_values_equal_stock_tigramite_to_1e_9(tau_max, seed):
    windows = chain_of(5, seed)
    ours = link_strengths(windows, 6, tau_max)  # code 5 is never visited: a constant column
    stock = link_strengths(windows, 6, tau_max, test=ParCorr(significance="analytic"))
    np.testing.assert_allclose(ours.value, stock.value, atol=1e-9)
    np.testing.assert_allclose(ours.p, stock.p, atol=1e-9)


def test_single_tests_equal_stock_tigramite_given_conditions():
    values = np.random.default_rng(3).normal(size=(4, 30, 3)).cumsum(axis=1)
    tests = [CachedParCorr(), ParCorr(significance="analytic")]
    for test in tests:
        test.set_dataframe(DataFrame(dict(enumerate(values)), analysis_mode="multiple"))
    for given in ([], [(2, -1)], [(2, -1), (1, -1), (0, -2), (2, -1)]):
        ours, stock = (test.run_test([(0, -1)], [(1, 0)], given, tau_max=1) for test in tests)
        np.testing.assert_allclose(ours, stock, atol=1e-9)


def test_a_code_never_visited_has_value_zero_and_p_one():
    links = link_strengths(chain_of(4, 0), 5)
    assert np.all(links.value[4] == 0)
    assert np.all(links.value[:, 4] == 0)
    assert np.all(links.p[4, :, 1] == 1)
    assert np.all(links.p[:, 4, 1] == 1)


def test_a_variable_that_the_conditions_determine_has_value_zero():
    test = CachedParCorr()
    one_hot = np.eye(3)[chain_of(3, 0)]
    test.set_dataframe(DataFrame(dict(enumerate(one_hot)), analysis_mode="multiple"))
    assert test.run_test([(0, -1)], [(1, 0)], [(1, -1), (2, -1)], tau_max=1) == (0.0, 1.0)


def test_a_deterministic_cycle_has_its_links_where_it_goes():
    start, cycle = np.full(3, 1 / 3), 0.05 / 3 + 0.95 * np.roll(np.eye(3), 1, axis=1)
    strength = strongest(link_strengths(sample_chain(start, cycle, 100, 20, 0), 3))
    assert list(strength.argmax(axis=1)) == [1, 2, 0]


def test_strongest_takes_the_lag_with_the_largest_absolute_value():
    value = np.zeros((1, 1, 3))
    value[0, 0] = [9.0, 0.2, -0.3]
    assert strongest(Links(value, value))[0, 0] == -0.3
    assert mean_difference(Links(value, value), Links(0 * value, value)) == pytest.approx(0.3)
    assert difference(Links(value, value), Links(value, value)).max() == 0


def test_markov_chain_is_worked_by_hand():
    start, transition = markov_chain(np.array([[0, 1, 1], [0, 1, 0]]), 3)
    np.testing.assert_allclose(start, [1, 0, 0])
    np.testing.assert_allclose(transition, [[0, 1, 0], [0.5, 0.5, 0], [0, 0, 1]])


def test_halves_share_no_window_and_lose_none():
    windows = np.arange(14).reshape(7, 2)
    first, second = halves(windows, 0)
    assert sorted(np.concatenate([first, second])[:, 0].tolist()) == list(range(0, 14, 2))


def test_yardsticks_order_a_fitted_chain_below_uniform_codes():
    found = yardsticks(chain_of(5, 2).repeat(4, axis=0), 5, 1, 0)
    assert found["markov_chain"] < found["uniform"]
    assert found["noise_floor"] == pytest.approx(found["halves"] / np.sqrt(2))


@pytest.mark.parametrize(
    ("windows", "num_codes", "tau_max", "words"),
    [
        (np.array([[0, 3, 1]]), 3, 1, "choose num_codes above 3"),
        (np.array([[0, 2]]), 3, 1, "too short for tau_max 1"),
    ],
)
def test_bad_windows_are_refused_in_one_line(windows, num_codes, tau_max, words):
    with pytest.raises(ValueError, match=words):
        link_strengths(windows, num_codes, tau_max)


def test_uniform_windows_stay_inside_the_codes():
    windows = uniform_windows(50, 6, 4, 0)
    assert windows.shape == (50, 6)
    assert set(np.unique(windows)) == {0, 1, 2, 3}
