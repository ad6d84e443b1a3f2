"""Cells of learned rows on grids: what is trained, and what is kept of it."""

import numpy as np
import pytest

from experiments.swap import grid_cells
from tests.experiments.swap.test_swap import grid_study
from tests.finished_runs import untrained


def test_a_learned_row_of_a_grid_is_trained_with_the_settings_of_its_world(monkeypatch, tmp_path):
    seen = {}
    monkeypatch.setattr(grid_cells, "train", lambda env, method, **given: seen.update(given) or untrained("aircl_corrected"))
    monkeypatch.setattr(grid_cells, "measures", lambda options, one: {"flagged": float(one.forbids.sum())})
    monkeypatch.setattr(grid_cells, "by_world", lambda options, one: {"wind": (0.5, float("nan"))})
    cell = grid_cells.cell(grid_study(tmp_path), "wall, goal", "aircl_corrected")
    world = {"layout": "wall", "reward": "goal"}
    assert seen == {"seeds": 2, "first_seed": 0, "iterations": 4, "env_settings": world, "config": {}}
    assert cell["seeds"] == [0, 1] and len(cell["metrics"]["flagged"]) == 2
    assert cell["changed_worlds"] == {"wind": [[0.5, None], [0.5, None]]}


@pytest.mark.parametrize(("row", "config"), [("aircl_contrast", {}), ("aircl_contrast planned", {"learner": "exact"})])
def test_the_contrast_rows_have_ten_fresh_seeds_and_keep_what_they_found(monkeypatch, tmp_path, row, config):
    seen = {}
    monkeypatch.setattr(grid_cells, "train", lambda env, method, **given: seen.update(given) or untrained(method))
    monkeypatch.setattr(grid_cells, "measures", lambda options, one: {"flagged": float(one.forbids.sum())})
    monkeypatch.setattr(grid_cells, "by_world", lambda options, one: {"wind": (0.5, 0.5)})
    cell = grid_cells.cell(grid_study(tmp_path), "wall, goal", row)
    assert (seen["seeds"], seen["first_seed"], seen["config"]) == (10, 1000, config)
    assert np.array(cell["obstacles"]["true_tempted"]).shape == np.array(cell["obstacles"]["found"]).shape == (2, 1)
    found = np.array(cell["obstacles"]["found"]).sum(axis=1)
    assert cell["metrics"]["flagged"] == (found + cell["false_flags"]).tolist()
    assert set(cell["policy"]) == set(grid_cells.OF_THE_POLICY)
    assert cell["demonstrations"] == 70 and "dislikes" not in cell


def test_a_control_with_more_demonstrations_keeps_which_disliked_cells_were_flagged(monkeypatch, tmp_path):
    seen = {}
    monkeypatch.setattr(grid_cells, "train", lambda env, method, **given: seen.update(given) or untrained(method))
    monkeypatch.setattr(grid_cells, "measures", lambda options, one: {"flagged": float(one.forbids.sum())})
    monkeypatch.setattr(grid_cells, "by_world", lambda options, one: {"wind": (0.5, 0.5)})
    world = {"size": 3, "goal": [2, 2], "obstacles": [], "dislikes": [[1, 1], [0, 2]]}
    monkeypatch.setattr(grid_cells, "CONTROLS", {"dislikes": world})
    cell = grid_cells.cell(grid_study(tmp_path), "dislikes, 500 demonstrations", "aircl_contrast planned")
    assert seen["config"] == {"learner": "exact", "num_demonstrations": 500} and seen["env_settings"] == world
    assert cell["demonstrations"] == 500
    assert np.array(cell["dislikes"]["flagged"]).shape == np.array(cell["dislikes"]["entered"]).shape == (2, 2)
