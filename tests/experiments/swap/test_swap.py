"""results/swap: which cells a call makes, what each is trained on, and that a finished one is read and not made again."""

import json
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import jax
import numpy as np
import pytest

from aircl_jax.transfer import objectives
from aircl_jax.transfer.fresh import Fresh
from envs import make_env
from envs.options import GridOptions
from experiments.swap import __main__ as command
from experiments.swap import grid_cells, report, robot_cells
from experiments.swap.grid_cells import CONTROLS, MORE, WORLDS, GridStudy
from experiments.swap.robot_cells import Study, applies
from experiments.swap.robot_tests import TESTS
from tests.finished_runs import random_episodes, untrained_robot

EVERY_TEST = [(env, test) for env, tests in TESTS.items() for test in tests]
NAMED = {test.name: test for test in TESTS["swimmer"]}
RESULT = untrained_robot("aircl_corrected")
EPISODE = jax.tree.map(lambda leaf: leaf[0], random_episodes(RESULT.spec.env, 3, 1))


def study(out: Path, iterations: int = 0) -> Study:
    return Study(out, out / "runs", oracle_seeds=3, seeds=2, iterations=iterations)


@pytest.fixture
def asked(monkeypatch):
    """The cells that a call would make, in order."""
    cells = []
    monkeypatch.setattr(grid_cells, "cell", lambda study, world, row: cells.append((world, row)))
    monkeypatch.setattr(robot_cells, "cell", lambda study, world, row, test: cells.append((world, row, test.name)))
    monkeypatch.setattr(report, "write", lambda out, words: [])
    return cells


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["worlds=moon"], "unknown worlds 'moon'; choose from gridworld, swimmer, pendulum, walker, or all"),
        (["rows=best"], "unknown rows 'best'; choose from oracle"),
        (["seeds=two"], "seeds=two is not an integer"),
        (["iterations=5"], "results/swap has whole runs; choose out=DIR"),
        (["seeds=2"], "seeds=2 oracle_seeds=10 iterations=0: results/swap has whole runs"),
        (["oracle_seeds=9"], "oracle_seeds=9 iterations=0: results/swap has whole runs"),
        (["seeds=0", "out=elsewhere"], "seeds=0"),
        (["iterations=-1", "out=elsewhere"], "iterations=-1"),
    ],
)
def test_a_wrong_setting_is_one_line_and_2_and_nothing_is_made(words, said, asked, capsys):
    assert command.main(words) == 2
    printed = capsys.readouterr().err
    assert printed.startswith("error: ") and said in printed and printed.count("\n") == 1
    assert asked == []


def test_rows_on_grids_are_those_that_a_table_can_have_in_every_world_and_control(asked, tmp_path):
    assert command.main(["worlds=gridworld", f"out={tmp_path}"]) == 0
    assert asked == [(world, row) for row in command.ROWS_OF_GRIDS for world in grid_cells.worlds_of(row)]
    assert len(asked) == (15 + 3) * 9 + 12
    assert {row for world, row in asked if world in MORE} == {"aircl_contrast planned"}


def test_rows_on_a_robot_have_the_tests_that_they_can_have(asked, tmp_path):
    assert command.main(["worlds=swimmer", "rows=bc as it is,aircl_corrected,bc", f"out={tmp_path}"]) == 0
    names = [test.name for test in TESTS["swimmer"]]
    moved = [name for name in names if name == "S0" or name.startswith("S4")]
    expected = [("swimmer", "aircl_corrected", name) for name in names] + [("swimmer", "bc as it is", name) for name in moved]
    assert sorted(asked) == sorted(expected)


def test_without_training_no_cell_is_made(asked, tmp_path):
    assert command.main(["train=false", f"out={tmp_path}"]) == 0
    assert asked == []


@pytest.mark.parametrize(("env", "test"), EVERY_TEST, ids=[f"{env} {test.name}" for env, test in EVERY_TEST])
def test_the_settings_of_a_test_make_a_world_of_its_horizon(env, test):
    made, plain = make_env(env, **test.settings), make_env(env)
    assert (made.name, made.horizon, made.obs_size) == (env, plain.horizon, plain.obs_size)
    if "limit" in test.settings:
        assert made.limit is not None and made.limit.value == 0.3


def test_tests_have_names_and_files_of_their_own():
    for env, tests in TESTS.items():
        assert len({study(Path("out")).path(env, "oracle", test.name) for test in tests}) == len(tests)
    assert study(Path("out")).path("swimmer", "bc as it is", "S4 weak") == Path("out/swimmer/bc_as_it_is/S4_weak.json")
    grids = {GridStudy(Path("out"), 3, 0).path(world, "oracle") for world in (*WORLDS, *CONTROLS, *MORE)}
    assert len(grids) == 30


