"""Check the columns of a table as text, and read them; the first bad row is refused with file, row, column and value."""

import re
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, NoReturn

import numpy as np
from jaxtyping import Bool, Float, Int

from envs.animals.columns import NUMBER, ColumnMapping
from envs.animals.rows.labels import Labels, constant
from envs.animals.tables import Table, read_pieces
from envs.animals.times import HALF_A_DAY, Kind, read_times

LONGEST_LABEL = 200  # characters; what is longer is no label, but a column of text
ABSENT = ("", "NA", "NaN", "nan")  # how tables write a coordinate that is missing

_COORDINATE = NUMBER.pattern
_VECTOR = re.compile(rf"\[{_COORDINATE};{_COORDINATE};{_COORDINATE}\]", re.ASCII)
_SET = re.compile(r"\{(?:[^;{}]+(?:;[^;{}]+)*)?\}")


class Checker:
    """Read the columns of one piece of a table; raise ValueError for the first bad row with file, row, column and value."""

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
            if name in table.repeated:
                raise ValueError(f"{table.file}: row 1, column {name!r}: more than one column has this name")
            if not table.columns[name]:
                raise ValueError(f"{table.file}: row 2: no rows below the header")
            if name not in self.coordinates and "" in table.columns[name]:
                self.fail(table.columns[name].index(""), name, "is empty")

    def fail(self, position: int, name: str, what: str) -> NoReturn:
        """Refuse the value at a position of a column."""
        value, row = self.table.columns[name][position], self.table.row[position]
        shown = repr(value if len(value) <= LONGEST_LABEL else value[:LONGEST_LABEL] + "…")
        raise ValueError(f"{self.table.file}: row {row}, column {name!r}: {shown} {what}")

    def _each(self, name: str, good: Callable[[str], Any], what: str) -> None:
        for position, text in enumerate(self.table.columns[name]):
            if not good(text):
                self.fail(position, name, what)

    def labels(self, name: str) -> Labels:
        labels = Labels.of(self.table.columns[name])
        long = labels.are(*(label for label in labels.names if len(label) > LONGEST_LABEL))
        if long.any():
            self.fail(int(long.argmax()), name, f"is longer than {LONGEST_LABEL} characters, and no label")
        return labels

    def members(
        self,
        ours: str,
        known: Sequence[str],
        excused: Bool[np.ndarray, " R"] | None = None,
        excuse: str = "",
    ) -> Labels:
        """Read a column of labels; the rows in `excused` may also have the label `excuse`."""
        name = self.names[ours]
        labels = self.labels(name)
        bad = ~labels.are(*known) if known else np.zeros(len(labels), dtype=bool)
        if excused is not None:
            bad &= ~(excused & labels.are(excuse))
        if bad.any():
            self.fail(int(bad.argmax()), name, f"is unknown; choose from {', '.join(known)}")
        return labels

    def times(self, ours: str, kind: Kind | None = None) -> tuple[Float[np.ndarray, " R"], Kind]:
        """Read a column of times, of that kind where it is known."""
        name = self.names[ours]
        return read_times(self.table.columns[name], lambda position, what: self.fail(position, name, what), kind)

    def stops(self, kind: Kind) -> Float[np.ndarray, " R"]:
        """Read the ends of bouts, which are written as their beginnings."""
        stops, found = self.times("stop")
        if found is not kind:
            self.fail(0, self.names["stop"], f"is {found.words}, and {self.names['time']!r} is not")
        return stops

    def positions(self, mapping: ColumnMapping) -> Float[np.ndarray, "R 3"]:
        """Read three coordinates: NaN where one is empty or the mapping marks them as missing, 0 for a third that it lacks."""
        if not self.coordinates:
            return constant(np.full(3, np.nan), len(self.table.row))
        position = np.zeros((len(self.table.row), 3))
        if isinstance(mapping.columns.get("coordinates"), str):
            name = self.coordinates[0]
            texts = self.table.columns[name]
            self._each(name, lambda text: text in ABSENT or _VECTOR.fullmatch(text), "is not [x;y;z]")
            position = np.array([[np.nan] * 3 if text in ABSENT else text[1:-1].split(";") for text in texts], dtype=np.float64)
        else:
            position[:, : len(self.coordinates)] = np.stack([self._coordinate(name) for name in self.coordinates], axis=1)
        if np.isinf(position).any():
            wrong = np.argwhere(np.isinf(position))[0]
            self.fail(int(wrong[0]), self.coordinates[min(int(wrong[1]), len(self.coordinates) - 1)], "is not a finite number")
        missing = np.isnan(position).any(axis=1)
        if mapping.missing_coordinates:
            missing |= (position[:, : len(mapping.missing_coordinates)] == mapping.missing_coordinates).all(axis=1)
        position[missing] = np.nan
        return position

    def _coordinate(self, name: str) -> Float[np.ndarray, " R"]:
        self._each(name, lambda text: text in ABSENT or NUMBER.fullmatch(text), "is not a number")
        return np.array([np.nan if text in ABSENT else float(text) for text in self.table.columns[name]])

    def set_sizes(self, ours: str) -> Int[np.ndarray, " R"]:
        """Read sets such as `{1;2}` as their numbers of members."""
        name = self.names[ours]
        self._each(name, _SET.fullmatch, "is not {a;b;…}")
        return np.array([0 if text == "{}" else text.count(";") + 1 for text in self.table.columns[name]], dtype=np.int32)


def row_of(file: Path, position: int) -> int:
    """Return the number of a table's row, given its position among all rows."""
    table, position = _piece(file, position)
    return int(table.row[position])


def refuse(file: Path, mapping: ColumnMapping, position: int, ours: str, what: str) -> NoReturn:
    """Refuse the value of a table at a position among all rows, where only all rows together show it."""
    table, position = _piece(file, position)
    checker = Checker(table, mapping)
    checker.fail(position, checker.names[ours], what)


def _piece(file: Path, position: int) -> tuple[Table, int]:
    """Find the piece of a table that has a row, and the row's position in it."""
    for table in read_pieces(file):
        if position < len(table.row):
            return table, position
        position -= len(table.row)
    raise ValueError(f"{file}: has changed while it was read; give the command again")


def passes_midnight(
    recording: Int[np.ndarray, " R"], individual: Int[np.ndarray, " R"], time: Float[np.ndarray, " R"]
) -> int | None:
    """Find the first row whose time of day begins anew within its track: the rows would come in another order."""
    order = np.lexsort((individual, recording))
    same = (np.diff(recording[order]) == 0) & (np.diff(individual[order]) == 0)
    again = order[1:][same & (np.diff(time[order]) < -HALF_A_DAY)]
    return int(again.min()) if len(again) else None
