"""Learning curves: whether they have settled, and whether the paper's values are those of runs stopped early."""

import numpy as np
import pytest

from experiments.shared.paper import PAPER
from experiments.table1 import convergence
from tests.finished_runs import finished_cell, study_of

SEEDS = 10


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
def test_stopped_early_means_near_the_papers_values_before_the_end_alone(rates, verdict):
    cell = finished_cell(rc_acc=0.5)  # the paper: RCAcc 0.829 ± 0.026, violation rate 0.071 ± 0.036
    cell["curves"] = {
        "iteration": [0, 125, 250],
        "rc_acc": [[None] * SEEDS, [0.84] * SEEDS, [0.82] * SEEDS],
        "violation_rate": [[rate] * SEEDS for rate in rates],
    }
    assert convergence.near(cell, PAPER["gridworld"]["aircl"]).keys() == {125, 250}
    found = next(line for line in convergence.findings(study_of(cell)) if (line.env, line.what) == ("gridworld", "aircl"))
    assert found.verdict == verdict


def test_a_cell_without_curves_tells_nothing_of_stopping_early():
    found = convergence.findings(study_of(finished_cell() | {"curves": {"iteration": []}}))
    assert {line.verdict for line in found} == {"cannot be told"}


def test_a_passage_is_said_from_its_start_to_its_end():
    found = convergence.passage(np.array([0, 10, 20]), np.array([0.5, 0.2, 0.25]), 0.3)
    assert found.words == "0.500 → 0.250, passes at 10"
    assert convergence.passage(np.array([0, 10]), np.array([0.5, 0.4]), 0.3).words == "0.500 → 0.400, never passes"


def test_a_curve_is_the_mean_over_seeds_where_it_is_defined():
    cell = finished_cell(seeds=2) | {"curves": {"iteration": [0, 5, 10], "rc_acc": [[None, None], [0.2, 0.4], [0.5, 1.0]]}}
    iterations, mean = convergence.curve(cell, "rc_acc")
    assert iterations.tolist() == [5, 10]
    assert mean == pytest.approx([0.3, 0.75])


def test_near_is_within_one_standard_deviation_of_every_measure():
    rates, accuracies = [[0.19], [0.21], [0.28], [0.12]], [[0.5], [0.5], [0.5], [0.62]]
    curves = {"iteration": [0, 1, 2, 3], "violation_rate": rates, "rc_acc": accuracies}
    found = convergence.near(
        finished_cell(seeds=1) | {"curves": curves}, {"violation_rate": (0.2, 0.05), "rc_acc": (0.55, 0.06)}
    )
    assert found == {
        0: True,
        1: True,
        2: False,
        3: False,
    }  # 0.08 from a rate; 0.08 and 0.07 from both
    only = convergence.near(finished_cell(seeds=1) | {"curves": curves}, {"rc_acc": (0.55, 0.06)})
    assert only == {0: True, 1: True, 2: True, 3: False}


HALF = [[0.5, 0.5]] * 4 + [[0.2, 0.2]] * 2  # of a curve of eight evaluations, whose last two quarters are two each


@pytest.mark.parametrize(
    ("last", "word"),
    [
        ([[0.1, 0.1], [0.1, 0.1]], "no"),  # 0.1 down, and the seeds end at one place
        ([[0.1, 0.1], [0.0, 0.2]], "yes"),  # the seeds end 0.14 apart
        ([[0.1, 0.1], [0.09, 0.11]], "no"),  # 0.014 apart
        ([[0.196, 0.196], [0.196, 0.196]], "yes"),  # 0.004 down counts as none
        ([[0.19, 0.19], [0.19, 0.19]], "no"),
    ],
)
def test_a_curve_has_settled_where_its_last_two_quarters_differ_by_no_more_than_the_seeds(last, word):
    assert convergence.settled({"curves": {"violation_rate_policy": HALF + last}}) == word


def test_seven_evaluations_are_too_few_to_tell_whether_a_curve_has_settled():
    assert convergence.settled({"curves": {"violation_rate_policy": [[0.1, 0.1]] * 7}}) == "—"


def test_a_line_says_where_our_curves_pass_the_papers_values_and_when_they_are_near_them():
    cell = finished_cell()  # the paper: RCAcc 0.829 ± 0.026, violation rate 0.071 ± 0.036
    cell["curves"] = {
        "iteration": [0, 50, 125, 250],
        "rc_acc": [[0.6] * SEEDS, [0.84] * SEEDS, [0.83] * SEEDS, [0.82] * SEEDS],
        "violation_rate": [[rate] * SEEDS for rate in (0.16, 0.08, 0.06, 0.01)],
    }
    found = next(line for line in convergence.findings(study_of(cell)) if (line.env, line.what) == ("gridworld", "aircl"))
    assert found.measured == (
        "rc_acc 0.829: ours 0.600 → 0.820, passes at 50; violation_rate 0.071: ours 0.160 → 0.010, passes at 125; "
        "near first at 50, last at 125, of 250 iterations"
    )
