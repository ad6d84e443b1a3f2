import itertools
import json
import shlex
from pathlib import Path
from typing import Any
from unittest import mock

import numpy as np
import pytest

from experiments import run
from experiments.shared import commits
from experiments.shared.paired_tests import against_best, best_or_tied, differences, holm, interval, least_p, mean, paired_p
from experiments.shared.paper import METHODS_OF_THE_PAPER, PAPER
from experiments.table1 import __main__ as table1
from experiments.table1 import cells, claims, claims_report, convergence, report
from experiments.table1.cells import COLUMNS, ROWS, Job, Study
from experiments.table1.claim_rules import Bound, Contrast, Finding, Harder, overall

SEEDS = 10


@pytest.fixture(autouse=True)
def elsewhere(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)


@pytest.fixture
def job() -> Job:
    return table1.job_of(table1.Settings(out="mine"))


def made(job: Job, env: str = "gridworld", method: str = "aircl", seeds: int = SEEDS, **metrics: Any) -> dict[str, Any]:
    """A finished cell with these values of its measures, one number for all seeds or one each; the others are undefined."""
    names = (*cells.CURVES, "logit_size", "expert_return", "feasibility_auroc", "reward_correlation")
    per_seed = {name: np.broadcast_to(metrics.get(name, np.nan), seeds).tolist() for name in names}
    per_seed = {name: [None if np.isnan(one) else one for one in given] for name, given in per_seed.items()}
    return {
        "env": env,
        "method": method,
        "seeds": list(range(seeds)),
        "iterations": 250,
        "env_steps": 7000,
        "wall_s": 60.0,
        "versions": {"devices": "1 × cpu"},
        "metrics": {name: {"per_seed": given} for name, given in per_seed.items()},
        "scale": job.scale,
        "command": cells.command(job, env, method),
        "commit": "abc1234",
        "commits": ["abc1234"],
        "settings": cells.settings_of(cells.planned(job, env, method)),
        "alarms": [],
        "curves": {"iteration": [0, 250], "violation_rate_policy": [[0.5] * seeds, [0.1] * seeds]},
    }


def study(job: Job, *given: dict[str, Any]) -> Study:
    found = {(cell["env"], cell["method"]): cell for cell in given}
    missing = {(env, method): "not trained yet" for env in COLUMNS for method in ROWS if (env, method) not in found}
    return Study(job, found, missing, "python -m experiments.table1", "abc1234")


def seeds(*values: float | None) -> dict[int, float | None]:
    return dict(enumerate(values))


def spread(centre: float, width: float = 0.01) -> np.ndarray:
    return centre + width * np.linspace(-1, 1, SEEDS)


# Statistics


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
        "worse": seeds(*spread(0.2).tolist()),
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


# The paper's numbers


def test_papers_table_is_read_by_column():
    assert PAPER["gridworld"]["airl"] == {"rc_acc": (0.625, 0.078), "violation_rate": (0.095, 0.026)}
    assert PAPER["pendulum"]["aircl"] == {"rc_acc": (0.851, 0.131), "violation_rate": (0.214, 0.244)}
    assert PAPER["walker"]["icrl_prior"] == {"violation_rate": (0.940, 0.003)}
    assert [len(rows) for rows in PAPER.values()] == [8] * 4


# Cells


@pytest.mark.parametrize(("iterations", "chunk"), [(250, 10), (100, 5), (20, 1), (4, 1), (37, 1)])
def test_evaluations_divide_the_training_into_twenty_parts_or_more(iterations, chunk):
    assert cells.chunk_of(iterations) == chunk


def test_a_smoke_test_of_all_runs_every_method_on_the_grid_and_some_on_the_robots():
    every = table1.chosen_cells(table1.Settings(scale="smoke"))
    assert [method for env, method in every if env == "gridworld"] == list(ROWS)
    assert [method for env, method in every if env == "walker"] == ["airl", "aircl", "aircl_corrected", "bc"]
    assert table1.chosen_cells(table1.Settings(scale="smoke", env="walker", method="icrl")) == [("walker", "icrl")]
    assert len(table1.chosen_cells(table1.Settings())) == len(COLUMNS) * len(ROWS)


@pytest.mark.parametrize("env", COLUMNS)
def test_every_method_of_an_environment_has_the_same_iterations(env, job):
    assert len({cells.arguments(job, env, method)["iterations"] for method in ROWS}) == 1


