"""The test of avoided changes: its Bayes factor is the integral, made ordinary is what the formula says, truth is found."""

import numpy as np
import pytest
from scipy import integrate, stats

from aircl_jax.animals.changes import avoided_changes, expected_times, judge_on_halves, log_bayes, ordinary_share
from aircl_jax.animals.going import ORDINARY, Weights, choices_of
from tests.animals.herds import FORBIDDEN, goat_recordings


@pytest.mark.parametrize(("made", "expected"), [(0, 10.0), (3, 4.0), (12, 10.0), (1, 20.6)])
def test_the_bayes_factor_is_forbidden_with_lapses_over_ordinary_with_scatter(made, expected):
    def ordinary(x: float) -> float:
        return float(stats.poisson.pmf(made, expected * np.exp(x)) * stats.norm.pdf(x))

    allowed, _ = integrate.quad(ordinary, -8, 8, epsabs=1e-13)
    forbidden = stats.poisson.pmf(made, 0.01 * expected)
    found = log_bayes(np.array([float(made)]), np.array([expected]))
    assert found[0] == pytest.approx(np.log(forbidden / allowed), abs=0.01)


def test_a_ban_that_is_kept_better_than_by_one_in_a_hundred_is_still_a_ban_however_large_the_table():
    expected = np.array([2e3, 2e4, 2e6])
    assert (log_bayes(np.zeros(3), expected) > 5).all()
    assert (log_bayes(0.005 * expected, expected) > 5).all()
    assert (log_bayes(0.5 * expected, expected) < -5).all()


def test_a_flagged_pair_is_expected_as_if_it_alone_were_ordinary():
    """Three activities of rewards 0, log 2, log 3: out of the first, 2 : 3 compete; flagged, the second would get 2 of 5."""
    choices = choices_of(goat_recordings(recordings=2, animals=1, rows=60), ("return",))
    size = len(choices.chosen)
    weights = Weights(np.log([[1.0, 2.0, 3.0]]), np.zeros(2), np.zeros(3), np.zeros(3))
    flagged = np.zeros((3, 3), dtype=bool)
    share = ordinary_share(choices, weights, flagged)[choices.left == 0]
    np.testing.assert_allclose(share, np.tile([0, 0.4, 0.6], (len(share), 1)))
    flagged[0, 1] = True
    share = ordinary_share(choices, weights, flagged)
    np.testing.assert_allclose(share[choices.left == 0], np.tile([0, 0.4, 1.0], (int((choices.left == 0).sum()), 1)))
    times = expected_times(choices, share, np.ones(size))
    assert times[0, 1] == pytest.approx(0.4 * (choices.left == 0).sum())


@pytest.fixture(scope="module")
def herd():
    return goat_recordings()


def test_the_forbidden_change_of_a_made_up_herd_is_flagged_and_no_other(herd):
    names = herd.names
    choices = choices_of(herd, ORDINARY)
    found = avoided_changes(choices, herd, choices.times)
    assert [(names[a], names[b]) for a, b in np.argwhere(found.flagged)] == [FORBIDDEN]
    pair = names.index(FORBIDDEN[0]), names.index(FORBIDDEN[1])
    assert found.made[pair] == 0
    assert found.expected[pair] > 50
    assert found.p[pair] < found.bonferroni
    assert found.recordings[pair] == 6
    assert found.animals[pair] == 24
    assert found.made.sum() == len(choices.change)


def test_a_change_flagged_on_one_half_is_never_made_on_the_other(herd):
    judged = judge_on_halves(choices_of(herd, ORDINARY), herd, halves=2)
    assert judged["flagged"].pairs == 1
    assert judged["flagged"].rate == 0
    assert judged["flagged"].expected > 20
