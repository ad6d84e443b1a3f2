"""What this project says of the contrast row: each claim by the measure that it names, each world by its own limit."""

from typing import Any

import pytest

from experiments.shared import paired_tests
from experiments.table1 import claims, claims_report, contrast_claims
from experiments.table1.cells import COLUMNS
from experiments.table1.claim_rules import overall
from tests.finished_runs import around, finished_cell, study_of

SEEDS = {env: list(range(1000 if env == "gridworld" else 110, 1010 if env == "gridworld" else 120)) for env in COLUMNS}
GOOD: dict[str, Any] = {
    "violation_rate_policy": around(0.0005, 0.0001),
    "return": around(1.1),
    "expert_return": 1.0,
    "reward_correlation": around(0.98),
    "feasibility_auroc": around(0.998, 0.001),
}
CLAIM_OF = {
    "violation_rate_policy": (
        "π stays below the project's limits on violations",
        "π stays below this row's own, stricter limits",
    ),
    "return": ("π does the task",),
    "reward_correlation": ("f is the reward, step by step",),
    "feasibility_auroc": ("δ̄ tells what violates from what does not",),
}


@pytest.fixture(autouse=True)
def quick_intervals(monkeypatch):
    """Of a twentieth of the resamples."""
    monkeypatch.setattr(paired_tests, "RESAMPLES", 499)


def judged(**bad: Any) -> dict[str, str]:
    """{claim: verdict} of the claims on Table 1, where the contrast row has these measures everywhere and others are good."""
    table = [finished_cell(env, "aircl_contrast", **(GOOD | bad)) | {"seeds": SEEDS[env]} for env in COLUMNS]
    told = [claims.with_evidence(study_of(*table), claim) for claim in contrast_claims.CLAIMS if claim.where == "ours"]
    return {text: overall(findings) for text, _, findings in told}


def test_every_claim_on_the_table_holds_of_a_good_row():
    assert set(judged().values()) == {"holds"} and len(judged()) == 5


@pytest.mark.parametrize(
    ("measure", "values"),
    [
        ("violation_rate_policy", around(0.2)),
        ("return", around(0.8)),
        ("reward_correlation", around(0.5)),
        ("feasibility_auroc", around(0.8)),
    ],
)
def test_each_claim_is_of_the_measure_that_it_names(measure, values):
    fails = {text for text, verdict in judged(**{measure: values}).items() if verdict == "does not hold"}
    assert fails == set(CLAIM_OF[measure])


def test_every_world_has_its_own_limit():
    given: dict[str, Any] = GOOD | {"violation_rate_policy": 0.004, "return": 0.93, "feasibility_auroc": 0.97}
    table = [finished_cell(env, "aircl_contrast", **given) for env in COLUMNS]
    lines = {
        text: [finding.verdict == "holds" for finding in findings]
        for text, _, findings in (claims.with_evidence(study_of(*table), claim) for claim in contrast_claims.CLAIMS)
    }
    assert COLUMNS == ("gridworld", "swimmer", "walker", "pendulum")
    assert lines["π stays below this row's own, stricter limits"] == [True, False, True, True]  # .5, .1, 1 and 1 %
    assert lines["π does the task"] == [True, False, True, False]  # .9, .95, .9 and 1
    assert lines["δ̄ tells what violates from what does not"] == [True, False, True, True]  # .95, .995, .95, .95


def test_the_page_has_the_claims_of_the_row_and_the_rule_of_the_swap_test():
    text = claims_report.markdown(study_of())
    assert "## What this project says of `aircl_contrast`" in text
    assert "| S1: f alone wants what the true reward alone wants | [swap.md](swap.md) |" in text
    assert "*A limit of the swap test.* Holds: the bootstrap interval of the mean over seeds keeps the limit." in text
