"""Which differences a few seeds can show: every rule against numbers worked by hand."""

import itertools

import numpy as np
import pytest

from experiments.shared.paired_tests import (
    FEWEST_SEEDS,
    SIGNIFICANCE,
    against_best,
    best_or_tied,
    differences,
    each,
    effect,
    gain,
    holm,
    interval,
    least_p,
    least_unpaired_p,
    mean,
    paired_p,
    spread,
    unpaired_interval,
    unpaired_p,
)
from tests.finished_runs import around


def seeds(*values: float | None) -> dict[int, float | None]:
    return dict(enumerate(values))


def test_an_effect_is_the_paired_difference_with_its_t_interval():
    found = effect([3.0, 5.0, 7.0, 9.0], [2.0, 3.0, 4.0, 5.0])
    assert found.mean == 2.5
    # std of 1, 2, 3, 4 is 1.29; t(3) at 97.5 % is 3.182.
    assert found.high - found.mean == pytest.approx(3.18245 * 1.29099 / 2, rel=1e-4)
    assert found.mean - found.low == pytest.approx(3.18245 * 1.29099 / 2, rel=1e-4)
    assert found.size == pytest.approx(2.5 / 1.29099, rel=1e-4)
    assert found.p == pytest.approx(0.125)  # 2 of 2⁴ signs are as one-sided


def test_an_effect_of_one_seed_has_no_interval():
    assert np.isnan(effect([1.0], [2.0]).low)


def test_an_effect_pairs_the_seeds_in_their_order():
    # Unpaired, 1 to 3 and 3 to 1 are the same numbers; the differences are −2, 0 and 2.
    assert effect([1.0, 2.0, 3.0], [3.0, 2.0, 1.0]).size == 0.0
    assert effect([1.0, 2.0, 3.0], [3.0, 2.0, 1.0]).high == pytest.approx(4.30265 * 2 / 3**0.5, rel=1e-4)


def test_a_spread_is_mean_and_sample_deviation_and_undefined_as_soon_as_one_value_is():
    assert spread([0.1, 0.3], 3) == "0.200 ± 0.141"  # 0.2 / √2
    assert spread([0.1], 3) == "0.100"
    assert spread([0.1, None], 3) == spread([], 3) == "—"


def test_every_seed_is_written_in_its_place():
    assert each([0.25, None, 1.0]) == "0.250 — 1.000"


def test_paired_p_is_the_share_of_sign_patterns_with_a_rank_sum_as_extreme():
    difference = np.array([0.31, -0.12, 0.55, 0.23, 0.04, 0.47, -0.08, 0.66])
    ranks = np.argsort(np.argsort(np.abs(difference))) + 1
    middle = ranks.sum() / 2
    seen = abs(ranks[difference > 0].sum() - middle)
    patterns = [np.array(signs) for signs in itertools.product((False, True), repeat=len(difference))]
    naive = np.mean([abs(ranks[signs].sum() - middle) >= seen for signs in patterns])
    assert paired_p(difference) == pytest.approx(naive)
    assert paired_p(np.arange(1.0, 9.0)) == pytest.approx(least_p(8)) == pytest.approx(2 / 2**8)


def test_nothing_differs_where_all_pairs_are_equal():
    assert paired_p(np.zeros(10)) == 1.0


def test_differences_are_of_the_seeds_that_both_have():
    assert differences({0: 3.0, 1: None, 2: 5.0, 7: 1.0}, {2: 1.0, 1: 2.0, 0: 1.0}).tolist() == [2.0, 4.0]


def test_holm_is_the_correction_worked_by_hand():
    # sorted: 0.01 × 4, 0.02 × 3, 0.03 × 2, 0.4 × 1, each at least the one before it
    assert holm([0.03, 0.4, 0.01, 0.02]) == pytest.approx([0.06, 0.4, 0.04, 0.06])
    assert holm([0.6, 0.7]) == [1.0, 1.0]
    assert holm([]) == []


def test_interval_is_the_percentile_bootstrap_of_the_mean():
    sample = np.random.default_rng(1).normal(size=10)
    draws = np.random.default_rng(2).choice(sample, size=(20_000, 10)).mean(axis=1)
    assert interval(sample.tolist()) == pytest.approx(np.quantile(draws, [0.025, 0.975]), abs=0.03)
    assert interval([0.2, 0.2, 0.2]) == (0.2, 0.2)
    assert interval([0.2]) is None and interval([0.2, None]) is None


