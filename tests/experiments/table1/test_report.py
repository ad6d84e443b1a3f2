"""table1.md: every number stands under its own heading, in its environment's column and in its unit."""

from typing import Any
from unittest import mock

import numpy as np
import pytest

from experiments.shared import paired_tests
from experiments.table1 import report
from experiments.table1.cells import COLUMNS, ROWS
from tests.finished_runs import FULL, around, finished_cell, study_of


@pytest.fixture(autouse=True)
def settings_of_today(monkeypatch):
    """Of cells that are made up, nothing is known of settings or commits; intervals of a twentieth of the resamples."""
    monkeypatch.setattr(paired_tests, "RESAMPLES", 499)
    monkeypatch.setattr(report, "other_settings", lambda job, cells: {})
    monkeypatch.setattr(report, "changed_since", {"abc1234": True, "def5678": False}.get)


def written(*cells: dict) -> str:
    return report.markdown(study_of(*cells))


def made_of(metrics: dict[str, Any]) -> dict[str, Any]:
    return finished_cell(**metrics)


def line_of(text: str, title: str, method: str) -> dict[str, str]:
    """{column: entry} of a method's line in the table under the heading that begins so; "paper's" follows its environment."""
    lines = text.split(f"## {title}")[1].split("\n## ", maxsplit=1)[0].splitlines()
    rows = [[entry.strip() for entry in line.strip("|").split("|")] for line in lines if line.startswith("|")]
    env, heads = "", []
    for head in rows[0]:
        env = head if head in COLUMNS else env
        heads.append(f"{env} {head}" if head == "paper's" else head)
    return dict(zip(heads, next(row for row in rows if row[0].split("`")[1:2] == [method]), strict=True))


@pytest.mark.parametrize(
    ("title", "entry"),
    [
        ("RCAcc", "0.610"),
        ("Balanced accuracy of D", "0.620"),
        ("Violation rate of q", "0.630"),
        ("Violation rate of π", "0.640"),
        ("Return of π over the expert's", "0.250"),
        ("AUROC of δ̄", "0.660"),
        ("Gap of δ̄", "0.670"),
        ("Correlation of f", "0.680"),
    ],
)
def test_every_measure_stands_under_its_own_heading(title, entry):
    cell = finished_cell(
        "swimmer",
        seeds=1,
        rc_acc=0.61,
        balanced_acc=0.62,
        violation_rate=0.63,
        violation_rate_policy=0.64,
        **dict[str, Any]({"return": 1.0}),
        expert_return=4.0,
        feasibility_auroc=0.66,
        feasibility_gap=0.67,
        reward_correlation=0.68,
    )
    line = line_of(written(cell), title, "aircl")
    assert line["swimmer"] == entry
    assert {line[env] for env in COLUMNS if env != "swimmer"} == {"—"}


def test_the_papers_numbers_stand_beside_ours_in_each_environment():
    line = line_of(written(), "Violation rate of q", "aircl")
    assert [line[f"{env} paper's"] for env in COLUMNS] == ["0.071 ± 0.036", "0.589 ± 0.030", "0.936 ± 0.005", "0.214 ± 0.244"]
    line = line_of(written(), "RCAcc", "icrl")
    assert {line[f"{env} paper's"] for env in COLUMNS} == {"—"}


def test_an_entry_is_mean_deviation_and_interval():
    # Ones among five draws of one 1 and four zeros: none in 33 %, at most three in 99.3 %.
    cell = finished_cell(seeds=5, violation_rate=[0.0, 0.0, 1.0, 0.0, 0.0])
    assert line_of(written(cell), "Violation rate of q", "aircl")["gridworld"] == "0.200 ± 0.447 [0.000, 0.600]"
    undefined = finished_cell(seeds=2, violation_rate=[0.1, np.nan])
    assert line_of(written(undefined), "Violation rate of q", "aircl")["gridworld"] == "—"


@pytest.mark.parametrize(
    ("title", "bold"),
    [
        ("RCAcc", {}),
        ("Balanced accuracy of D", {}),
        ("Violation rate of q", {"airl"}),
        ("Violation rate of π", {"airl"}),
        ("Return of π over the expert's", {"aircl"}),
        ("AUROC of δ̄", {"aircl"}),
        ("Gap of δ̄", {"aircl"}),
        ("Correlation of f", {"aircl"}),
    ],
)
def test_bold_is_the_lower_rate_and_the_higher_of_the_others(title, bold):
    measures = ("rc_acc", "balanced_acc", "violation_rate", "violation_rate_policy", "return")
    measures += ("feasibility_auroc", "feasibility_gap", "reward_correlation")
    low, high = (made_of(dict.fromkeys(measures, around(*ten)) | {"expert_return": 1.0}) for ten in ((0.2, 0.01), (0.8, 0.02)))
    text = written(low | {"method": "airl"}, high)
    entries = {method: line_of(text, title, method)["gridworld"] for method in ("airl", "aircl")}
    assert {method for method, entry in entries.items() if entry.startswith("**")} == set(bold)


