"""Read what each animal's neighbours do at the same time, where a table names them and not only counts them."""

from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple, NoReturn

import numpy as np
from jaxtyping import Float, Int

from envs.animals.columns import ColumnMapping
from envs.animals.rows.labels import Labels
from envs.animals.tables import Table, find_tables, read_pieces
from envs.animals.times import Kind, read_times
from envs.animals.tracks import Tracks, new_track

LEAST_FOUND = 0.5  # share of the named neighbours that must have a row of their own; else the names are no names


class Neighbours(NamedTuple):
    """How many close and how many distant neighbours show each behaviour; the last column counts all others."""

    close: Int[np.ndarray, "R B"]
    distant: Int[np.ndarray, "R B"]


def read_neighbours(
    folder: Path, mapping: ColumnMapping, tracks: Tracks, rows: Tracks, behaviours: tuple[str, ...]
) -> Neighbours | None:
    """Count the behaviours of the neighbours of `rows` among all `tracks`; None where the tables do not name them."""
    columns = [mapping.columns.get(name) for name in ("close", "distant")]
    if not any(columns) or "stop" in mapping.columns:  # a bout's neighbours are those of its beginning alone
        return None
    shown = tracks.behaviour.recoded({name: number for number, name in enumerate(behaviours)}, len(behaviours))
    everybody, wanted = Finder(tracks), Finder(rows)
    counts = np.zeros((2, len(rows.time), len(behaviours) + 1), np.int16)
    named = found = 0
    for file in find_tables(folder).tables:
        for table, time in _pieces(file, mapping):
            recording, individual = _who(table, mapping)
            row = wanted.find(recording, individual, time)
            for kind, column in enumerate(columns):
                if column is None:
                    continue
                of, others = _members(table.columns[column])
                of, others = of[row[of] >= 0], others[row[of] >= 0]
                at = everybody.find(recording[of], others, time[of])
                named, found = named + len(at), found + int((at >= 0).sum())
                np.add.at(counts[kind], (row[of[at >= 0]], shown[at[at >= 0]]), 1)
    return Neighbours(*counts) if named and found >= LEAST_FOUND * named else None


class Finder:
    """Find the row of an individual at a time of a recording."""

    def __init__(self, tracks: Tracks) -> None:
        begins = np.flatnonzero(np.append(True, new_track(tracks)))
        pairs = zip(*(column[begins].texts().tolist() for column in (tracks.recording, tracks.individual)), strict=True)
        self.track = {pair: number for number, pair in enumerate(pairs)}
        self.times, when = np.unique(tracks.time, return_inverse=True)
        self.key = np.repeat(np.arange(len(begins)), np.diff(np.append(begins, len(tracks.time)))) * len(self.times) + when

    def find(self, recording: Labels, individual: Labels, time: Float[np.ndarray, " Q"]) -> Int[np.ndarray, " Q"]:
        """Return the row of each; −1 where there is none."""
        width = len(individual.names)
        pairs, which = np.unique(recording.index.astype(np.int64) * width + individual.index, return_inverse=True)
        names = [(recording.names[pair // width], individual.names[pair % width]) for pair in pairs.tolist()]
        track = np.array([self.track.get(name, -1) for name in names], np.int64)[which]
        when = np.minimum(np.searchsorted(self.times, time), len(self.times) - 1)
        row = np.minimum(np.searchsorted(self.key, key := track * len(self.times) + when), len(self.key) - 1)
        return np.where((track >= 0) & (self.times[when] == time) & (self.key[row] == key), row, -1)


def _pieces(file: Path, mapping: ColumnMapping) -> Iterator[tuple[Table, Float[np.ndarray, " Q"]]]:
    """Read a table piece by piece, with the times of its rows."""
    kind: Kind | None = None
    for table in read_pieces(file):
        time, kind = read_times(table.columns[mapping.columns["time"]], _refuse, kind)
        yield table, time


def _who(table: Table, mapping: ColumnMapping) -> tuple[Labels, Labels]:
    number = len(table.row)
    named = mapping.recording != "file"
    recording = Labels.of(table.columns[mapping.recording]) if named else Labels.same(table.file.stem, number)
    return recording, Labels.of(table.columns[mapping.columns["individual"]])


def _members(texts: list[str]) -> tuple[Int[np.ndarray, " M"], Labels]:
    """List the members of sets such as `{1;2}`: the position of the set, and the name."""
    sets = [[name for name in text.strip("{}").split(";") if name] for text in texts]
    of = np.repeat(np.arange(len(sets)), [len(names) for names in sets])
    return of, Labels.of(name for names in sets for name in names)


def _refuse(position: int, what: str) -> NoReturn:
    raise ValueError(f"the time of row {position} {what}")