def test_which_rows_have_what_a_test_recombines():
    for row in ("oracle", "uniform", "random", "aircl_corrected"):
        assert all(applies(row, test) for test in NAMED.values())
    assert not any(applies("bc", test) for test in NAMED.values())
    assert [name for name, test in NAMED.items() if applies("gacl", test) and applies("icrl", test)] == ["S2"]
    assert [test.name for test in TESTS["walker"] if applies("icrl", test)] == ["S2 stand", "S2 back"]
    assert [name for name in ("S0", "S1", "S2", "S3", "S4 weak") if applies("bc as it is", NAMED[name])] == ["S0", "S4 weak"]


def parts(monkeypatch, row, test, result=RESULT):
    """(reward, cost) of the first two fresh seeds on one episode, where every run is this one."""
    trained = []
    monkeypatch.setattr(robot_cells, "_trained", lambda study, env, method: trained.append(method) or result)
    made = robot_cells._parts(study(Path("out")), "swimmer", row, test, 2, RESULT.spec.env)
    values = [np.array([jax.tree.map(lambda leaf, s=s: leaf[s], part)(EPISODE) for s in (0, 1)]) for part in made]
    return *values, trained


def learned(result=RESULT):
    return np.array([result.bound(seed).f(EPISODE) for seed in (0, 1)])


def charged():
    part = objectives.learned_cost(RESULT, 2)
    return np.array([jax.tree.map(lambda leaf, s=s: leaf[s], part)(EPISODE) for s in (0, 1)])


def of_the_world():
    return np.array([EPISODE.reward] * 2)


def cost_of_the_world():
    return np.array([EPISODE.cost] * 2)


def nothing():
    return np.zeros((2, 8))


@pytest.mark.parametrize(
    ("test", "reward", "cost"),
    [
        ("S0", learned, charged),
        ("S1", learned, charged),  # practice begins under it
        ("S2", of_the_world, charged),
        ("S3", learned, cost_of_the_world),
        ("S4 shape", learned, charged),
    ],
)
def test_a_learned_row_takes_its_parts_where_the_test_says_learned(test, reward, cost, monkeypatch):
    paid, charged_for, trained = parts(monkeypatch, "aircl_corrected", NAMED[test])
    np.testing.assert_allclose(paid, reward(), rtol=1e-5)
    np.testing.assert_array_equal(charged_for, cost())
    assert trained == ["aircl_corrected"]


@pytest.mark.parametrize("test", NAMED.values(), ids=list(NAMED))
def test_the_oracle_has_the_worlds_own_parts_and_needs_no_run(test, monkeypatch):
    paid, cost, trained = parts(monkeypatch, "oracle", test)
    np.testing.assert_array_equal(paid, of_the_world())
    np.testing.assert_array_equal(cost, cost_of_the_world())  # of f alone too: practice begins under it
    assert trained == []


def test_a_row_without_a_constraint_is_charged_nothing_for_a_learned_one(monkeypatch):
    airl = untrained_robot("airl_centred")
    paid, cost, _ = parts(monkeypatch, "airl_centred", NAMED["S0"], airl)
    np.testing.assert_allclose(paid, learned(airl), rtol=1e-5)
    np.testing.assert_array_equal(cost, nothing())
    np.testing.assert_array_equal(parts(monkeypatch, "airl_centred", NAMED["S3"], airl)[1], cost_of_the_world())


def test_a_random_reward_takes_the_place_of_the_learned_one_alone(monkeypatch):
    airl = untrained_robot("airl_centred")
    paid, cost, trained = parts(monkeypatch, "random", NAMED["S0"], airl)
    assert not np.allclose(paid[0], paid[1]) and not np.allclose(paid, learned(airl))
    np.testing.assert_array_equal(cost, cost_of_the_world())
    assert trained == ["airl_centred"]
    np.testing.assert_array_equal(parts(monkeypatch, "random", NAMED["S2"], airl)[0], of_the_world())


def swapped_by(monkeypatch, tmp_path, row, test, iterations=0):
    """What a cell would train, and the cell."""
    seen = {}

    def recombined(world, objective, seeds, config, constrained, motors):
        seen.update(world=world, seeds=list(seeds), config=config, constrained=constrained, motors=motors)
        history = {"return": np.arange(82.0).reshape(41, 2), "cost": np.zeros((41, 2))}
        return SimpleNamespace(metrics={"return": [1.0, 2.0]}, made=Fresh(cast(Any, None), cast(Any, None), None, history))

    monkeypatch.setattr(robot_cells, "recombine", recombined)
    monkeypatch.setattr(robot_cells, "_trained", lambda study, env, method: RESULT)
    return seen, robot_cells.cell(study(tmp_path, iterations), "swimmer", row, test)


