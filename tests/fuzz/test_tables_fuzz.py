"""A thousand tables, each changed in ways whose right outcome is known: read the same, or refused in one line."""

import csv
import io
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest

from envs.animals.columns import ColumnMapping
from envs.animals.rows.labels import Labels
from envs.animals.tracks import Tracks, read_folder
from envs.animals.windows import Windows, code_rows, cut_windows
from tests.fuzz.outcomes import Refused, outcome

CASES = 1200
HEADER = ["t", "goat", "act", "patch", "x", "y", "near", "note"]
COLUMNS = {"time": "t", "individual": "goat", "behaviour": "act", "place": "patch", "coordinates": ["x", "y"], "close": "near"}
MAPPING = ColumnMapping("goats", COLUMNS, behaviours=("eat", "rest", "walk"), places=("barn", "hill"), moving="walk")
USED = len(HEADER) - 1  # the last column is none of the mapping's
Random = np.random.Generator


@dataclass
class Sheet:
    """One table: rows of texts, how they are written, and the files beside it."""

    rows: list[list[str]]
    header: list[str] = field(default_factory=lambda: list(HEADER))
    end: str = "\n"
    before: bytes = b""
    after: str = ""
    quoting: int = csv.QUOTE_MINIMAL
    parquet: bool = False
    beside: dict[str, str] = field(default_factory=dict)

    def text(self) -> str:
        out = io.StringIO()
        csv.writer(out, lineterminator=self.end, quoting=self.quoting).writerows([self.header, *self.rows])  # pyright: ignore
        return out.getvalue() + self.after

    def write(self, folder: Path) -> None:
        for name, content in self.beside.items():
            (folder / name).parent.mkdir(parents=True, exist_ok=True)
            (folder / name).write_text(content)
        if self.parquet:
            pd.DataFrame(self.rows, columns=self.header).to_parquet(folder / "herd.parquet")
        else:
            (folder / "herd.csv").write_bytes(self.before + self.text().encode())


def sheet(random: Random) -> Sheet:
    rows = []
    for goat in ("bo", "el")[: random.integers(1, 3)]:
        act = random.choice(["eat", "rest", "walk"], size=12)
        patch = random.choice(["barn", "hill"], size=12)
        for t in range(12):
            near = "{" + ";".join(map(str, range(random.integers(3)))) + "}"
            x, y = (f"{value:.3f}" for value in random.normal(size=2))
            rows.append([str(t), goat, act[t], patch[t], x, y, near, random.choice(["", "a, b", 'said "so"', "ä"])])
    return Sheet(rows)


def read(folder: Path) -> Tracks:
    return read_folder(folder, MAPPING).tracks


def windows(folder: Path) -> Windows:
    tracks = read(folder)
    return cut_windows(code_rows(tracks, MAPPING), tracks, horizon=3)


# What changes nothing that is learned from.


def shuffled_rows(random: Random, of: Sheet) -> None:
    random.shuffle(of.rows)  # pyright: ignore


def shuffled_columns(random: Random, of: Sheet) -> None:
    order = random.permutation(len(of.header)).tolist()
    of.header = [of.header[place] for place in order]
    of.rows = [[row[place] for place in order] for row in of.rows]


def another_end(random: Random, of: Sheet) -> None:
    of.end = random.choice(["\r\n", "\r", "\n"])


def a_byte_order_mark(_: Random, of: Sheet) -> None:
    of.before = b"\xef\xbb\xbf"


def blank_lines(random: Random, of: Sheet) -> None:
    of.after = of.end * int(random.integers(1, 4)) + "," * int(random.integers(0, 5)) + of.end


def all_quoted(_: Random, of: Sheet) -> None:
    of.quoting = csv.QUOTE_ALL


def hidden_copies(_: Random, of: Sheet) -> None:
    names = (".ipynb_checkpoints/herd.csv", "__MACOSX/herd.csv", "._herd.csv", "notes.txt")
    of.beside = dict.fromkeys(names, "t,goat\n1")


def as_parquet(_: Random, of: Sheet) -> None:
    of.parquet = True


def another_column(random: Random, of: Sheet) -> None:
    of.header.append("more")
    of.rows = [[*row, str(random.integers(9))] for row in of.rows]


def written_otherwise(_: Random, of: Sheet) -> None:
    at = of.header.index("t")
    for row in of.rows:
        row[at] = f"+{row[at]}.0e0"


SAME: tuple[Callable[[Random, Sheet], None], ...] = (
    *(shuffled_rows, shuffled_columns, another_end, a_byte_order_mark, blank_lines, all_quoted, hidden_copies),
    *(as_parquet, another_column, written_otherwise),
)


# What must be refused.


def a_comma_at_each_end(_: Random, of: Sheet) -> None:
    of.rows = [[*row, ""] for row in of.rows]
    of.parquet = False


