"""Read what each animal's neighbours do at the same time, where a table names them and not only counts them."""

from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple, NoReturn

import numpy as np
from jaxtyping import Float

from envs.animals.columns import ColumnMapping
from envs.animals.tables import find_tables, read_table
from envs.animals.times import read_times
from envs.animals.tracks import Tracks

LEAST_FOUND = 0.5  # share of the named neighbours that must have a row of their own; else the names are no names

Key = tuple[str, str, float]  # (recording, individual, time)


class Neighbours(NamedTuple):
    """How many close and how many distant neighbours show each behaviour; the last column counts all others."""

    close: Float[np.ndarray, "R B"]
    distant: Float[np.ndarray, "R B"]


def read_neighbours(
    folder: Path, mapping: ColumnMapping, tracks: Tracks, rows: Tracks, behaviours: tuple[str, ...]
) -> Neighbours | None:
    """Count the behaviours of the neighbours of `rows` among all `tracks`; None where the tables do not name them."""
    columns = [mapping.columns.get(name) for name in ("close", "distant")]
    if not any(columns) or "stop" in mapping.columns:  # a bout's neighbours are those of its beginning alone
        return None
    index = {name: number for number, name in enumerate(behaviours)}
    shown = {key: index.get(label, len(index)) for key, label in zip(_keys(tracks), tracks.behaviour.tolist(), strict=True)}
    wanted = {key: row for row, key in enumerate(_keys(rows))}
    counts = np.zeros((2, len(rows.time), len(index) + 1))
    named = found = 0
    for file in find_tables(folder).tables:
        for key, sets in _sets(file, mapping, columns):
            row = wanted.get(key)
            if row is None:
                continue
            for kind, others in enumerate(sets):
                for other in others:
                    named += 1
                    behaviour = shown.get((key[0], other, key[2]))
                    if behaviour is not None:
                        found += 1
                        counts[kind, row, behaviour] += 1
    return Neighbours(*counts) if named and found >= LEAST_FOUND * named else None


def _keys(tracks: Tracks) -> Iterator[Key]:
    return zip(tracks.recording.tolist(), tracks.individual.tolist(), tracks.time.tolist(), strict=True)


def _sets(file: Path, mapping: ColumnMapping, columns: list[str | None]) -> Iterator[tuple[Key, list[list[str]]]]:
    """Read the key of each row and the names in its sets of close and of distant neighbours."""
    table = read_table(file).columns
    size = len(table[mapping.columns["individual"]])
    recording = [file.stem] * size if mapping.recording == "file" else table[mapping.recording]
    time, _ = read_times(table[mapping.columns["time"]], _refuse)
    keys = zip(recording, table[mapping.columns["individual"]], time.tolist(), strict=True)
    texts = zip(*(table[column] if column else [""] * size for column in columns), strict=True)
    for key, row in zip(keys, texts, strict=True):
        yield key, [[name for name in text.strip("{}").split(";") if name] for text in row]


def _refuse(position: int, what: str) -> NoReturn:
    raise ValueError(f"the time of row {position} {what}")
