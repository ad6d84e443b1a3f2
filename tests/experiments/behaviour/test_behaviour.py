"""`experiments.behaviour` on a made-up herd of another format: the truth is found, all files are written, input is checked."""

import json

import numpy as np
import pytest

from experiments.behaviour import __main__ as command
from experiments.behaviour.settings import Settings
from tests.animals.herds import FORBIDDEN, written_goats


@pytest.fixture(scope="module")
def written(tmp_path_factory):
    folder = tmp_path_factory.mktemp("goats")
    out = folder / "out"
    words = [*(f"{name}={value}" for name, value in written_goats(folder).items()), "halves=1", f"out={out}"]
    assert command.main(words) == 0
    return out


def test_the_card_names_what_is_wanted_and_what_is_avoided(written):
    card = json.loads((written / "card.json").read_text())
    assert [entry["what"] for entry in card["never"]] == [", then ".join(FORBIDDEN)]
    assert card["never"][0]["done"] == 0
    assert {"graze at hill", "rest at shade"} <= {entry["what"].partition(" (")[0] for entry in card["wants"]}
    assert "The tables count no neighbours: nothing is known of company." in card["cannot_tell"]
    assert card["separable"] is True


def test_the_page_holds_the_gain_and_every_figure_exists(written):
    page = (written / "report.md").read_text()
    for name in ("leaving_by_age", "reward_by_place", "expected_changes"):
        assert f"![{name}]({name}.png)" in page
        assert (written / f"{name}.png").stat().st_size > 5000
    numbers = json.loads((written / "numbers.json").read_text())
    whole = numbers["comparisons"]["every step of every segment"]
    assert whole["by_recording"]["won"] == 6
    assert whole["per_step"]["low"] > 0
    assert "windows" in numbers["comparisons"]


def test_what_was_recovered_is_kept_as_arrays(written):
    with np.load(written / "recovered.npz") as arrays:
        names = arrays["activities"].tolist()
        pair = names.index(FORBIDDEN[0]), names.index(FORBIDDEN[1])
        assert arrays["flagged"][pair]
        assert arrays["reward"].shape == (2, 3)
        assert arrays["leaving"].shape == arrays["leaving_names"].shape


@pytest.mark.parametrize(
    ("words", "line"),
    [
        (["env=goats"], "env=goats is not one of meerkat, labyrinth, mobs"),
        (["data=nowhere"], "env.data=nowhere: no such folder"),
        (["env=labyrinth", "mapping=goats.yaml"], "env=labyrinth mapping=goats.yaml: a mapping is of env=meerkat"),
        (["halves=-1"], "halves=-1 is not an integer of at least 0"),
        (["folds=3"], "unknown setting folds"),
    ],
)
def test_bad_input_is_one_line_and_exit_2(words, line, capsys):
    assert command.main(words) == 2
    error = capsys.readouterr().err
    assert line in error
    assert error.count("\n") == 1


def test_results_of_others_do_not_go_where_the_projects_own_are(monkeypatch, tmp_path):
    assert str(Settings(data="simulated").folder) == "runs/behaviour/meerkat_simulated"
    assert str(Settings(env="mobs").folder) == "results/behaviour/mobs"
    (tmp_path / "meerkat").mkdir()
    monkeypatch.setenv("AIRCL_DATA", str(tmp_path))
    assert str(Settings().folder) == "results/behaviour/meerkat"
    assert str(Settings(data=str(tmp_path)).folder) == "runs/behaviour/meerkat"
    assert str(Settings(coding="step").folder) == "runs/behaviour/meerkat_step"
    assert str(Settings(mapping="goats.yaml").folder) == "runs/behaviour/goats"
