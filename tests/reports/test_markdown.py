"""The Markdown writer, by hand."""

import pytest

from aircl_jax.reports.markdown import bullets, paragraphs, row, table


def test_a_table_is_a_head_a_rule_and_its_rows():
    assert table(("method", "n"), [("airl", 3), ("bc", "—")]) == "| method | n |\n|---|---|\n| airl | 3 |\n| bc | — |"


def test_a_table_without_rows_is_a_head_and_a_rule():
    assert table(("a", "b"), []) == "| a | b |\n|---|---|"


def test_an_empty_cell_is_one_space():
    assert table(("", "b", ""), [("a", "", "")]) == "| | b | |\n|---|---|---|\n| a | | |"


def test_a_bar_within_a_cell_does_not_end_it():
    assert row(("mean |V|", 1)) == "| mean \\|V\\| | 1 |"


def test_aligned_columns_have_one_width_in_which_a_combining_bar_counts_nothing():
    written = table(("x", "of δ̄"), [("long", "1")], aligned=True)
    assert written == "| x    | of δ̄ |\n|------|------|\n| long | 1    |"


@pytest.mark.parametrize("cells", [("a",), ("a", "b", "c")])
def test_a_row_of_another_length_is_refused(cells):
    with pytest.raises(ValueError, match="under a head of 2"):
        table(("a", "b"), [cells])


def test_lists_and_paragraphs():
    assert paragraphs("# A", bullets(["one", "two"])) == "# A\n\n- one\n- two\n"


def test_a_line_break_does_not_end_a_cell_and_dollars_are_no_formula():
    assert row(("two\nlines", r"$\frac$")) == r"| two lines | \$\frac\$ |"
