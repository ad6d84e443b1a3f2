"""The three rules by which a claim is judged, on cells with known numbers."""

from typing import Any

import numpy as np
import pytest

from experiments.shared import paired_tests
from experiments.shared.paper import METHODS_OF_THE_PAPER
from experiments.table1.cells import ROWS
from experiments.table1.claim_rules import Bound, Contrast, Finding, Harder, overall
from tests.finished_runs import around, finished_cell, study_of

CONTRAST = Contrast("aircl", "airl", envs=("gridworld",))


@pytest.fixture(autouse=True)
def quick_intervals(monkeypatch):
    """Of a twentieth of the resamples."""
    monkeypatch.setattr(paired_tests, "RESAMPLES", 499)


def told(rule: Contrast | Bound | Harder, *given: dict[str, Any]) -> dict[str, str]:
    return {finding.what.split(":")[0]: finding.verdict for finding in rule.findings(study_of(*given))}


def test_a_contrast_holds_where_the_paired_test_shows_it_and_not_where_it_shows_the_opposite():
    better = finished_cell(rc_acc=around(0.9), violation_rate=around(0.3))
    worse = finished_cell(method="airl", rc_acc=around(0.5), violation_rate=around(0.1))
    assert told(CONTRAST, better, worse) == {"rc_acc": "holds", "violation_rate": "does not hold"}


def test_a_contrast_that_is_not_shown_does_not_hold_only_where_the_papers_gain_is_excluded():
    signs = np.tile([1.0, -1.0], 5)  # the paper's gains: 0.204 of RCAcc, 0.024 of the violation rate
    one = finished_cell(rc_acc=0.5 + 0.01 * signs, violation_rate=0.1 + 0.1 * signs)
    other = finished_cell(method="airl", rc_acc=0.5, violation_rate=0.1)
    assert told(CONTRAST, one, other) == {"rc_acc": "does not hold", "violation_rate": "cannot be told"}


def test_a_row_with_its_own_seeds_is_contrasted_without_pairs():
    wide = np.array([3, 1, 4, 1.5, 9, 2.6, 5, 3.5, 8, 7]) / 20  # seeds differ more than the rows, every seed by as much
    ours = finished_cell(method="aircl_contrast", violation_rate=wide, rc_acc=wide)
    other = finished_cell(method="bc", violation_rate=wide + 0.01 + wide / 100, rc_acc=0.9 + wide / 100)
    rule = Contrast("aircl_contrast", "bc", ("violation_rate", "rc_acc"), ("gridworld",))
    assert [found.verdict for found in rule.findings(study_of(ours, other))] == ["holds", "does not hold"]
    fresh = rule.findings(study_of(ours | {"seeds": list(range(1000, 1010))}, other))
    assert [found.verdict for found in fresh] == ["cannot be told", "does not hold"]
    assert "gain +0.012 [-0.1" in fresh[0].measured and fresh[0].measured.endswith(", other seeds")
    assert "gain -0.679 [-0.7" in fresh[1].measured


def test_two_seeds_and_missing_cells_tell_nothing():
    few = [finished_cell(method=method, seeds=2, rc_acc=0.5, violation_rate=0.1) for method in ("aircl", "airl")]
    assert set(told(CONTRAST, *few).values()) == {"cannot be told"}
    finding = CONTRAST.findings(study_of(few[0]))[0]
    assert (finding.verdict, finding.because) == ("cannot be told", "cells missing: airl")


@pytest.mark.parametrize(("centre", "verdict"), [(0.1, "holds"), (0.2, "cannot be told"), (0.3, "does not hold")])
def test_a_limit_is_judged_by_the_whole_interval(centre, verdict):
    rule = Bound("aircl", "violation_rate", {"gridworld": 0.2}, most=True)
    assert rule.findings(study_of(finished_cell(violation_rate=around(centre))))[0].verdict == verdict


def test_harder_means_that_every_row_is_worse():
    def findings(*rates: float) -> list[Finding]:
        rows = zip(METHODS_OF_THE_PAPER, rates, strict=False)
        here = [finished_cell("gridworld", name, violation_rate=rate) for name, rate in rows]
        there = [cell | {"env": "swimmer"} for cell in (finished_cell("gridworld", name, violation_rate=0.2) for name in ROWS)]
        return Harder("gridworld", "swimmer").findings(study_of(*here, *there))

    assert [found.verdict for found in findings(*[0.3] * 8)] == ["holds"]
    assert [found.verdict for found in findings(*[0.3] * 7, 0.1)] == ["cannot be told"]
    assert [found.verdict for found in findings(*[0.3] * 4, *[0.1] * 4)] == ["does not hold"]
    assert [found.because for found in findings(*[0.3] * 7)] == [f"cells missing: {METHODS_OF_THE_PAPER[-1]}"]


