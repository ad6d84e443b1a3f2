"""Load the windows of a herd from a folder of tables, or from simulated meerkats, and keep those of the last settings."""

import hashlib
from collections.abc import Mapping
from functools import lru_cache
from pathlib import Path
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool

from envs.animals import simulated_meerkats
from envs.animals.account import Account, account
from envs.animals.columns import ColumnMapping, load_mapping, mapping_file
from envs.animals.data_folder import data_folder
from envs.animals.tables import Found, contents, find_tables
from envs.animals.tracks import Reading, read_folder
from envs.animals.windows import Coded, Windows, code_rows, cut_windows
from envs.options import MeerkatOptions

MOST_CODES = 200  # a world of more needs tables of their cube; a column of so many labels is a column of something else


class Herd(NamedTuple):
    """The windows of one data set; `truth` is None for real animals."""

    windows: Windows
    truth: simulated_meerkats.Truth | None
    impossible: Bool[np.ndarray, "C C"]  # [from code, to code] that cameras and coding rule out
    account: Account


def load(options: MeerkatOptions) -> Herd:
    """Read, validate, code and cut the tables, or simulate them.

    Raises ValueError as `envs.animals.tracks` does, and for a bad setting.
    """
    options = options.resolved()
    if options.horizon < 1:
        raise ValueError(f"env.horizon={options.horizon}: an episode needs at least 1 step")
    folder = data_folder(options.data, "meerkat")
    if folder is None and options.mapping != MeerkatOptions.mapping:
        raise ValueError(f"env.mapping={options.mapping} has no tables to read; give env.data=DIR, or set AIRCL_DATA")
    return _load(options, folder, "" if folder is None else digest(folder, options.mapping))


def held_out_pair(site: Mapping[str, str], fold: int) -> tuple[str, str]:
    """List the recordings of fold k of R // 2: k and k + R // 2 in order of site and name, given each recording's site.

    They come from different sites where two sites have equally many. Raises ValueError for a fold that does not exist.
    """
    ordered = sorted(site, key=lambda recording: (site[recording], recording))
    folds = len(ordered) // 2
    if len(ordered) < 3:
        raise ValueError(f"{len(ordered)} recordings cannot be split: two are held out and one must be left to learn from")
    if not 0 <= fold < folds:
        raise ValueError(f"env.fold={fold}: {len(ordered)} recordings give folds 0 to {folds - 1}")
    return ordered[fold], ordered[fold + folds]


def digest(folder: Path, mapping: str) -> str:
    """Digest what a herd is read from, so that an edited file is read again."""
    found, read = find_tables(folder), hashlib.sha256()
    read.update(repr((found.hidden, found.others)).encode())
    for file in (mapping_file(mapping), *found.tables):
        for part in contents(file):
            read.update(part)
    return read.hexdigest()


@lru_cache(maxsize=2)
def reading_of(folder: Path | None, name: str, digest: str) -> tuple[Reading, ColumnMapping]:
    """Read the tables with their mapping, or simulate them; `digest` says which content of the files is meant."""
    if folder is None:
        return Reading(simulated_meerkats.simulated_tracks(), Found((), (), ())), simulated_meerkats.MAPPING
    mapping = load_mapping(name)
    return read_folder(folder, mapping), mapping


@lru_cache(maxsize=8)
def _load(options: MeerkatOptions, folder: Path | None, digest: str) -> Herd:
    reading, mapping = reading_of(folder, options.mapping, digest)
    coded = code_rows(reading.tracks, mapping, options.coding, options.pups)
    _check_codes(coded, mapping)
    windows = cut_windows(coded, reading.tracks, options.horizon)
    known = folder is None and options.coding == "bout" and not options.pups and options.state == "code"
    truth = simulated_meerkats.truth() if known else None
    return Herd(
        windows,
        truth,
        _impossible(windows, mapping, options) if truth is None else truth.structural,
        Account() if folder is None else account(folder, reading, coded, windows, mapping),
    )


def _check_codes(coded: Coded, mapping: ColumnMapping) -> None:
    """Raise ValueError for codes that make no world: one alone, or more than a table takes."""
    column, number = mapping.columns["behaviour"], len(coded.names)
    if number < 2:
        raise ValueError(f"column {column!r}: {coded.names[0]!r} is its only label; a world of codes needs at least 2")
    if number > MOST_CODES:
        some = ", ".join(map(repr, coded.names[:3]))
        raise ValueError(f"column {column!r}: {number} codes ({some}, …); choose a column of at most {MOST_CODES} labels")


def _impossible(windows: Windows, mapping: ColumnMapping, options: MeerkatOptions) -> Bool[np.ndarray, "C C"]:
    """Mark impossible pairs of codes: those that no camera sees together, and two moves in a row, which are one bout."""
    size, sites = len(windows.names), np.unique(windows.site)
    seen = np.array([np.isin(np.arange(size), windows.code[windows.site == site]) for site in sites])
    together = (seen[:, :, None] & seen[:, None, :]).any(axis=0)
    moves = np.array([name == mapping.moving or name.startswith("moving to ") for name in windows.names])
    two_moves = np.outer(moves, moves) & ~np.eye(size, dtype=bool) if options.coding == "bout" else np.zeros_like(together)
    return ~together | two_moves
