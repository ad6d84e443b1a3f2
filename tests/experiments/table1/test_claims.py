"""The claims: the verdicts of whole tables that are made up, and the measures beside them."""

from typing import Any

import numpy as np
import pytest

from experiments.shared import paired_tests
from experiments.shared.paper import METHODS_OF_THE_PAPER
from experiments.table1 import claims, claims_report, contrast_claims
from experiments.table1.cells import COLUMNS, ROWS
from experiments.table1.claim_rules import overall
from tests.finished_runs import around, finished_cell, study_of

HOLDS, BEYOND = "holds", "does not hold"


@pytest.fixture(autouse=True)
def quick_intervals(monkeypatch):
    """Of a twentieth of the resamples."""
    monkeypatch.setattr(paired_tests, "RESAMPLES", 499)


def test_without_cells_every_claim_says_that_they_are_missing():
    text = claims_report.markdown(study_of())
    verdicts = [line for line in text.splitlines() if line.endswith("** |")]
    assert len(verdicts) == len(claims.CLAIMS) + len(claims.OURS) + len(contrast_claims.CLAIMS) + 3
    assert all("cannot be told: cells missing" in line for line in verdicts)


def test_rcacc_at_the_optimum_is_read_from_the_runs_that_ended_there():
    cell = finished_cell(rc_acc=np.linspace(0.1, 1, 10), balanced_acc=[0.5] * 5 + [0.9] * 5, logit_size=[0.1] * 2 + [3.0] * 8)
    text = claims.at_the_optimum(study_of(cell))
    assert "Of 10 runs (cells × seeds), 5 ended" in text
    assert "RCAcc 0.300 ± 0.158, from 0.100 to 0.500" in text
    assert "ended 2: RCAcc 0.150 ± 0.071" in text


def test_best_among_rows_without_the_reward_ignores_those_that_have_it():
    rates = dict.fromkeys(ROWS, 0.2) | {"icrl": 0.0, "aircl_corrected": 0.1}
    given = [
        finished_cell(method=name, violation_rate=around(rate, 0.001 * (1 + i))) for i, (name, rate) in enumerate(rates.items())
    ]
    assert claims.best_without_reward(study_of(*given))[0].verdict == "holds"
    assert claims.best_without_reward(study_of(*given[:-1]))[0].verdict == "cannot be told"


GOOD: dict[str, Any] = {
    "rc_acc": around(0.9),
    "violation_rate": around(0.0025, 0.001),
    "violation_rate_policy": around(0.002, 0.001),
    "logit_size": around(0.3),  # D at 0.57
    "return": around(0.95),
    "expert_return": 1.0,
    "feasibility_auroc": around(0.95),
    "feasibility_gap": around(0.6),
    "reward_correlation": around(0.8),
}
BAD: dict[str, Any] = {  # as wide again: equal differences of all seeds would take long to test
    "rc_acc": around(0.4, 0.02),
    "violation_rate": around(0.97, 0.02),
    "violation_rate_policy": around(0.97, 0.02),
    "logit_size": around(0.5, 0.02),  # D at 0.62
    "return": around(0.8, 0.02),
    "expert_return": 1.0,
    "feasibility_auroc": around(0.85, 0.02),
    "feasibility_gap": around(0.4, 0.02),
    "reward_correlation": around(0.6, 0.02),
}


def verdicts(good: set[str], *texts: str) -> dict[str, str]:
    """Of these claims, where these rows are good everywhere and the others bad."""
    table = [finished_cell(env, name, **(GOOD if name in good else BAD)) for env in COLUMNS for name in ROWS]
    rules = (*claims.CLAIMS, *claims.OURS)
    evidence = [claims.with_evidence(study_of(*table), claim) for claim in rules if claim.text in texts]
    return {text: overall(findings) for text, _, findings in evidence}


PRAISING = (
    "AIRCL outperforms AIRL",
    "AIRCL outperforms GACL",
    "The contrast prior helps AIRCL: without it, both measures decline",
    "Feasibility of trajectories beats that of state-action pairs",
    "Non-linear reward and constraint beat linear ones",
    "AIRCL recovers the constraint accurately",
    "AIRCL recovers the reward accurately",
    "AIRCL's behaviour matches the demonstrations, with a low rate of violations",
    "The contrast prior helps ICRL*",
    *(claim.text for claim in claims.OURS),
)
ON_THE_WALKER = "On the walker, AIRCL without the prior is better"


def test_every_claim_holds_where_the_row_that_it_praises_is_the_good_one():
    found = verdicts({"aircl", "aircl_corrected", "icrl_prior"}, *PRAISING, ON_THE_WALKER)
    assert {found[text] for text in PRAISING} == {"holds"}
    assert found[ON_THE_WALKER] == "does not hold"


def test_every_claim_fails_where_the_row_that_it_praises_is_the_bad_one():
    found = verdicts(set(ROWS) - {"aircl", "aircl_corrected", "icrl_prior"}, *PRAISING, ON_THE_WALKER)
    assert {found[text] for text in PRAISING} == {"does not hold"}
    assert found[ON_THE_WALKER] == "holds"


def test_rows_with_the_reward_outperform_where_they_are_the_good_ones():
    claim = "On the grid, both ICRL* variants, which have the true reward, outperform AIRCL"
    assert verdicts({"icrl", "icrl_prior"}, claim)[claim] == "holds"
    assert verdicts({"aircl"}, claim)[claim] == "does not hold"