def a_longer_row(random: Random, of: Sheet) -> None:
    of.rows[random.integers(len(of.rows))].append("more")
    of.parquet = False


def a_cell(random: Random, of: Sheet, column: str, value: str) -> None:
    of.rows[random.integers(len(of.rows))][of.header.index(column)] = value


def an_empty_cell(random: Random, of: Sheet) -> None:
    a_cell(random, of, str(random.choice(["t", "goat", "act", "patch", "near"])), "")


def a_wrong_cell(random: Random, of: Sheet) -> None:
    bad = {
        "t": ["soon", "nan", "inf", "1e999", "1_0", "1,5", "12:30", "0x1", "--1", "１"],
        "act": ["Eat", "eat ", "sleep", "0"],
        "patch": ["pond", "BARN"],
        "x": ["east", "1e999", "1_0", "1,5", "[1;2;3]"],
        "near": ["{1;2", "1;2", "[]", "{;}", "2"],
    }
    column = str(random.choice(list(bad)))
    a_cell(random, of, column, str(random.choice(bad[column])))


def a_row_twice(random: Random, of: Sheet) -> None:
    of.rows.append(list(of.rows[random.integers(len(of.rows))]))


def a_column_less(random: Random, of: Sheet) -> None:
    of.header[of.header.index(str(random.choice(HEADER[:USED])))] = "other"


def a_name_twice(random: Random, of: Sheet) -> None:
    of.header[of.header.index("note")] = str(random.choice(HEADER[:USED]))
    of.parquet = False


def an_open_quote(_: Random, of: Sheet) -> None:
    of.after, of.parquet = '9,"bo', False


def another_encoding(random: Random, of: Sheet) -> None:
    of.before, of.parquet = bytes([int(random.choice([0xFF, 0xE4, 0x00]))]), False


def no_rows(_: Random, of: Sheet) -> None:
    of.rows = []


def another_table_of_the_same_name(_: Random, of: Sheet) -> None:
    of.beside = {"again/herd.csv": Sheet([row[:] for row in of.rows], list(of.header)).text()}


def another_step(_: Random, of: Sheet) -> None:
    at = of.header.index("t")
    for row in of.rows:
        row[at] = str(7 * float(row[at]))


WRONG: tuple[Callable[[Random, Sheet], None], ...] = (
    *(a_comma_at_each_end, a_longer_row, an_empty_cell, a_wrong_cell, a_row_twice, a_column_less, a_name_twice),
    *(an_open_quote, another_encoding, no_rows, another_table_of_the_same_name, another_step),
)


def same(one: Tracks, other: Tracks) -> bool:
    def alike(a: Any, b: Any) -> bool:
        a, b = (part.texts() if isinstance(part, Labels) else part for part in (a, b))
        return np.array_equal(a, b, equal_nan=np.asarray(a).dtype.kind == "f")

    return all(alike(a, b) for a, b in zip(one, other, strict=True))


@pytest.mark.slow
def test_a_changed_table_is_read_the_same_or_refused_in_one_line(tmp_path):
    number = 0
    for case in range(CASES):
        random = np.random.default_rng(case)
        of, folder = sheet(random), tmp_path / str(case)
        (folder / "before").mkdir(parents=True)
        (folder / "after").mkdir()
        of.write(folder / "before")
        changes = [SAME[place] for place in random.choice(len(SAME), int(random.integers(0, 4)), replace=False)]
        wrong = WRONG[random.integers(len(WRONG))] if case % 2 else None
        for change in changes:
            change(random, of)
        if wrong is not None:
            wrong(random, of)
        of.write(folder / "after")
        said = f"case {case}: {[change.__name__ for change in changes]}, {wrong and wrong.__name__}"
        found = outcome(lambda folder=folder: read(folder / "after"))
        if isinstance(found, Refused):
            assert wrong is not None and found.names("" if wrong is another_step else folder), f"{said}: {found.line}"
            number += 1
        else:
            assert wrong is None and same(read(folder / "before"), found), said
    print(f"{number} of {CASES} refused")
    assert number == CASES // 2


@pytest.mark.slow
def test_noise_in_a_table_is_refused_in_one_line_or_read_to_windows(tmp_path):
    file = tmp_path / "herd.csv"
    for case in range(CASES):
        random = np.random.default_rng(case)
        content = bytearray(sheet(random).text().encode())
        for _ in range(random.integers(1, 6)):
            at = int(random.integers(len(content)))
            content[at : at + int(random.integers(0, 9))] = random.choice([b",", b'"', b"\n", b"\xc3", b"9", b"{", b"", b"\t"])
        file.write_bytes(content)
        found = outcome(lambda: windows(tmp_path))
        assert not isinstance(found, Refused) or found.names(""), case
