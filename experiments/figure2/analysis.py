"""Compute what Figure 2 shows from a folder of tables: histograms, tests of the inflexion and tables of pairs."""

from dataclasses import dataclass
from pathlib import Path
from typing import Literal, NamedTuple

import numpy as np
from jaxtyping import Float

from aircl_jax.analysis import transition_distances
from envs.animals import simulated_meerkats
from envs.animals.account import account
from envs.animals.columns import ColumnMapping, load_mapping
from envs.animals.data_folder import data_folder
from envs.animals.tables import Found
from envs.animals.tracks import Reading, read_folder
from envs.animals.windows import Coded, Transitions, code_rows, cut_windows, transitions

TAIL_BINS = (2, 9)  # the exponential is fitted between these bins and compared beyond the second
LONG_PERCENTILE = 95.0  # a pair of codes is long if its mean distance is beyond this percentile of all transitions
LEAST_SEEN = 10  # located transitions of a pair that is called long
WIDTHS = (0.5, 1.0, 2.0)  # bin widths of the test, relative to the figure's
NICE = 1  # index of the figure's own width in WIDTHS


@dataclass(frozen=True)
class Settings:
    data: str = "default"
    mapping: str = "meerkat"
    coding: Literal["bout", "step"] = "bout"
    out: str = "results/figure2"
    draws: int = 2000
    seed: int = 0

    def __post_init__(self) -> None:
        if self.draws < 1 or self.seed < 0:
            raise ValueError(f"draws={self.draws} seed={self.seed}: draws begin at 1 and seeds at 0")


class Study(NamedTuple):
    """The rows that were read, their codes and transitions; positions are in the unit that figures show."""

    mapping: ColumnMapping
    coded: Coded
    moves: Transitions
    account: tuple[str, ...]  # what was read and left out
    simulated: bool


def read(settings: Settings) -> Study:
    """Read the tables into coded rows and transitions.

    Raises ValueError as `envs.animals.tracks` does, and where the mapping has no places or no coordinates.
    """
    folder = data_folder(settings.data, "meerkat")
    mapping = simulated_meerkats.MAPPING if folder is None else load_mapping(settings.mapping)
    for column in ("place", "coordinates"):
        if column not in mapping.columns:
            raise ValueError(f"mapping={settings.mapping} has no {column}; the figures need place and coordinates")
    if folder is None:
        reading = Reading(simulated_meerkats.simulated_tracks(), Found((), (), ()))
    else:
        reading = read_folder(folder, mapping)
    tracks = reading.tracks._replace(position=reading.tracks.position / mapping.coordinate_scale)
    coded = code_rows(tracks, mapping, settings.coding)
    read_and_cut = account(folder or Path(), reading, coded, cut_windows(coded, tracks), mapping)
    return Study(mapping, coded, transitions(coded), read_and_cut.lines, simulated=folder is None)


class Numbers(NamedTuple):
    """The numbers that the figures and the report show."""

    missing_at: tuple[float, ...]  # where `with_missing` puts missing coordinates, in the unit of distances
    with_missing: transition_distances.Histogram
    without: transition_distances.Histogram
    rises: dict[str, list[transition_distances.RiseTest]]  # {with_missing, without: one test per bin width}
    tail: transition_distances.Tail
    pairs: transition_distances.Pairs
    long_pairs: list[tuple[int, int]]
    long_distance: float

    def as_json(self) -> dict[str, object]:
        histograms = {"with_missing": self.with_missing, "without": self.without}
        return {
            "histograms": {name: {k: v.tolist() for k, v in h._asdict().items()} for name, h in histograms.items()},
            "rises": {name: [test._asdict() for test in tests] for name, tests in self.rises.items()},
            "tail": self.tail._asdict(),
            "long_pairs": self.long_pairs,
            "long_distance": self.long_distance,
            "pairs_seen": self.pairs.seen.tolist(),
        }


def analyse(study: Study, settings: Settings) -> Numbers:
    """Compute the histograms, the tests of the inflexion and the tables of pairs."""
    moves = study.moves
    filled = np.pad(
        np.array(study.mapping.missing_coordinates) / study.mapping.coordinate_scale,
        (0, 3 - len(study.mapping.missing_coordinates)),
    )
    distance = transition_distances.distances(moves.start, moves.end)
    known = np.isfinite(distance)
    all_starts, all_ends = (np.where(np.isnan(at), filled, at) for at in (moves.start, moves.end))
    everything = transition_distances.distances(all_starts, all_ends)
    width = nice_width(float(everything.max()) / 15)
    seeded = {"draws": settings.draws, "seed": settings.seed}

    def edges(bin_width: float) -> Float[np.ndarray, " E"]:
        return np.arange(0.0, everything.max() + bin_width, bin_width)

    located = np.flatnonzero(known)
    rises = {
        name: [transition_distances.rise_test(d, recording, edges(factor * width), **seeded) for factor in WIDTHS]
        for name, d, recording in (
            ("with_missing", everything, moves.recording),
            ("without", distance[located], moves.recording[located]),
        )
    }
    pairs = transition_distances.pair_table(moves.source, moves.target, distance, len(study.coded.names))
    long_distance = float(np.percentile(distance[located], LONG_PERCENTILE))
    low, high = (bins * width for bins in TAIL_BINS)
    return Numbers(
        missing_at=tuple(filled.tolist()),
        with_missing=transition_distances.histogram(all_starts, all_ends, moves.recording, edges(width), **seeded),
        without=transition_distances.histogram(
            moves.start[located], moves.end[located], moves.recording[located], edges(width), **seeded
        ),
        rises=rises,
        tail=transition_distances.exponential_tail(distance[located], moves.recording[located], low, high, **seeded),
        pairs=pairs,
        long_pairs=transition_distances.frequent_long_pairs(pairs, long_distance, LEAST_SEEN, number=2),
        long_distance=long_distance,
    )


def nice_width(width: float) -> float:
    """Return the nearest of 1, 2, 5 × 10^k in log scale."""
    choices = np.array([1, 2, 5, 10]) * 10.0 ** np.floor(np.log10(width))
    return float(choices[np.abs(np.log(choices / width)).argmin()])
