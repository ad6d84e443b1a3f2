"""The studies of mice and of mobs write their pages from a few rounds, and a mob's numbers are counted against its truth."""

import json

import numpy as np
import pytest

from aircl_jax.animals.changes import avoided_changes
from aircl_jax.animals.going import ORDINARY, choices_of
from envs.animals.labyrinth import load
from envs.options import LabyrinthOptions
from experiments.behaviour import of_maze, of_mobs, summary
from experiments.behaviour.maze_study import study
from experiments.behaviour.settings import Settings


@pytest.fixture(scope="module")
def mice():
    whole = load(LabyrinthOptions(data="simulated"))
    return whole._replace(node=whole.node[:40, :60], action=whole.action[:40, :60])


@pytest.mark.slow
def test_a_study_of_mice_is_written_whole(mice, tmp_path, monkeypatch):
    monkeypatch.setattr(of_maze, "load", lambda _: mice)
    monkeypatch.setattr(of_maze, "study", lambda found: study(found, rounds=2, sizes=(4,)))
    of_maze.run(Settings(env="labyrinth", data="simulated", out=str(tmp_path / "labyrinth")), ["env=labyrinth"])
    page = (tmp_path / "labyrinth" / "report.md").read_text()
    assert "Simulated mice in the labyrinth: habits with places" in page
    assert "![modes](modes.png)" in page
    numbers = json.loads((tmp_path / "labyrinth" / "numbers.json").read_text())
    assert len(numbers["starts"]) == 40
    assert set(numbers["nats"]) == {"chain 1", "chain 2", "tuned chain", "modes"}
    assert json.loads((tmp_path / "labyrinth" / "card.json").read_text())["never"] == []
    summary.summarise(str(tmp_path))
    assert "less the tuned back-off chain" in tmp_path.with_suffix(".md").read_text()


def test_a_mobs_found_and_false_are_counted_against_its_truth():
    one = of_mobs.mob(0)
    assert one.forbidden.sum() == 69
    choices = choices_of(one.recordings, ORDINARY)
    found = avoided_changes(choices, one.recordings, choices.weighed(of_mobs.seen_in(one, 300, 0)), prior=0.15)
    numbers = of_mobs.judged(one, 300, 0, 1.0, 0.15)
    flagged = found.flagged & one.possible
    assert numbers["found of 69, flagged"] == (flagged & one.forbidden).sum() >= 15
    assert numbers["false, flagged"] == (flagged & ~one.forbidden).sum() <= 6
    assert 0.85 < numbers["AUROC, Bayes factor"] < 1
    assert numbers["AUROC, Bayes factor"] > numbers["AUROC, counting: −n / expected"]


def test_the_windows_that_are_seen_hold_all_their_changes_and_no_others():
    one = of_mobs.mob(0)
    steps = one.recordings.steps
    change = np.flatnonzero(steps.code != steps.following)
    weight = of_mobs.seen_in(one, 100, 3)
    windows = np.unique(steps.window[change[weight > 0]])
    assert len(windows) <= 100
    np.testing.assert_array_equal(weight > 0, np.isin(steps.window[change], windows))
