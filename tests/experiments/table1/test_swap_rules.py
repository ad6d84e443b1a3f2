"""The claims of the swap test, on cells with known numbers and on the kept ones, computed again here."""

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from experiments.shared import paired_tests
from experiments.shared.paired_tests import interval
from experiments.swap import scores
from experiments.table1 import contrast_claims
from experiments.table1.claim_rules import Finding
from experiments.table1.swap_rules import Transfer, Violation
from tests.finished_runs import around, study_of

KEPT = Path(__file__).parents[3] / "results" / "swap"
TEN = list(range(10))


@pytest.fixture(autouse=True)
def quick_intervals(monkeypatch):
    """Of a twentieth of the resamples."""
    monkeypatch.setattr(paired_tests, "RESAMPLES", 499)


def robot(test: str, row: str, returns: Any, violations: Any = 0.0, env: str = "swimmer"):
    metrics = {"return": np.broadcast_to(returns, 10).tolist(), "violation_rate": np.broadcast_to(violations, 10).tolist()}
    return (env, test, row), {"env": env, "test": test, "row": row, "metrics": metrics}


def grid(world: str, tempted: Any = 9.0, row: str = "mine", **metrics: Any):
    obstacles = {"true_tempted": [[100.0, float(value)] for value in np.broadcast_to(tempted, 10)]}
    given = {name: np.broadcast_to(np.array(values, object), 10).tolist() for name, values in metrics.items()}
    return ("gridworld", world, row), {"seeds": TEN, "metrics": given, "obstacles": obstacles}


def found(rule: Transfer | Violation, *cells: Any) -> list[Finding]:
    return rule.findings(replace(study_of(), swap=dict(cells)))


def swap_of(test: str, returns: Any, violations: Any = 0.0):
    """The truth earns 110 and the uniform policy 10."""
    return robot(test, "mine", returns, violations), robot(test, "oracle", 110.0, 0.5), robot(test, "uniform", 10.0, 0.7)


@pytest.mark.parametrize(
    ("returns", "verdict"),
    [
        (around(107, 1), "holds"),  # 0.97, within 0.01
        (around(105.5, 4), "cannot be told"),  # 0.955, and the interval reaches below
        (around(104.5, 4), "does not hold"),  # 0.945, though the interval reaches above
        (around(95, 1), "does not hold"),
    ],
)
def test_a_share_is_judged_by_its_mean_and_holds_by_its_whole_interval(returns, verdict):
    line = found(Transfer("mine", "S0", {"swimmer": 0.95}), *swap_of("S0", returns))[0]
    shares = (np.array(returns) - 10) / 100
    bounds = interval(shares.tolist())
    assert bounds and line.measured == f"{shares.mean():.3f} [{bounds[0]:.3f}, {bounds[1]:.3f}], 10 seeds"
    assert (line.env, line.what, line.verdict) == ("swimmer", "S0: share of what the truth earns ≥ 0.95", verdict)


@pytest.mark.parametrize(
    ("rates", "verdict"),
    [
        (around(0.0005, 0.0001), "holds"),
        (around(0.0009, 0.0004), "cannot be told"),
        (around(0.0011, 0.0004), "does not hold"),
        (around(0.01, 0.001), "does not hold"),
    ],
)
def test_violations_are_judged_from_the_other_side(rates, verdict):
    line = found(Violation("mine", ("S0",), {"swimmer": 0.001}), *swap_of("S0", 0.0, rates))[0]
    assert (line.what, line.verdict) == ("S0: violations ≤ 0.1 %", verdict)
    assert line.measured.startswith(f"{100 * np.mean(rates):.3f} [") and line.measured.endswith(" %, 10 seeds")


BODIES = ("S4 mirror", "S4 weak", "S4 shape", "S4 viscosity")


def test_changed_bodies_are_averaged_seed_by_seed_and_each_is_a_line_of_its_own():
    up = 110 + np.arange(10.0)
    cells = [
        cell for body, returns in zip(BODIES, (up, -up + 220, 60.0, 110.0), strict=True) for cell in swap_of(body, returns)
    ]
    together = found(Transfer("mine", "S4", {"swimmer": 0.95}), *cells)
    assert [line.measured for line in together] == ["0.875 [0.875, 0.875], 10 seeds"]  # of 1, 1, .5 and 1, without spread
    weak = found(Transfer("mine", "S4 shape", {"swimmer": 0.95}), *cells)
    assert [line.measured for line in weak] == ["0.500 [0.500, 0.500], 10 seeds"]
    few = found(Transfer("mine", "S4", {"swimmer": 0.95}), *cells[3:])
    assert [(line.verdict, line.because) for line in few] == [("cannot be told", "cells missing: swap test")]
    rates = found(Violation("mine", ("S4",), {"swimmer": 0.001}), *cells[3:])
    assert [line.verdict for line in rates] == ["cannot be told", "holds", "holds", "holds"]


