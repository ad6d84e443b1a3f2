"""Read and validate tables of animal tracks (CSV, Parquet), in which a row is one animal at one time."""

import re
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, NamedTuple, NoReturn

import numpy as np
import pandas as pd
from jaxtyping import Float, Int, Shaped

from envs.animals.columns import ColumnMapping

SUFFIXES = (".csv", ".parquet")

_NUMBER = r"-?\d+\.?\d*(?:[eE][-+]?\d+)?"
_VECTOR = re.compile(rf"\[{_NUMBER};{_NUMBER};{_NUMBER}\]")
_SET = re.compile(r"\{(?:[^;{}]+(?:;[^;{}]+)*)?\}")


class Tracks(NamedTuple):
    """All rows, ordered by recording, individual and time. A position is NaN where the mapping marks it as missing."""

    recording: Shaped[np.ndarray, " R"]
    site: Shaped[np.ndarray, " R"]  # the camera
    individual: Shaped[np.ndarray, " R"]  # unique within its recording only
    group: Shaped[np.ndarray, " R"]
    time: Float[np.ndarray, " R"]
    behaviour: Shaped[np.ndarray, " R"]
    place: Shaped[np.ndarray, " R"]
    position: Float[np.ndarray, "R 3"]
    close: Int[np.ndarray, " R"]  # number of close neighbours
    distant: Int[np.ndarray, " R"]

    def take(self, rows: Shaped[np.ndarray, " Q"]) -> "Tracks":
        return Tracks(*(column[rows] for column in self))


class Table(NamedTuple):
    """One file as text, whose rows are numbered as in the file: a CSV's header is row 1."""

    file: Path
    row: Int[np.ndarray, " R"]
    columns: dict[str, list[str]]


def read_folder(folder: Path, mapping: ColumnMapping) -> Tracks:
    """Read every table in and below `folder`. Raises ValueError where none exists, one is malformed or two overlap."""
    files = sorted(file for file in folder.rglob("*") if file.suffix.lower() in SUFFIXES)
    if not files:
        raise ValueError(f"{folder}: no table of tracks in or below it; looked for {', '.join(SUFFIXES)}")
    parts = [parse(read_table(file), mapping) for file in files]
    seen: dict[str, Path] = {}
    for file, part in zip(files, parts, strict=True):
        for recording in np.unique(part.recording).tolist():
            if seen.setdefault(recording, file) != file:
                raise ValueError(f"{file}: recording {recording!r} is also in {seen[recording]}")
    return Tracks(*(np.concatenate(columns) for columns in zip(*parts, strict=True)))


def read_table(file: Path) -> Table:
    """Read one CSV (UTF-8, any line ends) or Parquet file. Raises ValueError naming file and row where it cannot be read."""
    table = _read_parquet(file) if file.suffix.lower() == ".parquet" else _read_csv(file)
    columns = {str(name): ["" if text is pd.NA else str(text) for text in table[name].tolist()] for name in table}
    return Table(file, table.index.to_numpy(dtype=np.int64), columns)


def _read_parquet(file: Path) -> pd.DataFrame:
    try:
        table = pd.read_parquet(file).reset_index(drop=True).astype("string")
    except (OSError, ValueError, ImportError) as error:
        raise ValueError(f"{file}: no readable Parquet file: {str(error).splitlines()[0]}") from None
    table.index = pd.RangeIndex(1, len(table) + 1)
    return table


def _read_csv(file: Path) -> pd.DataFrame:
    content = file.read_bytes()
    try:
        content.decode("utf-8")
    except UnicodeDecodeError as error:
        row = content.count(b"\n", 0, error.start) + 1
        column = content.count(b",", content.rfind(b"\n", 0, error.start) + 1, error.start) + 1
        byte = f"byte {content[error.start]:#04x}"
        raise ValueError(f"{file}: row {row}, column {column}: not UTF-8 text ({byte})") from None
    if not content.strip():
        raise ValueError(f"{file}: row 1: the file is empty")
    try:
        table = pd.read_csv(file, dtype="string", keep_default_na=False, encoding="utf-8-sig", skip_blank_lines=False)
    except pd.errors.ParserError as error:
        raise ValueError(f"{file}: {_parser_words(str(error))}") from None
    table.index = pd.RangeIndex(2, len(table) + 2)
    blank = table.fillna("").eq("").to_numpy().all(axis=1)
    return table.iloc[np.flatnonzero(~blank)]


def _parser_words(message: str) -> str:
    """Translate pandas' message on a CSV that it cannot split, with the row in the file."""
    if match := re.search(r"Expected (\d+) fields in line (\d+), saw (\d+)", message):
        return f"row {match[2]}: {match[3]} fields where the header has {match[1]}"
    if match := re.search(r"EOF inside string starting at row (\d+)", message):
        return f"row {int(match[1]) + 1}: a quote is opened and never closed"
    return " ".join(message.split())


