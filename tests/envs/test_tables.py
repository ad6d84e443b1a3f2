"""Tables as people keep them: what is read, what is left out and said, and what is refused in one line."""

import csv
import io
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from envs import make_env
from envs.animals.columns import ColumnMapping, load_mapping
from envs.animals.herd import load
from envs.animals.tables import read_pieces
from envs.animals.tracks import read_folder
from envs.animals.windows import code_rows
from envs.options import MeerkatOptions

MAPPING = ColumnMapping("goats", {"time": "t", "individual": "goat", "behaviour": "act"})
ACTS = ("eat", "rest", "rest", "walk")
YAML = "columns: {time: t, individual: goat, behaviour: act}\n"
HEADER = ("t", "goat", "act")


def rows(number: int = 40, goats: str = "ab", step: float = 1.0, start: float = 0.0) -> list[tuple[object, ...]]:
    return [(start + step * index, goat, ACTS[index % 4]) for goat in goats for index in range(number)]


def text(header: tuple[str, ...], lines: Sequence[tuple[object, ...]]) -> str:
    out = io.StringIO()
    csv.writer(out, lineterminator="\n").writerows([header, *lines])
    return out.getvalue()


def herd(folder: Path, content: str = "", mapping: str = YAML, **settings):
    """The herd of one table, with its mapping beside it."""
    if content:
        (folder / "herd.csv").write_text(content, encoding="utf-8")
    (folder / "goats.yaml").write_text(mapping, encoding="utf-8")
    options = {"data": str(folder), "mapping": str(folder / "goats.yaml"), "horizon": 10} | settings
    return load(MeerkatOptions(**options))


def refused(folder: Path, content: str, words: str, mapping: str = YAML, **settings) -> str:
    with pytest.raises(ValueError, match=words) as caught:
        herd(folder, content, mapping, **settings)
    assert "\n" not in str(caught.value)
    return str(caught.value)


# Fields


def test_a_comma_too_many_at_the_end_of_each_row_is_refused_with_row_and_counts(tmp_path):
    content = text(HEADER, rows()).replace("\n", ",\n").replace("t,goat,act,", "t,goat,act")
    refused(tmp_path, content, r"herd\.csv: row 2: 4 fields where the header has 3, and the last of all 80 rows is empty")


@pytest.mark.parametrize("quoted", [True, False])
def test_row_names_without_a_name_are_left_out_as_r_writes_them(tmp_path, quoted):
    mark = '"' if quoted else ""
    lines = [f"{mark}{number}{mark},{','.join(map(str, row))}" for number, row in enumerate(rows(), 1)]
    found = herd(tmp_path, "\n".join(["t,goat,act", *lines]) + "\n")
    assert found.windows.report.rows == 80
    assert found.windows.names == ("rest", "eat", "walk")
    assert any("herd.csv, which are row names without a name" in line for line in found.account.lines)


def test_row_names_with_an_empty_name_are_a_column_like_any_other(tmp_path):
    lines = [(number, *row) for number, row in enumerate(rows(), 1)]
    assert herd(tmp_path, text(("", *HEADER), lines)).windows.names == ("rest", "eat", "walk")


def test_a_last_column_without_a_name_is_not_taken_for_row_names(tmp_path):
    content = text(HEADER, [(*row, "sunny") for row in rows()])
    refused(tmp_path, content, r"row 2: 4 fields where the header has 3 in all 80 rows, and the first is no row's name")


def test_a_row_that_is_longer_than_the_others_is_refused_where_it_is(tmp_path):
    content = text(HEADER, [*rows(), (99, "a", "eat", "x")])
    refused(tmp_path, content, r"row 82: 4 fields where the header has 3")


def test_a_name_that_two_columns_have_is_refused_where_it_is_used(tmp_path):
    refused(tmp_path, text(("t", "goat", "act", "act"), [(*row, "x") for row in rows()]), "more than one column has this name")
    assert herd(tmp_path, text((*HEADER, "note", "note"), [(*row, "x", "y") for row in rows()])).windows.report.rows == 80


