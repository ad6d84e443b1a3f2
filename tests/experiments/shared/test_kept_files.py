"""Kept cells: what is none is named, and made anew when it is removed."""

import pytest

from experiments.shared.kept_files import keep, read_kept


def test_a_cell_is_read_as_it_was_kept(tmp_path):
    cell = {"seeds": [0, 1], "metrics": {"return": {"per_seed": [1.0, None]}}, "alarms": ["δ̄ is silent"]}
    keep(tmp_path / "env" / "cell.json", cell)
    assert read_kept(tmp_path / "env" / "cell.json", "seeds", "metrics") == cell


@pytest.mark.parametrize("text", ["", "[]", "null", '{"seeds": [0', '{"seeds": []}', "\x00", "[" * 100_000])
def test_what_is_no_cell_is_named_in_one_line(text, tmp_path):
    (tmp_path / "cell.json").write_text(text)
    with pytest.raises(ValueError, match=rf"^{tmp_path}/cell.json is damaged; restore or remove it, and the same command"):
        read_kept(tmp_path / "cell.json", "seeds", "metrics")