def parse(table: Table, mapping: ColumnMapping) -> Tracks:
    """Read our columns of one table. Raises ValueError, in one line with file, row and column, for the first bad value."""
    check = _Checker(table, mapping)
    number = len(table.row)
    blank = np.full(number, "")
    recording = np.full(number, table.file.stem)
    if mapping.recording != "file":
        recording = np.array(table.columns[mapping.recording])
    sites = {name: re.search(mapping.site, name) if mapping.site else None for name in np.unique(recording).tolist()}
    group = check.members("group", mapping.groups + mapping.other_groups) if "group" in check.names else blank
    behaviour_free = np.isin(group, mapping.other_groups) if mapping.other_groups else np.zeros(number, dtype=bool)
    tracks = Tracks(
        recording=recording,
        site=np.array([match[1] if (match := sites[name]) else "" for name in recording.tolist()]),
        individual=np.array(table.columns[check.names["individual"]]),
        group=group,
        time=check.numbers(check.names["time"]),
        behaviour=check.members("behaviour", mapping.behaviours, behaviour_free, mapping.no_behaviour),
        place=check.members("place", mapping.places) if "place" in check.names else blank,
        position=check.positions(mapping),
        close=check.set_sizes("close") if "close" in check.names else np.zeros(number, dtype=np.int64),
        distant=check.set_sizes("distant") if "distant" in check.names else np.zeros(number, dtype=np.int64),
    )
    order = np.lexsort((tracks.time, tracks.individual, tracks.recording))
    tracks = tracks.take(order)
    again = np.append(False, np.all([column[1:] == column[:-1] for column in tracks[:1] + tracks[2:3] + tracks[4:5]], 0))
    if again.any():
        check.fail(int(order[again].min()), check.names["time"], "repeats a time of its track")
    return tracks


class _Checker:
    """Read the columns of one table; raise ValueError for the first bad row with file, row, column and value."""

    def __init__(self, table: Table, mapping: ColumnMapping) -> None:
        self.table = table
        self.names: dict[str, str] = {ours: name for ours, name in mapping.columns.items() if ours != "coordinates"}
        coordinates = mapping.columns.get("coordinates", ())
        self.coordinates = [coordinates] if isinstance(coordinates, str) else list(coordinates)
        extra = [] if mapping.recording == "file" else [mapping.recording]
        for name in [*self.names.values(), *self.coordinates, *extra]:
            if name not in table.columns:
                has = ", ".join(table.columns)
                raise ValueError(f"{table.file}: row 1, column {name!r}: missing; the file has {has}")
            if not table.columns[name]:
                raise ValueError(f"{table.file}: row 2: no rows below the header")
            self._each(name, lambda text: text != "", "is empty")

    def fail(self, position: int, name: str, what: str) -> NoReturn:
        """Refuse the value at a position of a column."""
        value, row = self.table.columns[name][position], self.table.row[position]
        raise ValueError(f"{self.table.file}: row {row}, column {name!r}: {value!r} {what}")

    def _each(self, name: str, good: Callable[[str], Any], what: str) -> None:
        for position, text in enumerate(self.table.columns[name]):
            if not good(text):
                self.fail(position, name, what)

    def members(
        self,
        ours: str,
        known: Sequence[str],
        excused: Shaped[np.ndarray, " R"] | None = None,
        excuse: str = "",
    ) -> Shaped[np.ndarray, " R"]:
        """Read a column of labels; the rows in `excused` may also have the label `excuse`."""
        name = self.names[ours]
        values = np.array(self.table.columns[name])
        bad = ~np.isin(values, known) if known else np.zeros(len(values), dtype=bool)
        if excused is not None:
            bad &= ~(excused & (values == excuse))
        if bad.any():
            self.fail(int(bad.argmax()), name, f"is unknown; choose from {', '.join(known)}")
        return values

    def numbers(self, name: str) -> Float[np.ndarray, " R"]:
        self._each(name, _is_number, "is not a number")
        return np.array(self.table.columns[name], dtype=np.float64)

    def positions(self, mapping: ColumnMapping) -> Float[np.ndarray, "R 3"]:
        """Read three coordinates: NaN where the mapping marks them as missing or has none, 0 for a third that it lacks."""
        position = np.full((len(self.table.row), 3), np.nan)
        if isinstance(mapping.columns.get("coordinates"), str):
            name = self.coordinates[0]
            self._each(name, _VECTOR.fullmatch, "is not [x;y;z]")
            position = np.array([text[1:-1].split(";") for text in self.table.columns[name]], dtype=np.float64)
        elif self.coordinates:
            position[:] = 0.0
            position[:, : len(self.coordinates)] = np.stack([self.numbers(name) for name in self.coordinates], axis=1)
        if mapping.missing_coordinates:
            marked = position[:, : len(mapping.missing_coordinates)] == mapping.missing_coordinates
            position[marked.all(axis=1)] = np.nan
        return position

    def set_sizes(self, ours: str) -> Int[np.ndarray, " R"]:
        """Read sets such as `{1;2}` as their numbers of members."""
        name = self.names[ours]
        self._each(name, _SET.fullmatch, "is not {a;b;…}")
        return np.array([0 if text == "{}" else text.count(";") + 1 for text in self.table.columns[name]], dtype=np.int64)


def _is_number(text: str) -> bool:
    try:
        return bool(np.isfinite(float(text)))
    except ValueError:
        return False