def test_a_quoted_line_break_does_not_shift_the_numbers_of_rows(tmp_path):
    lines = [(*row, "two\nlines") for row in rows(2)] + [("soon", "a", "eat", "")]
    refused(tmp_path, text((*HEADER, "note"), lines), r"row 10, column 't': 'soon' is not a number")


@pytest.mark.parametrize("content", ["t,goat,act\n0,a,e\0t\n", "t,goat,act\n0,a,eat\n1,a," + "x" * 300 + "\n"])
def test_bytes_of_0_and_columns_of_text_are_no_labels(tmp_path, content):
    refused(tmp_path, content, r"row 2, column 3: not UTF-8 text \(byte 0x00\)|row 3, column 'act': .* is longer than 200")


# Files


def test_what_is_hidden_is_skipped_and_said(tmp_path):
    for place in (".ipynb_checkpoints/herd-checkpoint.csv", "__MACOSX/._herd.csv", "._herd.csv"):
        (tmp_path / place).parent.mkdir(exist_ok=True)
        (tmp_path / place).write_text(text(HEADER, rows()))
    (tmp_path / "LICENSE").write_text("free")
    found = herd(tmp_path, text(HEADER, rows()))
    assert found.windows.report.rows == 80
    assert "read: 1 table (herd.csv)" in found.account.lines
    assert any(line.startswith("not read: 3 hidden tables (") for line in found.account.lines)
    assert any(line.startswith("not read: 2 files of other kinds (LICENSE, goats.yaml)") for line in found.account.lines)


def test_a_folder_that_holds_hidden_tables_alone_says_so(tmp_path):
    (tmp_path / "._herd.csv").write_text(text(HEADER, rows()))
    refused(tmp_path, "", r"no table of tracks in or below it; .*; 1 are hidden and not read")


def test_a_folder_of_parquet_parts_is_one_table(tmp_path):
    folder = tmp_path / "herd.parquet"
    folder.mkdir()
    frame = pd.DataFrame(rows(), columns=HEADER)
    frame[:30].to_parquet(folder / "part-0.parquet")
    frame[30:].to_parquet(folder / "part-1.parquet")
    found = herd(tmp_path)
    assert (found.windows.report.rows, found.windows.report.recordings) == (80, 1)
    assert found.windows.report.segments == 2


def test_a_file_that_leads_nowhere_is_refused_by_name(tmp_path):
    (tmp_path / "gone.csv").symlink_to(tmp_path / "away")
    refused(tmp_path, "", r"gone\.csv: cannot be read")


def test_an_edited_table_and_an_edited_mapping_are_read_again(tmp_path):
    assert herd(tmp_path, text(HEADER, rows())).windows.report.rows == 80
    assert herd(tmp_path, text(HEADER, rows(30))).windows.report.rows == 60
    assert herd(tmp_path, mapping=YAML + "behaviours: [walk, eat, rest]\n").windows.names == ("walk", "eat", "rest")


# Coordinates and labels


@pytest.mark.parametrize("empty", ["", "NA", "nan"])
def test_empty_coordinates_are_missing_coordinates(tmp_path, empty):
    lines = [(*row, empty if row[0] == 3.0 else 1.5, 2) for row in rows()]
    mapping = YAML.replace("act}", "act, coordinates: [x, y]}")
    found = herd(tmp_path, text((*HEADER, "x", "y"), lines), mapping)
    assert found.windows.report.rows_without_coordinates == 2
    assert "masked: the coordinates of 2 rows, which are missing" in found.account.lines
    position = read_folder(tmp_path, load_mapping(str(tmp_path / "goats.yaml"))).tracks.position
    assert np.isnan(position[3]).all()
    assert position[2].tolist() == [1.5, 2.0, 0.0]


def test_an_empty_vector_is_a_missing_position(tmp_path):
    lines = [(*row, "" if row[0] == 3.0 else "[1;2;3]") for row in rows()]
    mapping = YAML.replace("act}", "act, coordinates: at}")
    assert herd(tmp_path, text((*HEADER, "at"), lines), mapping).windows.report.rows_without_coordinates == 2