def test_curves_are_the_evaluations_and_the_untrained_policy():
    history = {
        "violation_rate": np.arange(12.0).reshape(6, 2) / 3,
        "rc_acc": np.where(np.arange(6) % 3 == 2, 0.5, np.nan)[:, None],
    }
    assert cells.curves(history, chunk=3) == {
        "iteration": [0, 3, 6],
        "violation_rate": [[0.0, 0.3333], [1.333, 1.667], [3.333, 3.667]],
        "rc_acc": [[None], [0.5], [0.5]],
    }


def test_return_ratio_is_undefined_where_the_expert_earns_nothing(job):
    returns: dict[str, Any] = {"return": [1.0, 2.0, 3.0], "expert_return": [2.0, 0.0, -1.0]}
    cell = made(job, seeds=3, **returns)
    assert cells.values(cell, "return_ratio") == {0: 0.5, 1: None, 2: None}


def test_a_kept_cell_reads_back_the_same(job):
    cell = made(job, violation_rate=0.1)
    cells.keep(job.path("gridworld", "aircl"), cell)
    assert cells.load(job) == {("gridworld", "aircl"): cell}


def test_a_cell_made_with_other_settings_or_code_is_named(job):
    cell = made(job, violation_rate=0.1)
    cell["settings"]["train"]["ppo"]["learning_rate"] = 0.1
    del cell["settings"]["train"]["pool"]  # as if pools were younger than the cell: without one is with one of 1
    with mock.patch.object(report, "changed_since", {"abc1234": True}.get):
        text = report.markdown(study(job, cell, made(job, method="bc", violation_rate=0.1)))
    assert "train.ppo.learning_rate is 0.1 there and 0.0005 here: gridworld/aircl" in text
    assert "train.pool" not in text
    assert "commit `abc1234` (the library has changed since): gridworld: aircl, bc" in text


def test_code_of_an_unknown_commit_cannot_be_compared():
    assert commits.changed_since("0000000") is None
    assert commits.changed_since("abc1234-dirty") is None


# The command


@pytest.mark.parametrize(
    ("words", "message"),
    [
        ("env=maze", "unknown env 'maze'; choose from gridworld, swimmer, walker, pendulum, or all"),
        ("method=gail,bc", "unknown method 'gail'; choose from airl"),
        ("scale=huge", "scale=huge is not one of full, smoke"),
        ("seeds=-1", "neither may be negative"),
        ("seeds=3", "not those of the full table (seeds=10, iterations=0)"),
        ("iterations=5 out=results/mine", "not those of the full table"),
        ("scale=smoke out=results", "scale=smoke makes no results"),
        ("speed=3", "unknown setting speed; choose from scale, env"),
        ("seeds", "cannot read 'seeds'"),
    ],
)
def test_a_mistake_is_one_line_exit_code_2_and_nothing_written(words, message, capsys):
    assert table1.main(words.split()) == 2
    printed = capsys.readouterr()
    assert message in printed.err and printed.err.count("\n") == 1 and printed.out == ""
    assert list(Path().iterdir()) == []


def test_a_smoke_cell_in_the_folder_of_results_is_refused(job, capsys):
    cells.keep(job.path("gridworld", "bc"), made(job, method="bc") | {"scale": "smoke"})
    assert table1.main(["out=mine"]) == 2
    assert "is of scale=smoke; choose another folder" in capsys.readouterr().err


def test_finished_cells_are_skipped_and_missing_ones_are_said_to_be(job):
    cells.keep(job.path("gridworld", "bc"), made(job, method="bc", violation_rate=0.25))
    before = job.path("gridworld", "bc").read_bytes()
    with (
        mock.patch.object(cells, "make_cell", side_effect=AssertionError("it was there")),
        mock.patch.object(cells, "unavailable", {"walker": "no demonstrations are shipped"}.get),
    ):
        assert table1.main(["out=mine", "env=gridworld", "method=bc"]) == 0
        assert table1.main(["out=mine", "env=walker"]) == 0
    assert job.path("gridworld", "bc").read_bytes() == before
    text = Path("mine/table1.md").read_text()
    assert "- no demonstrations are shipped: walker (all)" in text
    assert "- not trained yet: gridworld: airl, gacl" in text
    assert "| `bc` | 0.250 ± 0.000 [0.250, 0.250] | — |" in text
    kept = json.loads(Path("mine/table1.json").read_text())
    assert kept["cells"]["gridworld"]["bc"]["metrics"]["violation_rate"]["per_seed"] == [0.25] * SEEDS
    assert kept["paper"]["swimmer"]["airl"]["rc_acc"] == [0.5, 0.1]
    assert kept["missing"]["walker/aircl"] == "no demonstrations are shipped"


