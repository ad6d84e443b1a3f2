"""Kept cells: what is none is named, and made anew when it is removed."""

import json

import pytest

from experiments.shared.kept_files import keep, read_kept

CELL = {"seeds": [0, 1], "metrics": {"return": {"per_seed": [1.0, None]}}, "alarms": ["δ̄ is silent"]}


def test_a_cell_is_read_as_it_was_kept(tmp_path):
    keep(tmp_path / "env" / "cell.json", CELL)
    assert read_kept(tmp_path / "env" / "cell.json", "seeds", "metrics.return.per_seed") == CELL


@pytest.mark.parametrize(
    ("old", "new"), [("[1.0, null]", "[1.5, null]"), ("[0, 1]", "[0, 2]"), ("silent", "silens"), ("seeds", "seedz")]
)
def test_a_change_within_a_cell_is_noticed_by_its_digest(old, new, tmp_path):
    keep(tmp_path / "cell.json", CELL)
    text = (tmp_path / "cell.json").read_text()
    assert text.count(old) == 1
    (tmp_path / "cell.json").write_text(text.replace(old, new))
    with pytest.raises(ValueError, match=r"cell.json is damaged; restore or remove it"):
        read_kept(tmp_path / "cell.json")


def test_another_layout_and_a_cell_from_before_digests_are_read(tmp_path):
    keep(tmp_path / "cell.json", CELL)
    again = json.loads((tmp_path / "cell.json").read_text())
    (tmp_path / "cell.json").write_text(json.dumps(dict(reversed(again.items())), indent=4))
    assert read_kept(tmp_path / "cell.json") == CELL
    (tmp_path / "cell.json").write_text(json.dumps(CELL))
    assert read_kept(tmp_path / "cell.json") == CELL


@pytest.mark.parametrize("name", ["metrics.goal_rate", "metrics.return.mean", "alarms.first"])
def test_a_cell_without_a_number_that_is_asked_for_is_damaged(name, tmp_path):
    keep(tmp_path / "cell.json", CELL)
    with pytest.raises(ValueError, match=r"cell.json is damaged"):
        read_kept(tmp_path / "cell.json", "metrics.return.per_seed", name)


@pytest.mark.parametrize("text", ["", "[]", "null", '{"seeds": [0', '{"seeds": []}', "\x00", "[" * 100_000])
def test_what_is_no_cell_is_named_in_one_line(text, tmp_path):
    (tmp_path / "cell.json").write_text(text)
    with pytest.raises(ValueError, match=rf"^{tmp_path}/cell.json is damaged; restore or remove it, and the same command"):
        read_kept(tmp_path / "cell.json", "seeds", "metrics")