def test_bold_is_the_best_and_what_is_not_shown_to_be_worse():
    noise = np.array([1, -2, 3, -4, 5, -6, 7, -8, 9, -10]) / 1000
    column = {
        "best": seeds(*np.full(10, 0.1).tolist()),
        "tied": seeds(*(0.1005 + noise).tolist()),
        "worse": seeds(*around(0.2).tolist()),
        "undefined": seeds(*[None] * 10),
    }
    assert best_or_tied(column, lower=True) == {"best", "tied"}
    assert best_or_tied(column, lower=False) == {"worse"}
    assert against_best(column, lower=True)["worse"] == pytest.approx(2 * least_p(10))


def test_too_few_seeds_give_no_bold():
    assert best_or_tied({"a": seeds(0.1, 0.2), "b": seeds(0.5, 0.6)}, lower=True) == set()


def test_a_mean_is_undefined_as_soon_as_one_seed_is():
    assert mean(seeds(0.1, 0.3)) == pytest.approx(0.2)
    assert mean(seeds(0.1, None)) is None and mean({}) is None


def test_an_interval_has_the_2_5_and_97_5_percentiles_of_the_resampled_means():
    # Ones among eight draws of four ones and four zeros: P(≤ 0) = 0.4 %, P(≤ 1) = 3.5 %; the interval of 90 % would begin at 2.
    assert interval([0.0, 1.0] * 4) == (1 / 8, 7 / 8)
    # Among five draws of one 1 and four zeros: P(≤ 2) = 94.2 %, P(≤ 3) = 99.3 %.
    assert interval([0.0, 0.0, 1.0, 0.0, 0.0]) == (0.0, 3 / 5)


def test_bold_is_corrected_for_the_number_of_rows_that_are_compared():
    signs = np.array([1, 1, -1, -1, 1, 1, 1, 1, 1, 1])  # a rank sum of 3 + 4: p = 3.7 %, twice that among three rows
    column = {
        "best": seeds(*[0.1] * 10),
        "close": seeds(*(0.1 + 0.01 * signs * np.arange(1, 11)).tolist()),
        "tied": seeds(*(0.1005 + np.array([1, -2, 3, -4, 5, -6, 7, -8, 9, -10]) / 1000).tolist()),
    }
    assert paired_p(differences(column["close"], column["best"])) == pytest.approx(38 / 1024)
    assert best_or_tied({name: column[name] for name in ("best", "close")}, lower=True) == {"best"}
    assert against_best(column, lower=True)["close"] == pytest.approx(2 * 38 / 1024)
    assert best_or_tied(column, lower=True) == {"best", "close", "tied"}


def test_six_seeds_can_tell_two_rows_apart_but_not_three():
    rows = {name: seeds(*(around(centre)[:6]).tolist()) for name, centre in (("a", 0.1), ("b", 0.5), ("c", 0.9))}
    assert best_or_tied({name: rows[name] for name in ("a", "b")}, lower=True) == {"a"}  # 2 of 2⁶ signs
    assert best_or_tied(rows, lower=True) == set()  # twice as much is more than 5 %


def test_the_fewest_seeds_are_those_with_which_a_test_can_show_anything():
    assert least_p(FEWEST_SEEDS) < SIGNIFICANCE <= least_p(FEWEST_SEEDS - 1)


def shifted(values: np.ndarray, first: int) -> dict[int, float | None]:
    return {first + place: value for place, value in enumerate(values.tolist())}


# Seeds differ by far more than the rows do, and every seed is better by 0.01 to 0.08.
ONE = np.array([3.0, 1.0, 4.0, 1.5, 9.0, 2.6, 5.0, 3.5])
OTHER = ONE - np.arange(1, 9) / 100


def test_rows_with_the_same_seeds_are_compared_by_pairs_and_others_by_exchanging_seeds():
    paired, unpaired = gain(seeds(*ONE.tolist()), seeds(*OTHER.tolist())), gain(shifted(ONE, 0), shifted(OTHER, 110))
    assert paired and unpaired and (paired.paired, unpaired.paired) == (True, False)
    assert paired.mean == pytest.approx(0.045) and unpaired.mean == pytest.approx(0.045)
    assert paired.p == pytest.approx(2 / 2**8)  # all signs alike
    pool = np.concatenate([ONE, OTHER])
    total, seen = pool.sum(), ONE.sum() - OTHER.sum()
    exchanges = [2 * pool[list(chosen)].sum() - total for chosen in itertools.combinations(range(16), 8)]
    assert unpaired.p == pytest.approx(np.mean(np.abs(exchanges) >= seen - 1e-9), abs=0.02)  # 9,999 drawn of 12,870
    assert paired.bounds and 0.0 < paired.bounds[0] < paired.bounds[1] < 0.08
    assert unpaired.bounds and unpaired.bounds[0] < -1 and unpaired.bounds[1] > 1