def test_a_coordinate_beyond_every_number_is_refused(tmp_path):
    lines = [(*row, "1e999", 2) for row in rows()]
    mapping = YAML.replace("act}", "act, coordinates: [x, y]}")
    refused(tmp_path, text((*HEADER, "x", "y"), lines), r"row 2, column 'x': '1e999' is not a finite number", mapping)


def test_one_behaviour_alone_is_refused_before_anything_is_learned(tmp_path):
    content = text(HEADER, [(time, goat, "rest") for time, goat, _ in rows()])
    refused(tmp_path, content, r"column 'act': 'rest' is its only label; a world of codes needs at least 2")


def test_a_column_that_holds_no_labels_is_refused(tmp_path):
    content = text(HEADER, [(time, goat, f"{time}{goat}") for time, goat, _ in rows(150)])
    refused(tmp_path, content, r"column 'act': 300 codes \(.*\); choose a column of at most 200 labels")


def test_an_activity_that_moves_must_be_a_behaviour_of_the_tables(tmp_path):
    content = text((*HEADER, "patch"), [(*row, "hill") for row in rows()])
    mapping = YAML.replace("act}", "act, place: patch}") + "moving: wlak\n"
    refused(tmp_path, content, "moving: 'wlak' is no behaviour of the tables; choose from rest, eat, walk", mapping)


def test_animals_of_the_other_groups_may_do_what_no_other_does(tmp_path):
    lines = [(*row, "adult") for row in rows()] + [(time, "kid", "play", "young") for time, _, _ in rows(40, "a")]
    mapping = YAML.replace("act}", "act, group: age}") + "groups: [adult]\nother_groups: [young]\nno_behaviour: none\n"
    assert "play" in herd(tmp_path, text((*HEADER, "age"), lines), mapping, pups=True).windows.names
    only = [line for line in lines if line[3] == "young"]
    refused(tmp_path, text((*HEADER, "age"), only), "all 40 rows are of other_groups, young", mapping)


# What is said before training


def test_a_loss_of_more_than_half_of_the_rows_is_a_warning(tmp_path):
    found = herd(tmp_path, text(HEADER, [*rows(11, "a"), *rows(6, "bcd")]))
    assert found.windows.report.rows_used == 11
    assert "left out: 18 rows in segments of fewer than 11 rows" in found.account.lines
    assert found.account.warnings[0].startswith("62% of the rows are left out")
    recorded = make_env("meerkat", data=str(tmp_path), mapping=str(tmp_path / "goats.yaml"), horizon=10).recorded
    assert recorded is not None and recorded.warnings == found.account.warnings


def test_that_no_activity_begins_often_enough_to_be_ranked_is_said_before_training(tmp_path):
    lines = [(index, goat, "rest" if index < 20 else "eat") for goat in "abcd" for index in range(31)]
    found = herd(tmp_path, text(HEADER, lines))
    assert found.account.warnings == (
        "no activity begins 5 times in the windows (most often 'eat', 4 times), so that none is ranked",
    )


def test_a_good_table_warns_of_nothing_and_its_account_adds_up(tmp_path):
    found = herd(tmp_path, text(HEADER, rows(45)))
    assert found.account.warnings == ()
    assert found.account.lines[:4] == (
        "read: 1 table (herd.csv)",
        "rows: 90 of 2 animals by name, in 1 recording",
        "segments: 2 without a gap, of 2 tracks (an animal in a recording); the longest has 45 rows of step 1",
        "used: 82 rows in 8 windows of 10 steps",
    )
    assert "left out: 8 rows after the last window of a segment" in found.account.lines


def test_a_table_is_read_alike_whatever_its_line_ends(tmp_path):
    (tmp_path / "a.csv").write_bytes(text(HEADER, rows()).replace("\n", "\r").encode("utf-8-sig"))
    assert list(next(read_pieces(tmp_path / "a.csv")).columns) == list(HEADER)
    tracks = read_folder(tmp_path, MAPPING).tracks
    assert code_rows(tracks, replace(MAPPING, behaviours=("eat", "rest", "walk"))).code[:4].tolist() == [0, 1, 1, 2]
