"""A Parquet table is read in pieces: what is read, and what is refused, is as of the whole table."""

import numpy as np
import pandas as pd
import pytest

from envs.animals import tables
from envs.animals.columns import load_mapping
from envs.animals.neighbours import read_neighbours
from envs.animals.rows import cells
from envs.animals.rows.cells import cells_of
from envs.animals.rows.labels import Labels, constant, together
from envs.animals.tracks import read_folder

YAML = """columns: {time: t, individual: goat, behaviour: act, place: patch, coordinates: [x, y], close: near}
recording: day
"""


def frame(rows: int = 40) -> pd.DataFrame:
    """Two goats in two days, their rows in no order."""
    draws = np.random.default_rng(0)
    table = pd.DataFrame(
        {
            "day": np.repeat(["mon", "tue"], rows),
            "goat": np.tile(np.repeat([2, 10], rows // 2), 2),
            "t": np.tile(np.arange(rows // 2), 4),
            "act": draws.choice(["eat", "rest", "walk"], 2 * rows),
            "patch": draws.choice(["hill", "pond"], 2 * rows),
            "x": draws.normal(size=2 * rows),
            "y": 1.0,
            "near": np.tile(np.repeat(["{10}", "{2}"], rows // 2), 2),
        }
    )
    return table.sample(frac=1.0, random_state=1)


@pytest.fixture
def folder(tmp_path, monkeypatch):
    (tmp_path / "goats.yaml").write_text(YAML)
    monkeypatch.setattr(tables, "PIECE", 7)
    return tmp_path


def written(folder, table, name="goats.parquet"):
    for old in folder.glob("goats.[cp]*"):
        old.unlink()
    table.to_parquet(folder / name, row_group_size=30) if name.endswith("parquet") else table.to_csv(folder / name, index=False)
    return folder, load_mapping(str(folder / "goats.yaml"))


def texts(tracks):
    return [column.texts() if isinstance(column, Labels) else column for column in tracks]


def test_pieces_make_the_tracks_of_the_whole_table_and_their_neighbours(folder):
    pieces = list(tables.read_pieces(written(folder, frame())[0] / "goats.parquet"))
    assert max(len(piece.row) for piece in pieces) <= 7
    assert np.concatenate([piece.row for piece in pieces]).tolist() == list(range(1, 81))
    found = []
    for name in ("goats.parquet", "goats.csv"):
        where, mapping = written(folder, frame(), name)
        tracks = read_folder(where, mapping).tracks
        near = read_neighbours(where, mapping, tracks, tracks, ("eat", "rest", "walk"))
        assert near is not None
        found.append((*texts(tracks), *near))
    for one, other in zip(*found, strict=True):
        np.testing.assert_array_equal(one, other)
    others = {(day, t, goat): act for day, goat, t, act in frame()[["day", "goat", "t", "act"]].itertuples(index=False)}
    day, individual, time, close = found[0][0], found[0][2], found[0][4], found[0][-2]
    for row in range(80):
        act = others[day[row], time[row], 12 - int(individual[row])]
        assert close[row].tolist() == [*(act == name for name in ("eat", "rest", "walk")), 0]


@pytest.mark.parametrize(
    ("column", "value", "words"),
    [
        ("act", "", r"row 38, column 'act': '' is empty"),
        ("t", "one", r"row 38, column 't': 'one' is not a number"),
        ("t", "10:00:00", r"row 38, column 't': '10:00:00' is HH:MM:SS where the rows before have a number"),
        ("near", "{1;", r"row 38, column 'near': '{1;' is not {a;b;…}"),
        ("t", "again", r"row 38, column 't': '\d+' repeats a time of its track"),
    ],
)
def test_a_mistake_of_a_later_piece_is_refused_with_its_row(folder, column, value, words):
    table = frame().astype({"t": str})
    place = 37
    if value == "again":
        earlier, who = table[:place], (table.day.iloc[place], table.goat.iloc[place])
        value = next(time for day, goat, time in zip(earlier.day, earlier.goat, earlier.t, strict=True) if (day, goat) == who)
    table.iloc[place, table.columns.get_loc(column)] = value
    with pytest.raises(ValueError, match=words):
        read_folder(*written(folder, table))


def test_a_table_without_rows_and_one_that_is_cut_short_are_refused(folder):
    with pytest.raises(ValueError, match="row 2: no rows below the header"):
        read_folder(*written(folder, frame()[:0]))
    where, mapping = written(folder, frame())
    whole = (where / "goats.parquet").read_bytes()
    (where / "goats.parquet").write_bytes(whole[: len(whole) // 2])
    with pytest.raises(ValueError, match="no readable Parquet file"):
        read_folder(where, mapping)


def test_times_of_day_that_begin_anew_in_a_later_piece_are_refused(folder):
    (folder / "goats.yaml").write_text("columns: {time: t, individual: goat, behaviour: act}\nrecording: day\n")
    clock = [f"{(22 + hour) % 24:02}:00:00" for hour in range(10)]
    table = pd.DataFrame({"day": "mon", "goat": "2", "t": clock, "act": ["eat", "rest"] * 5})
    with pytest.raises(ValueError, match=r"row 3, column 't': '00:00:00' passes midnight"):
        read_folder(*written(folder, table))


def test_labels_keep_one_byte_a_row_and_one_label_for_all_rows_none():
    labels = Labels.of(["b", "a", "b"])
    assert (labels.names, labels.index.tolist(), labels.index.itemsize) == (("a", "b"), [1, 0, 1], 1)
    joined = Labels.joined([labels, Labels.same("c", 2)])
    assert joined.texts().tolist() == ["b", "a", "b", "c", "c"]
    assert joined.counts() == {"a": 1, "b": 2, "c": 2}
    assert joined[np.array([True, False, False, True, False])].texts().tolist() == ["b", "c"]
    assert joined.are("a", "c").tolist() == [False, True, False, True, True]
    same = together([Labels.same("c", 2), Labels.same("c", 10**9)])
    assert (len(same), same.index.strides) == (10**9 + 2, (0,))
    assert together([constant(np.full(3, np.nan), 2), constant(np.full(3, np.nan), 4)]).strides == (0, 8)


@pytest.mark.parametrize("dense", [1, 1 << 24])
def test_equal_rows_are_one_cell_in_the_order_of_their_values(dense, monkeypatch):
    monkeypatch.setattr(cells, "DENSE", dense)
    draws = np.random.default_rng(0)
    columns = [draws.integers(-1, 3, 200).astype(np.int8), draws.integers(100, 104, 200), np.zeros(200, np.int8)]
    found = cells_of(columns)
    rows = np.stack(columns, axis=1)
    values, first, of = np.unique(rows, axis=0, return_index=True, return_inverse=True)
    np.testing.assert_array_equal(rows[found.first], values)
    np.testing.assert_array_equal(found.first, first)
    np.testing.assert_array_equal(found.of, of.ravel())