def test_a_claim_needs_more_than_half_of_its_lines():
    lines = [Finding("gridworld", "", "", verdict) for verdict in ("holds", "holds", "does not hold", "cannot be told")]
    assert overall(lines) == "cannot be told"
    assert overall(lines[:3]) == "holds"
    assert overall(lines[2:3]) == "does not hold"


def test_a_contrast_is_said_with_both_rows_its_gain_and_the_papers():
    rates = 0.1 + 0.01 * np.array([1, 1, 1, 1, 1, 1, 1, 1, 1, 6])  # a mean that is not the median
    given = finished_cell(violation_rate=rates), finished_cell(method="airl", violation_rate=0.3)
    found = Contrast("aircl", "airl", ("violation_rate",), ("gridworld",)).findings(study_of(*given))[0]
    assert found.measured.startswith("0.115 ± 0.016 against 0.300 ± 0.000; gain +0.185 [+0.1")
    assert found.measured.endswith("p = 0.002; the paper's gain +0.024")  # 2 of 2¹⁰ signs; 0.095 − 0.071
    accuracy = Contrast("aircl", "airl", ("rc_acc",), ("gridworld",)).findings(study_of(*given))[0]
    assert accuracy.because == "undefined"


def test_a_contrast_is_corrected_over_its_measures_and_environments():
    signs = np.array([1, 1, -1, -1, 1, 1, 1, 1, 1, 1]) * np.arange(1, 11) / 100  # a rank sum of 3 + 4: p = 3.7 %
    pair = [finished_cell(rc_acc=0.5 + signs, violation_rate=0.1), finished_cell(method="airl", rc_acc=0.5, violation_rate=0.1)]
    one, two = Contrast("aircl", "airl", ("rc_acc",), ("gridworld",)), Contrast("aircl", "airl", envs=("gridworld",))
    assert [found.verdict for found in one.findings(study_of(*pair))] == ["holds"]
    assert "p = 0.074" in two.findings(study_of(*pair))[0].measured
    assert two.findings(study_of(*pair))[0].verdict != "holds"


def test_a_gain_that_the_paper_does_not_have_excludes_nothing():
    # All six seeds are worse, which two measures cannot show (2 · 2 of 2⁶); the paper's gains are −0.194 and −0.010.
    worse = 0.01 * np.arange(6)
    rows = (
        finished_cell(method="aircl", seeds=6, rc_acc=0.9, violation_rate=0.1),
        finished_cell(method="aircl_no_prior", seeds=6, rc_acc=0.4 + worse, violation_rate=0.4 + worse),
    )
    found = Contrast("aircl_no_prior", "aircl", envs=("gridworld",)).findings(study_of(*rows))
    assert ["the paper's gain -0.194" in found[0].measured, "the paper's gain -0.010" in found[1].measured] == [True, True]
    assert [line.verdict for line in found] == ["cannot be told"] * 2


@pytest.mark.parametrize(("centre", "verdict"), [(0.1, "does not hold"), (0.2, "cannot be told"), (0.3, "holds")])
def test_a_lower_limit_is_judged_from_the_other_side(centre, verdict):
    rule = Bound("aircl", "feasibility_auroc", {"gridworld": 0.2}, most=False)
    assert rule.findings(study_of(finished_cell(feasibility_auroc=around(centre))))[0].verdict == verdict


def test_five_seeds_are_too_few_for_a_limit_and_six_are_enough():
    rule = Bound("aircl", "violation_rate", {"gridworld": 0.2}, most=True)
    verdicts = [rule.findings(study_of(finished_cell(seeds=n, violation_rate=0.1)))[0].verdict for n in (5, 6)]
    assert verdicts == ["cannot be told", "holds"]


def test_half_of_the_lines_are_not_more_than_half():
    assert overall([Finding("gridworld", "", "", "holds"), Finding("walker", "", "", "does not hold")]) == "cannot be told"