def test_a_cell_says_what_it_is_of_and_is_read_the_second_time(monkeypatch, tmp_path):
    seen, cell = swapped_by(monkeypatch, tmp_path, "aircl_corrected", NAMED["S3"])
    assert (seen["seeds"], seen["constrained"]) == ([9000, 9001], True)
    np.testing.assert_allclose(seen["motors"][1], np.full((2, 2), 0.3), rtol=1e-6)
    assert seen["world"].limit.value == 0.3
    assert (cell["env"], cell["row"], cell["test"]) == ("swimmer", "aircl_corrected", "S3")
    assert cell["metrics"] == {"return": [1.0, 2.0]}
    assert cell["curve"]["iteration"] == list(range(0, 41, 2))
    assert cell["curve"]["return"][-1] == [80.0, 81.0]
    monkeypatch.setattr(robot_cells, "_measured", lambda *_: pytest.fail("it was made again"))
    assert robot_cells.cell(study(tmp_path), "swimmer", "aircl_corrected", NAMED["S3"]) == cell


def test_policies_without_a_constraint_have_seeds_and_settings_of_their_own(monkeypatch, tmp_path):
    seen, _ = swapped_by(monkeypatch, tmp_path, "oracle", NAMED["S1"])
    assert (seen["seeds"], seen["constrained"], seen["config"].release) == ([9300, 9301, 9302], False, 0.3)
    short, _ = swapped_by(monkeypatch, tmp_path, "oracle", NAMED["S0"], iterations=5)
    assert (short["config"].iterations, short["config"].release) == (5, 0.0)


def test_a_policy_as_it_is_is_that_of_the_run_without_the_words(monkeypatch, tmp_path):
    trained = []
    monkeypatch.setattr(robot_cells, "_trained", lambda study, env, method: trained.append(method) or RESULT)
    monkeypatch.setattr(robot_cells, "played", lambda world, act, number: (act, number))
    monkeypatch.setattr(robot_cells, "measure", lambda played: {"return": [float(len(trained) + played[1])]})
    cell = robot_cells.cell(study(tmp_path), "swimmer", "bc as it is", NAMED["S0"])
    assert trained == ["bc"]
    assert cell["metrics"] == {"return": [2.0, 2.0]}  # each learned seed once


def grid_study(out: Path) -> GridStudy:
    return GridStudy(out, seeds=2, iterations=4)


def test_the_oracle_of_a_grid_needs_no_training_and_is_read_the_second_time(monkeypatch, tmp_path):
    monkeypatch.setattr(grid_cells, "train", lambda *_, **__: pytest.fail("it was trained"))
    cell = grid_cells.cell(grid_study(tmp_path), "default, distance", "oracle")
    assert cell["metrics"]["transfer_return"] == [1.0] and cell["metrics"]["constraint_iou"] == [1.0]
    assert cell["metrics"]["lift"] == [None]  # undefined, and JSON has no NaN
    assert set(cell["changed_worlds"]) >= {"wind", "slip", "walls", "horizon"} and cell["changed_worlds"]["wind"] == [
        [1.0, 0.0]
    ]
    monkeypatch.setattr(grid_cells, "measures", lambda *_: pytest.fail("it was made again"))
    assert grid_cells.cell(grid_study(tmp_path), "default, distance", "oracle") == json.loads(json.dumps(cell))


def test_a_random_reward_of_a_grid_has_ten_draws_and_no_constraint(tmp_path):
    cell = grid_cells.cell(grid_study(tmp_path), "default, distance", "random")
    assert len(cell["seeds"]) == len(cell["metrics"]["self_return"]) == 10
    assert len(set(cell["metrics"]["self_return"])) == 10
    assert cell["metrics"]["constraint_iou"] == [None] * 10
    assert all(distance > 0.3 for distance in cell["metrics"]["reward_distance"])


def test_controls_are_the_default_grid_with_another_taste_or_lapses():
    assert CONTROLS["dislikes"]["dislikes"] == [[1, 1], [0, 4], [2, 3], [4, 1], [4, 4]]
    assert CONTROLS["dislikes"]["obstacles"] == []
    assert {CONTROLS[f"lapses of {share} %"]["lapse"] for share in (1, 5)} == {0.01, 0.05}
    assert GridOptions().lapse == 0.0