def test_rows_that_are_given_the_reward_have_a_dagger_and_no_others():
    names = [report.name_of(method) for method in ROWS]
    assert [name for name in names if "†" in name] == ["`gacl` †", "`icrl` †", "`icrl_prior` †"]


def test_the_iterations_and_fresh_seeds_of_the_contrast_row_are_said():
    assert (
        "`aircl_contrast` has its own iterations and fresh seeds, none on which its settings were chosen: gridworld 300 "
        "iterations, seeds 1000 to 1009; swimmer 300 iterations, seeds 140 to 149; walker 500 iterations, seeds 170 to 179; "
        "pendulum 300 iterations, seeds 130 to 139."
    ) in written()
    older = finished_cell("swimmer", seeds=2, rc_acc=[0.1, 0.2]) | {"method": "aircl_contrast", "seeds": [110, 111]}
    assert "; swimmer 300 iterations, seeds 110 to 111; walker 500 iterations, seeds 170 to 179; " in written(older)


def test_bold_compares_a_row_with_other_seeds_without_pairs():
    wide = np.array([3, 1, 4, 1.5, 9, 2.6, 5, 3.5, 8, 7]) / 20
    ours = finished_cell(method="aircl_contrast", violation_rate=wide)
    other = finished_cell(method="bc", violation_rate=wide + 0.01 + wide / 100)
    for seeds, bold in ((list(range(10)), {"aircl_contrast"}), (list(range(1000, 1010)), {"aircl_contrast", "bc"})):
        assert report.bold(study_of(ours | {"seeds": seeds}, other), "gridworld", report.FIRST[2]) == bold


def test_effort_is_in_minutes_and_steps_and_its_sum_in_hours():
    cells = finished_cell("walker") | {"wall_s": 90.0, "env_steps": 1_234_567}, finished_cell() | {"wall_s": 7110.0}
    text = written(*cells)
    line = line_of(text, "Wall time", "aircl")
    assert (line["walker, min"], line["gridworld, min"], line["swimmer, min"]) == ("1.5", "118.5", "—")
    assert "| 1.5 | 1,234,567 | — |" in text
    assert f"2 of {4 * len(ROWS)} cells, 2.0 hours together on 1 × cpu. Iterations: gridworld 250, walker 250." in text


def test_a_profile_is_the_share_of_runs_whose_policy_violates_no_more():
    cells = (
        finished_cell(seeds=2, violation_rate=0.9, violation_rate_policy=[0.0, 0.01]),
        finished_cell("walker", seeds=2, violation_rate=0.9, violation_rate_policy=[0.06, 0.6]),
    )
    line = line_of(written(*cells), "Performance profile", "aircl")
    assert [line[f"≤ {level:g}"] for level in (0.001, 0.005, 0.01, 0.02, 0.05, 0.1, 0.5)] == [
        *("0.25", "0.25", "0.50", "0.50", "0.50", "0.75", "0.75"),
    ]
    assert line["over the seeds of"] == "gridworld, walker"


def test_every_seed_is_listed_by_measure():
    cell = finished_cell(seeds=2, rc_acc=[0.1, 0.2], violation_rate=[0.3, 0.4], violation_rate_policy=[0.5, np.nan])
    assert "- aircl: RCAcc 0.100 0.200; q 0.300 0.400; π 0.500 —" in written(cell)


def test_cells_are_listed_by_the_commits_that_made_them():
    cells = finished_cell(), finished_cell(method="bc") | {"commits": ["abc1234", "def5678"], "alarms": ["it rang"]}
    text = written(*cells)
    assert "- commit `abc1234` (the library has changed since): gridworld: aircl\n" in text
    assert "- commit `abc1234 then def5678` (the library is the same today): gridworld: bc\n" in text
    assert text.endswith("## Alarms\n\n- gridworld/bc: it rang\n")


def test_json_names_the_best_of_each_column():
    cells = finished_cell(violation_rate=around(0.1)), finished_cell(method="airl", violation_rate=around(0.5))
    with mock.patch.object(report, "versions", dict):
        text = report.as_json(study_of(*cells))
    assert '"violation_rate": {\n   "gridworld": [\n    "aircl"\n   ],\n   "swimmer": []' in text
    assert FULL.scale in text
