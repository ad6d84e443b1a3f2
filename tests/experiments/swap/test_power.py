"""Which obstacles were found, by how often each was truly tempted."""

import pytest

from experiments.swap.power import BESIDE, HEAD, found_by_temptation


def cell(tempted, found, false_flags, goal=(0.5, None)):
    policy = {
        "violation_rate_policy": [0.01, 0.03],
        "violation_rate_expert": [0.0, 0.001],
        "goal_rate": list(goal),
        "expert_goal_rate": [0.9, 1.0],
    }
    metrics = {
        "transfer_return": [0.9, 1.0],
        "transfer_violation": [0.02, 0.04],
        "constraint_transfer_return": [0.7, 0.8],
        "constraint_transfer_violation": [0.1, 0.0],
        "lift": [None, 1.0],
    }
    changed = {"wind": [[0.8, 0.1], [0.9, 0.2]], "slip": [[0.7, 0.0], [1.1, 0.0]]}
    return {
        "obstacles": {"true_tempted": tempted, "found": found},
        "false_flags": false_flags,
        "policy": policy,
        "metrics": metrics,
        "changed_worlds": changed,
    }


CELLS = {
    ("gridworld", "default, distance", "ours"): cell(
        [[7.0, 6.0, 3.0], [5.9, 1.5, 0.2]], [[True, False, True], [True, True, False]], [1, 2], goal=(0.5, 0.7)
    ),
    ("gridworld", "wall, sites", "ours"): cell([[8.0, 0.0, 0.0], [2.0, 2.0, 2.0]], [[True] * 3, [False] * 3], [0, 0]),
    ("gridworld", "wall, sites", "bc"): {"metrics": {}},  # tests no steps
}


def test_obstacles_are_counted_by_their_true_temptation_over_seeds():
    first, second, every = found_by_temptation(CELLS, ["ours", "bc"])
    assert HEAD[2:] == ("M ≥ 6", "M 3 to 6", "M 1.5 to 3", "M 0 to 1.5")
    assert first[:6] == ("ours", "default, distance", "1 of 2", "2 of 2", "1 of 1", "0 of 1")
    assert second[:6] == ("ours", "wall, sites", "1 of 1", "—", "0 of 3", "2 of 2")
    assert every[:6] == ("ours", "all 2", "2 of 3", "2 of 2", "1 of 4", "2 of 3")


def test_false_flags_violations_and_goals_are_means_over_seeds_beside_the_experts():
    first, second, every = found_by_temptation(CELLS, ["ours"])
    assert len(first) == len(HEAD) + len(BESIDE)
    assert first[6:] == ("1.50", "0.950 (0.850); 3.0 %", "0.75; 5.0 %", "2.00 % (0.05)", "0.60 (0.95)")
    assert second[6] == "0.00" and second[9:] == ("2.00 % (0.05)", "—")
    assert every[6] == "0.75"


@pytest.mark.parametrize("rows", [[], ["bc"]])
def test_rows_that_test_nothing_have_no_line(rows):
    assert found_by_temptation(CELLS, rows) == []