def test_some_seeds_in_common_are_compared_by_these_alone_and_undefined_seeds_never():
    both = gain({0: 1.0, 1: 5.0, 2: 9.0}, {1: 2.0, 2: 7.0, 3: 100.0})
    assert both and (both.mean, both.seeds, both.paired) == (2.5, 2, True)
    apart = gain({0: 1.0, 1: None, 2: 3.0}, {7: 5.0, 8: 7.0, 9: None, 10: 9.0})
    assert apart and (apart.mean, apart.seeds, apart.paired) == (-5.0, 2, False)
    assert gain({0: 1.0}, {1: None}) is None and gain({0: 1.0, 1: None}, {0: None, 1: 2.0}) is None


def test_an_unpaired_interval_resamples_each_row_by_itself():
    # The difference of two counts of eight coins is that of 16 coins, less 8: P(≤ 3) = 1.1 %, P(≤ 4) = 3.8 %.
    coins = [0.0, 1.0] * 4
    assert unpaired_interval(coins, coins) == (-4 / 8, 4 / 8)
    assert unpaired_interval([v + 3 for v in coins], coins) == (3 - 4 / 8, 3 + 4 / 8)
    assert unpaired_interval([0.5, 0.5], [0.25, 0.25]) == (0.25, 0.25)
    assert unpaired_interval([0.5], [0.25, 0.25]) is None


def test_a_row_with_other_seeds_is_tested_without_pairs_against_the_best_and_the_rest_with_them():
    column = {
        "best": seeds(*around(0.10, 0.05).tolist()),
        "paired": seeds(*(around(0.10, 0.05) + np.arange(1, 11) / 1000).tolist()),
        "fresh": shifted(around(0.10, 0.05) + np.arange(1, 11) / 1000, 110),
        "far": shifted(around(0.30), 110),
    }
    values = {name: [value for value in row.values() if value is not None] for name, row in column.items()}
    raw = [
        paired_p(np.array(values["paired"]) - values["best"]),
        unpaired_p(values["fresh"], values["best"]),
        unpaired_p(values["far"], values["best"]),
    ]
    found = against_best(column, lower=True)
    assert [found[name] for name in ("paired", "fresh", "far")] == pytest.approx(holm(raw))
    assert best_or_tied(column, lower=True) == {"best", "fresh"}


def test_the_least_p_without_pairs_is_two_of_all_exchanges_or_of_those_drawn():
    assert least_unpaired_p(3, 10) == pytest.approx(2 / 286)  # C(13, 3)
    assert least_unpaired_p(3, 10) == pytest.approx(unpaired_p([1.0, 2.0, 3.0], list(np.arange(10.0, 20.0))))
    assert least_unpaired_p(10, 10) == pytest.approx(2 / 10_000)
    assert least_unpaired_p(10, 10) == pytest.approx(unpaired_p(around(0.1).tolist(), around(0.9).tolist()))
    assert least_unpaired_p(1, 1) == 1.0


def test_three_fresh_seeds_against_three_give_no_bold():
    rows = {"a": shifted(np.array([0.1, 0.11, 0.12]), 0), "b": shifted(np.array([0.8, 0.9, 1.0]), 10)}
    assert best_or_tied(rows, lower=True) == set()  # 2 of C(6, 3) = 20 are 10 %


def test_one_row_with_too_few_pairs_leaves_nothing_bold():
    # 2 of 2⁶ signs, for two rows 6.25 %; without pairs 2 of C(12, 6), 0.4 %.
    column = {
        "best": shifted(around(0.1)[:6], 0),
        "paired": shifted(around(0.5)[:6], 0),
        "fresh": shifted(around(0.9)[:6], 110),
    }
    assert best_or_tied(column, lower=True) == set()
    assert best_or_tied({name: column[name] for name in ("best", "fresh")}, lower=True) == {"best"}