def test_a_refused_cell_is_named_and_the_others_go_on(capsys):
    def refuse(job, env, method, commit, overwrite):
        if method == "airl":
            raise ValueError("the run there is another one")
        cells.keep(job.path(env, method), made(job, env, method))

    with mock.patch.object(cells, "make_cell", refuse):
        assert table1.main(["out=mine", "env=gridworld", "method=airl,bc"]) == 2
    assert capsys.readouterr().err == "error: gridworld/airl: the run there is another one\n"
    assert Path("mine/cells/gridworld/bc.json").exists()
    assert "gridworld/airl: the run there is another one" in Path("mine/table1.md").read_text()


class Interrupting(cells.Reporter):
    """Stops the run after its first chunk, as Ctrl-C does."""

    def __call__(self, progress):
        if progress.iteration == 1:
            raise KeyboardInterrupt


def test_a_cut_smoke_cell_continues_and_its_command_is_the_same_run(capsys):
    words = ["scale=smoke", "env=gridworld", "method=bc", "iterations=2"]
    with mock.patch.object(cells, "Reporter", Interrupting):
        assert table1.main(words) == 130
    cell, directory = Path("runs/smoke/table1/cells/gridworld/bc.json"), Path("runs/smoke/table1/runs/gridworld/bc")
    assert not cell.exists() and (directory / "state" / "00000001").exists()

    assert table1.main(words) == 0
    assert [path.name for path in Path().iterdir()] == ["runs"]
    found = json.loads(cell.read_text())
    assert found["scale"] == "smoke" and found["seeds"] == [0, 1]
    assert found["curves"]["iteration"] == [1, 2]
    assert len((directory / "timing.jsonl").read_text().splitlines()) == 2  # of which the first is from before the cut
    for page in ("table1.md", "claims.md"):
        assert "says nothing about the methods" in Path("runs/smoke/table1", page).read_text()

    before = (directory / "summary.json").read_bytes()
    assert run.main([*shlex.split(found["command"])[3:], "resume=true"]) == 0  # refused where a setting differs
    assert (directory / "summary.json").read_bytes() == before


# Claims


def told(rule: Contrast | Bound | Harder, *given: dict[str, Any], job: Job) -> dict[str, str]:
    return {finding.what.split(":")[0]: finding.verdict for finding in rule.findings(study(job, *given))}


CONTRAST = Contrast("aircl", "airl", envs=("gridworld",))


def test_a_contrast_holds_where_the_paired_test_shows_it_and_not_where_it_shows_the_opposite(job):
    better = made(job, rc_acc=spread(0.9), violation_rate=spread(0.3))
    worse = made(job, method="airl", rc_acc=spread(0.5), violation_rate=spread(0.1))
    assert told(CONTRAST, better, worse, job=job) == {"rc_acc": "holds", "violation_rate": "does not hold"}


def test_a_contrast_that_is_not_shown_does_not_hold_only_where_the_papers_gain_is_excluded(job):
    signs = np.tile([1.0, -1.0], 5)  # the paper's gains: 0.204 of RCAcc, 0.024 of the violation rate
    one = made(job, rc_acc=0.5 + 0.01 * signs, violation_rate=0.1 + 0.1 * signs)
    other = made(job, method="airl", rc_acc=0.5, violation_rate=0.1)
    assert told(CONTRAST, one, other, job=job) == {"rc_acc": "does not hold", "violation_rate": "cannot be told"}


def test_two_seeds_and_missing_cells_tell_nothing(job):
    few = [made(job, method=method, seeds=2, rc_acc=0.5, violation_rate=0.1) for method in ("aircl", "airl")]
    assert set(told(CONTRAST, *few, job=job).values()) == {"cannot be told"}
    finding = CONTRAST.findings(study(job, few[0]))[0]
    assert (finding.verdict, finding.because) == ("cannot be told", "cells missing: airl")


@pytest.mark.parametrize(("centre", "verdict"), [(0.1, "holds"), (0.2, "cannot be told"), (0.3, "does not hold")])
def test_a_limit_is_judged_by_the_whole_interval(centre, verdict, job):
    rule = Bound("aircl", "violation_rate", {"gridworld": 0.2}, most=True)
    assert rule.findings(study(job, made(job, violation_rate=spread(centre))))[0].verdict == verdict