def test_f_alone_is_judged_by_the_lift_over_the_constrained_truth():
    cells = *swap_of("S0", 0.0), robot("S1", "mine", 150.0), robot("S1", "oracle", 210.0)  # of 100 to gain, 40
    assert found(Transfer("mine", "S1", {"swimmer": 0.9}), *cells)[0].measured.startswith("0.400 [")


def test_a_grids_line_is_each_seeds_mean_over_the_layouts_where_the_measure_is_defined():
    up = np.arange(10) / 10
    measures = {"self_return": up, "constraint_transfer_return": 0.5, "self_violation": 0.01, "transfer_violation": 0.5}
    cells = (
        grid("default, goal", **measures),
        grid("second, goal", **{**measures, "self_return": 1.8 - up}),
        grid("third, goal", **{**measures, "self_return": [None, *up[1:]]}),
        grid("default, goal", row="other", **{**measures, "self_return": 0.0}),
        grid("default, sites", **{**measures, "self_return": 0.2}),
    )
    lines = {line.what.split(":")[0]: line for line in found(Transfer("mine", "S0", {"gridworld": 0.95}), *cells)}
    assert list(lines) == ["S0, reward=distance, 0 layouts", "S0, reward=goal, 2 layouts", "S0, reward=sites, 1 layouts"]
    distance, goal, sites = lines.values()
    assert (distance.verdict, distance.because) == ("cannot be told", "cells missing: swap test")
    assert goal.measured == "0.900 [0.900, 0.900], 10 seeds"
    assert sites.measured == "0.200 [0.200, 0.200], 10 seeds"
    rates = found(Violation("mine", ("S0", "S3", "S4"), {"gridworld": 0.03}), *cells)  # S3 has none on grids
    assert [(line.what.split(",")[0], line.verdict) for line in rates if "goal" in line.what] == [
        ("S0", "holds"),
        ("S4", "does not hold"),
    ]


def test_of_obstacles_that_were_tempting_only_these_seeds_and_layouts_count():
    half = [6.0] * 5 + [5.9] * 5
    cells = (
        grid("default, goal", half, constraint_transfer_return=[0.0] * 5 + [1.0] * 5),
        grid("second, goal", half[::-1], constraint_transfer_return=[1.0] * 5 + [0.5] * 5),
        grid("third, goal", 1.0, constraint_transfer_return=9.0),
        grid("third, sites", 1.0, constraint_transfer_return=9.0),
    )
    _, goal, sites = found(Transfer("mine", "S2", {"gridworld": 0.99}, tempted=6.0), *cells)
    assert goal.what.startswith("S2, reward=goal, 2 layouts")
    assert goal.measured.startswith("0.250 [")  # five seeds of 0 on the one layout, five of ½ on the other
    assert (sites.measured, sites.because) == ("—", "undefined")


def test_worlds_without_a_cell_of_the_row_are_lines_that_cannot_be_told():
    limits = {"swimmer": 0.95, "walker": 0.95}
    one = found(Transfer("mine", "S0", limits), *swap_of("S0", 109.0), robot("S0", "oracle", 1.0, env="walker"))
    two = found(Violation("mine", ("S0",), limits), *swap_of("S0", 109.0))
    for lines in (one, two):
        assert [(line.env, line.because) for line in lines] == [("swimmer", ""), ("walker", "cells missing: swap test")]
        assert lines[1].verdict == "cannot be told"
    none = found(Transfer("mine", "S0", limits), robot("S0", "oracle", 1.0))
    assert [(line.env, line.because) for line in none] == [(env, "cells missing: swap test") for env in limits]


def test_few_seeds_tell_nothing():
    cells = [
        (key, {**cell, "metrics": {name: row[:5] for name, row in cell["metrics"].items()}})
        for key, cell in swap_of("S0", 109.0)
    ]
    line = found(Transfer("mine", "S0", {"swimmer": 0.95}), *cells)[0]
    assert (line.verdict, line.because) == ("cannot be told", "5 seeds are too few")


def kept(row: str, test: str) -> np.ndarray:
    path = KEPT / "swimmer" / row / f"{test.replace(' ', '_')}.json"
    return np.array(json.loads(path.read_text(encoding="utf-8"))["metrics"]["return"])


def test_the_kept_swimmers_come_out_as_they_are():
    study = replace(study_of(), swap=scores.load(KEPT))
    lines = [line for claim in contrast_claims.CLAIMS for rule in claim.rules for line in rule.findings(study)]
    told = {line.what.split(":")[0]: line for line in lines if line.env == "swimmer" and "share of" in line.what}
    assert set(told) == {"S0", "S1", "S2", "S3", "S4", *BODIES}
    for test in set(told) - {"S4"}:
        floor = kept("oracle", "S0") if test == "S1" else kept("uniform", test)
        share = np.mean((kept("aircl_contrast", test) - floor.mean()) / (kept("oracle", test).mean() - floor.mean()))
        limit = 0.9 if test == "S1" else 0.95
        assert told[test].measured.startswith(f"{share:.3f} [")
        assert (told[test].verdict == "does not hold") == (share < limit)
