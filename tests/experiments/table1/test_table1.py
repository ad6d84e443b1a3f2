"""`experiments.table1` from a command line to its files: what is trained, skipped, refused and continued."""

import json
import shlex
from pathlib import Path
from unittest import mock

import pytest

from experiments import run
from experiments.table1 import __main__ as table1
from experiments.table1 import cells
from experiments.table1.cells import COLUMNS, ROWS, Job
from tests.finished_runs import finished_cell

pytestmark = pytest.mark.usefixtures("no_figures")
SEEDS = 10


@pytest.fixture(autouse=True)
def elsewhere(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)


@pytest.fixture
def job() -> Job:
    return table1.job_of(table1.Settings(out="mine"))


def test_a_smoke_test_of_all_runs_every_method_on_the_grid_and_some_on_the_robots():
    every = table1.chosen_cells(table1.Settings(scale="smoke"))
    assert [method for env, method in every if env == "gridworld"] == list(ROWS)
    assert [method for env, method in every if env == "walker"] == ["airl", "aircl", "aircl_corrected", "aircl_contrast", "bc"]
    assert table1.chosen_cells(table1.Settings(scale="smoke", env="walker", method="icrl")) == [("walker", "icrl")]
    assert len(table1.chosen_cells(table1.Settings())) == len(COLUMNS) * len(ROWS)


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
    cells.keep(job.path("gridworld", "bc"), finished_cell(method="bc") | {"scale": "smoke"})
    assert table1.main(["out=mine"]) == 2
    assert "is of scale=smoke; choose another folder" in capsys.readouterr().err


def test_finished_cells_are_skipped_and_missing_ones_are_said_to_be(job):
    cells.keep(job.path("gridworld", "bc"), finished_cell(method="bc", violation_rate=0.25))
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


def test_the_claims_read_the_swap_cells_that_lie_beside_the_table():
    for row, returns in (("aircl_contrast", 88.0), ("oracle", 110.0), ("uniform", 10.0)):
        cell = {
            "env": "swimmer",
            "test": "S2",
            "row": row,
            "metrics": {"return": [returns] * SEEDS, "violation_rate": [0.0] * SEEDS},
        }
        cells.keep(Path(f"mine/swap/swimmer/{row}/S2.json"), cell)
    assert table1.main(["out=mine", "train=false"]) == 0
    line = "| swimmer | S2: share of what the truth earns ≥ 0.95 | 0.780 [0.780, 0.780], 10 seeds | does not hold |"
    assert line in Path("mine/claims.md").read_text()


def test_a_refused_cell_is_named_and_the_others_go_on(capsys):
    def refuse(job, env, method, commit, overwrite):
        if method == "airl":
            raise ValueError("the run there is another one")
        cells.keep(job.path(env, method), finished_cell(env, method))

    with mock.patch.object(cells, "make_cell", refuse):
        assert table1.main(["out=mine", "env=gridworld", "method=airl,bc"]) == 2
    assert capsys.readouterr().err == "error: gridworld/airl: the run there is another one\n"
    assert Path("mine/cells/gridworld/bc.json").exists()
    assert "gridworld/airl: the run there is another one" in Path("mine/table1.md").read_text()


class Interrupting(cells.Reporter):
    """Stops the run after its first chunk, as Ctrl-C does."""

    def on_chunk(self, iteration, states, rows, timing):
        if iteration == 1:
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