def test_harder_means_that_every_row_is_worse(job):
    def findings(*rates: float) -> list[Finding]:
        rows = zip(METHODS_OF_THE_PAPER, rates, strict=False)
        here = [made(job, "gridworld", name, violation_rate=rate) for name, rate in rows]
        there = [cell | {"env": "swimmer"} for cell in (made(job, "gridworld", name, violation_rate=0.2) for name in ROWS)]
        return Harder("gridworld", "swimmer").findings(study(job, *here, *there))

    assert [found.verdict for found in findings(*[0.3] * 8)] == ["holds"]
    assert [found.verdict for found in findings(*[0.3] * 7, 0.1)] == ["cannot be told"]
    assert [found.verdict for found in findings(*[0.3] * 4, *[0.1] * 4)] == ["does not hold"]
    assert [found.because for found in findings(*[0.3] * 7)] == [f"cells missing: {METHODS_OF_THE_PAPER[-1]}"]


def test_a_claim_needs_more_than_half_of_its_lines():
    lines = [Finding("gridworld", "", "", verdict) for verdict in ("holds", "holds", "does not hold", "cannot be told")]
    assert overall(lines) == "cannot be told"
    assert overall(lines[:3]) == "holds"
    assert overall(lines[2:3]) == "does not hold"


def test_a_passage_is_the_first_evaluation_beyond_the_value():
    iterations, curve = np.array([0, 10, 20, 30]), np.array([0.2, 0.12, 0.08, 0.01])
    assert convergence.passage(iterations, curve, 0.1).iteration == 20
    assert convergence.passage(iterations, curve, 0.2).iteration == 0
    assert convergence.passage(iterations, curve, 0.3).iteration is None
    assert convergence.passage(iterations, curve[::-1], 0.1).iteration == 20


@pytest.mark.parametrize(
    ("rates", "verdict"),
    [([0.16, 0.08, 0.01], "holds"), ([0.16, 0.09, 0.08], "does not hold"), ([0.03, 0.02, 0.01], "does not hold")],
)
def test_stopped_early_means_near_the_papers_values_before_the_end_alone(rates, verdict, job):
    cell = made(job, rc_acc=0.5)  # the paper: RCAcc 0.829 ± 0.026, violation rate 0.071 ± 0.036
    cell["curves"] = {
        "iteration": [0, 125, 250],
        "rc_acc": [[None] * SEEDS, [0.84] * SEEDS, [0.82] * SEEDS],
        "violation_rate": [[rate] * SEEDS for rate in rates],
    }
    assert convergence.near(cell, PAPER["gridworld"]["aircl"]).keys() == {125, 250}
    found = next(line for line in convergence.findings(study(job, cell)) if (line.env, line.what) == ("gridworld", "aircl"))
    assert found.verdict == verdict


def test_a_cell_without_curves_tells_nothing_of_stopping_early(job):
    found = convergence.findings(study(job, made(job) | {"curves": {"iteration": []}}))
    assert {line.verdict for line in found} == {"cannot be told"}


def test_without_cells_every_claim_says_that_they_are_missing(job):
    text = claims_report.markdown(study(job))
    verdicts = [line for line in text.splitlines() if line.endswith("** |")]
    assert len(verdicts) == len(claims.CLAIMS) + len(claims.OURS) + 3
    assert all("cannot be told: cells missing" in line for line in verdicts)


def test_rcacc_at_the_optimum_is_read_from_the_runs_that_ended_there(job):
    cell = made(job, rc_acc=np.linspace(0.1, 1, 10), balanced_acc=[0.5] * 5 + [0.9] * 5, logit_size=[0.1] * 2 + [3.0] * 8)
    text = claims.at_the_optimum(study(job, cell))
    assert "Of 10 runs (cells × seeds), 5 ended" in text
    assert "RCAcc 0.300 ± 0.158, from 0.100 to 0.500" in text
    assert "ended 2: RCAcc 0.150 ± 0.071" in text


def test_best_among_rows_without_the_reward_ignores_those_that_have_it(job):
    rates = dict.fromkeys(ROWS, 0.2) | {"icrl": 0.0, "aircl_corrected": 0.1}
    given = [
        made(job, method=name, violation_rate=spread(rate, 0.001 * (1 + i))) for i, (name, rate) in enumerate(rates.items())
    ]
    assert claims.best_without_reward(study(job, *given))[0].verdict == "holds"
    assert claims.best_without_reward(study(job, *given[:-1]))[0].verdict == "cannot be told"
