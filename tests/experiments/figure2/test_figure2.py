"""`experiments.figure2` from a command line to its files: figures, numbers and words; bad input in one line."""

import json
import os
from pathlib import Path

import numpy as np
import pytest

from aircl_jax.figures.animals.ground_maps import Rows, regions
from experiments.figure2.__main__ import main
from experiments.figure2.analysis import nice_width

needs_data = pytest.mark.skipif(
    not (Path(os.environ.get("AIRCL_DATA", "absent")) / "meerkat").is_dir(),
    reason="AIRCL_DATA names no folder with meerkat/ in it",
)
FIGURES = {"2b_places", "2c_distances", "2d_mean_distance", "2e_frequency", "2g_codes", "7_activity", "8_places_rows"}


def test_the_simulated_mob_gives_every_figure_and_says_that_it_is_simulated(tmp_path):
    assert main(["data=simulated", f"out={tmp_path}", "draws=20"]) == 0
    assert {f"figure{name}.png" for name in FIGURES} <= {path.name for path in tmp_path.iterdir()}
    report = (tmp_path / "report.md").read_text()
    assert "SIMULATED" in report.splitlines()[0]
    assert "rows: 30,720" in report
    assert json.loads((tmp_path / "numbers.json").read_text())["command"].startswith("python -m experiments.figure2")


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["colour=red"], "unknown setting colour; choose from data"),
        (["draws=many"], "draws=many is not an integer"),
        (["coding=leap"], "coding=leap is not one of bout, step"),
        (["draws=0"], "draws begin at 1"),
        (["data=nowhere"], "env.data=nowhere: no such folder"),
        (["mapping=cats", "data=."], "unknown mapping 'cats'"),
    ],
)
def test_bad_input_is_one_line_and_exit_code_2(arguments, words, capsys, tmp_path):
    assert main([*arguments, f"out={tmp_path / 'out'}"]) == 2
    error = capsys.readouterr().err
    assert words in error
    assert error.count("\n") == 1
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(("width", "nice"), [(10_982.0, 10_000.0), (0.4, 0.5), (17.0, 20.0), (1.0, 1.0)])
def test_a_bin_is_one_two_or_five_times_a_power_of_ten(width, nice):
    assert nice_width(width) == pytest.approx(nice)


def test_a_cell_belongs_to_the_place_of_most_of_its_rows():
    position = np.array([[0.1, 0.1], [0.2, 0.2], [0.3, 0.3], [9.5, 0.5]])
    grid, extent = regions(Rows(position, np.array([1, 1, 0, 2])), cell=1.0, num_places=3)
    assert grid.shape == (1, 10)
    assert extent == (0.0, 10.0, 0.0, 1.0)
    assert grid[0].tolist() == [1, 1, -1, -1, -1, -1, -1, -1, 2, 2]


@needs_data
@pytest.mark.slow
def test_the_published_tables_do_not_support_the_inflexion(tmp_path):
    assert main([f"out={tmp_path}", "draws=500"]) == 0
    numbers = json.loads((tmp_path / "numbers.json").read_text())
    assert sum(numbers["histograms"]["without"]["counts"]) == 5286
    assert sum(numbers["histograms"]["with_missing"]["counts"]) == 5389
    assert min(test["p_monotone"] for test in numbers["rises"]["without"]) > 0.3
    assert "does not support" in (tmp_path / "report.md").read_text()
