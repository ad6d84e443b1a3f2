"""Scores of the swap table by hand, and what the report and the figure make of them."""

import numpy as np
import pytest

from experiments.swap import figure, report
from experiments.swap.scores import finished_worlds, grid_score, load, robot_score, rows_of, worst_world


def robot(test, row, returns, violations=(0.0,)):
    metrics = {"return": list(returns), "violation_rate": list(violations)}
    return ("swimmer", test, row), {"env": "swimmer", "test": test, "row": row, "metrics": metrics, "commit": "abc"}


def grid(world, row, elsewhere=None, **metrics):
    cell = {"env": "gridworld", "world": world, "row": row, "metrics": metrics, "commit": "abc"}
    return ("gridworld", world, row), cell | {"changed_worlds": elsewhere or {}}


ROBOT = dict(
    [
        robot("S0", "oracle", [90.0, 110.0], [0.0, 0.0]),
        robot("S0", "uniform", [-10.0, 10.0]),
        robot("S0", "mine", [50.0, 70.0], [0.01, 0.03]),
        robot("S1", "oracle", [150.0, 170.0], [0.8, 1.0]),
        robot("S1", "uniform", [0.0]),
        robot("S1", "mine", [100.0, 160.0], [0.45, 0.45]),
    ]
)


def test_a_robots_score_lies_between_the_uniform_policy_and_the_oracle():
    score = robot_score(ROBOT, "swimmer", "S0", "mine")
    assert score is not None
    np.testing.assert_allclose((score.mean, score.violation, score.seeds), (0.6, 0.02, 2))
    np.testing.assert_allclose((score.low, score.high), (0.5, 0.7))


def test_of_f_alone_the_score_is_the_lift_over_the_constrained_oracle():
    score = robot_score(ROBOT, "swimmer", "S1", "mine")
    assert score is not None
    np.testing.assert_allclose(score.mean, ((100 - 100) / 60 + (160 - 100) / 60) / 2)
    np.testing.assert_allclose(score.violation, 0.45 / 0.9)


def test_a_missing_oracle_leaves_no_score():
    without = {key: cell for key, cell in ROBOT.items() if key != ("swimmer", "S1", "oracle")}
    assert robot_score(without, "swimmer", "S1", "mine") is None


def test_a_grids_score_averages_worlds_seed_by_seed():
    cells = dict(
        [
            grid("default, goal", "mine", self_return=[1.0, 0.0], self_violation=[0.2, 0.4], split=[None, 1.0]),
            grid("second, goal", "mine", self_return=[0.5, 0.5], self_violation=[0.0, 0.0], split=[1.0, 1.0]),
        ]
    )
    worlds = ["default, goal", "second, goal"]
    score = grid_score(cells, worlds, "self_return", "mine", "self_violation")
    assert score is not None
    np.testing.assert_allclose((score.mean, score.violation, score.seeds), (0.5, 0.15, 2))
    assert grid_score(cells, worlds, "split", "mine") is None  # undefined for one seed
    assert grid_score(cells, [*worlds, "third, goal"], "self_return", "mine") is None


def test_the_worst_world_is_the_least_mean_over_seeds():
    elsewhere = {"wind": [[0.9, 0.0], [0.1, 0.0]], "slip": [[0.6, 0.0], [0.6, 0.0]]}
    cells = dict([grid("default, goal", "mine", elsewhere)])
    assert worst_world(cells, ["default, goal"], "mine") == pytest.approx(0.5)


def test_worlds_count_once_every_row_has_its_cell():
    cells = dict([grid("default, goal", "oracle"), grid("default, goal", "mine"), grid("second, goal", "oracle")])
    assert finished_worlds(cells, "goal", ["oracle", "mine"]) == ["default, goal"]


def test_the_report_is_written_from_the_cells_alone(tmp_path):
    for (env, test, row), cell in ROBOT.items():
        report.keep(tmp_path / "swap" / env / row / f"{test}.json", cell)
    assert load(tmp_path / "swap").keys() == ROBOT.keys()
    written = report.write(tmp_path / "swap", "the command")
    assert [path.name for path in written] == ["swap.md", "swap.json", "swap.png"]
    words = written[0].read_text()
    assert "`the command`" in words and "90 110" in words
    assert all(path.stat().st_size > 100 for path in written)


def test_rows_outside_the_order_come_last():
    assert rows_of(ROBOT, "swimmer", ["uniform", "oracle", "absent"]) == ["uniform", "oracle", "mine"]


def test_the_lifts_violations_are_shown_as_a_multiple():
    words = report.markdown_of(ROBOT, "the command", "swap.png")
    assert "; ×0.50" in words and "; 2.00 %" in words


def test_without_cells_nothing_is_written(tmp_path):
    assert report.write(tmp_path, "the command") == []
    assert list(tmp_path.iterdir()) == []


def test_an_oracle_by_itself_is_drawn_only_where_there_is_nothing_else():
    alone = {key: cell for key, cell in ROBOT.items() if key[2] in ("oracle", "uniform")}
    beside = {("walker", *key[1:]): cell for key, cell in alone.items()}
    order = ("oracle", "uniform", "aircl_corrected")
    assert list(figure._panels(alone, order)) == ["swimmer"]
    assert list(figure._panels({**ROBOT, **beside}, order)) == ["swimmer"]