def test_d_converges_to_a_half_where_the_logits_of_both_rows_are_small():
    claim = "At optimality D converges to ½"
    assert [verdicts(good, claim)[claim] for good in ({"aircl", "airl"}, set())] == ["holds", "does not hold"]


@pytest.mark.parametrize(("grid", "walker", "verdict"), [(0.1, 0.4, "holds"), (0.4, 0.1, "does not hold")])
def test_robots_are_harder_than_the_grid_and_the_walker_the_hardest(grid, walker, verdict):
    rates = {"gridworld": grid, "swimmer": 0.25, "walker": walker, "pendulum": 0.2}
    table = [finished_cell(env, name, violation_rate=rate) for env, rate in rates.items() for name in METHODS_OF_THE_PAPER]
    evidence = {claim.text: overall(claims.with_evidence(study_of(*table), claim)[2]) for claim in claims.CLAIMS}
    assert evidence["All methods do worse on the robots than on the grid"] == verdict
    assert evidence["On the walker all methods do worse than on the other tasks"] == verdict


def test_our_limits_are_those_of_each_environment():
    table = [finished_cell(env, "aircl_corrected", violation_rate=0.03, violation_rate_policy=0.03) for env in COLUMNS]
    text, _, found = claims.with_evidence(study_of(*table), claims.OURS[0])
    assert "below the project's limits" in text
    # q: 0.005, 0.05, 0.05 and 0.02; π: the same, but 0.05 on the pendulum
    assert [line.verdict for line in found if "violation_rate of" in line.what] == [BEYOND, HOLDS, HOLDS, BEYOND]
    assert [line.verdict for line in found if "violation_rate_policy of" in line.what] == [BEYOND, HOLDS, HOLDS, HOLDS]


def test_less_than_any_row_of_the_paper_is_less_than_the_least_of_each_column():
    assert claims.LEAST_OF_THE_PAPER == {"gridworld": 0.051, "swimmer": 0.589, "walker": 0.936, "pendulum": 0.214}


@pytest.mark.parametrize(("order", "verdict"), [(1, "does not hold"), (-1, "holds")])
def test_accuracy_goes_with_fewer_violations_where_the_ranks_run_against_each_other(order, verdict):
    rates = np.array([1, 2, 4, 8, 16, 32]) / 100  # ranks that are no line; those of π run the other way
    rows = METHODS_OF_THE_PAPER[:6]
    table = [
        finished_cell(
            method=name, rc_acc=0.4 + 0.1 * order * place, violation_rate=rates[place], violation_rate_policy=-rates[place]
        )
        for place, name in enumerate(rows)
    ]
    found = claims.ranks(study_of(*table))[0]
    assert (found.env, found.verdict) == ("gridworld", verdict)
    assert f"ρ = {order:+.2f}" in found.measured


def test_a_coin_is_a_balanced_accuracy_on_either_side_of_a_half():
    cell = finished_cell(
        seeds=4, rc_acc=[0.1, 0.2, 0.3, 0.4], balanced_acc=[0.4, 0.46, 0.54, 0.6], logit_size=[0.3, 0.5, 0.5, 0.5]
    )
    text = claims.at_the_optimum(study_of(cell))
    assert (
        "Of 4 runs (cells × seeds), 2 ended with a balanced accuracy within 0.05 of ½: RCAcc 0.250 ± 0.071, from 0.200 to 0.300"
        in text
    )
    assert "of at most 0.405, D between 0.4 and 0.6, ended 1: RCAcc 0.100, from 0.100 to 0.100" in text


def test_best_without_the_reward_is_the_row_that_violates_least_in_the_samples_of_q():
    rates = dict.fromkeys(ROWS, 0.2) | {"aircl_corrected": 0.1}
    table = [
        finished_cell(method=name, violation_rate=around(rate, 0.001 * (1 + i)), violation_rate_policy=around(0.3 - rate))
        for i, (name, rate) in enumerate(rates.items())
    ]
    found = claims.best_without_reward(study_of(*table))[0]
    assert (found.env, found.verdict) == ("gridworld", "holds")
    assert found.measured == "best mean: aircl_corrected; against it p = 1"
    worst = [
        cell | {"method": {"airl": "aircl_corrected", "aircl_corrected": "airl"}.get(cell["method"], cell["method"])}
        for cell in table
    ]
    assert claims.best_without_reward(study_of(*worst))[0].verdict == "does not hold"


def test_a_claim_is_counted_line_by_line_with_its_environments():
    rates = dict(zip(COLUMNS, (0.001, 0.5, 0.5, 0.001), strict=True))
    table = [
        finished_cell(env, "aircl_corrected", violation_rate=rate, violation_rate_policy=rate) for env, rate in rates.items()
    ]
    text = claims_report.markdown(study_of(*table))
    line = next(line for line in text.splitlines() if line.startswith("| `aircl_corrected` stays below"))
    assert line == (
        "| `aircl_corrected` stays below the project's limits on violations, q and π | ours | holds: 4 of 8 (gridworld ×2, "
        "pendulum ×2); does not hold: 4 of 8 (swimmer ×2, walker ×2) | **cannot be told** |"
    )
