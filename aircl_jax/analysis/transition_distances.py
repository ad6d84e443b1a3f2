"""Measure how far animals move in a behaviour transition, and test for more long transitions than a falling trend has.

The paper's Section 6 reads an inflexion off the histogram of these distances. Here the largest rise of the histogram is
tested against a monotone trend, over recordings, and against ends shuffled among the transitions of a recording.
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int, Shaped
from scipy.ndimage import gaussian_filter1d
from scipy.optimize import isotonic_regression

BAND = (2.5, 97.5)  # percentiles of a 95 % band


class Histogram(NamedTuple):
    """Counts of transitions by distance; B bins, bands over bootstrapped recordings and over shuffles."""

    edges: Float[np.ndarray, " E"]
    counts: Int[np.ndarray, " B"]
    trend: Float[np.ndarray, " B"]  # counts smoothed in log scale
    monotone: Float[np.ndarray, " B"]  # the nearest falling sequence (isotonic least squares)
    band: Float[np.ndarray, "2 B"]  # 95 % over bootstrapped recordings
    shuffled: Float[np.ndarray, " B"]  # mean of the null model
    shuffled_band: Float[np.ndarray, "2 B"]


class RiseTest(NamedTuple):
    """Largest rise z = (n_b − n_a) / √(n_a + n_b), a < b, of a histogram that is claimed to fall and rise again."""

    bin_width: float
    low: float  # middle of bin a
    high: float  # middle of bin b
    counts: tuple[int, int]
    z: float
    p_monotone: float  # share of Poisson draws from the monotone trend with as large a rise somewhere
    bootstrap_share: float  # share of bootstrapped recordings in which n_b > n_a


def distances(
    start: Float[np.ndarray, "M 3"], end: Float[np.ndarray, "M 3"], fill: Float[np.ndarray, " 3"] | None = None
) -> Float[np.ndarray, " M"]:
    """Compute |end − start|; NaN where a position is unknown, unless `fill` replaces it (0: counted as a place)."""
    if fill is not None:
        start, end = (np.where(np.isnan(position), fill, position) for position in (start, end))
    return np.linalg.norm(end - start, axis=1)


def histogram(
    start: Float[np.ndarray, "M 3"],
    end: Float[np.ndarray, "M 3"],
    recording: Shaped[np.ndarray, " M"],
    edges: Float[np.ndarray, " E"],
    *,
    draws: int,
    seed: int,
) -> Histogram:
    """Count |end − start|, with the trend, the bootstrap band and the null model; all positions must be known."""
    counts = np.histogram(distances(start, end), edges)[0]
    boot = bootstrap_counts(distances(start, end), recording, edges, draws=draws, seed=seed)
    null = shuffled_counts(start, end, recording, edges, draws=draws, seed=seed)
    return Histogram(
        edges=edges,
        counts=counts,
        trend=np.expm1(gaussian_filter1d(np.log1p(counts), sigma=0.7, mode="nearest")),
        monotone=monotone_trend(counts),
        band=np.percentile(boot, BAND, axis=0),
        shuffled=null.mean(axis=0),
        shuffled_band=np.percentile(null, BAND, axis=0),
    )


def monotone_trend(counts: Int[np.ndarray, " B"]) -> Float[np.ndarray, " B"]:
    """Fit the falling sequence nearest to the counts in least squares, which is also the most likely Poisson mean."""
    return np.asarray(isotonic_regression(counts.astype(float), increasing=False).x)


def bootstrap_counts(
    distance: Float[np.ndarray, " M"],
    recording: Shaped[np.ndarray, " M"],
    edges: Float[np.ndarray, " E"],
    *,
    draws: int,
    seed: int,
) -> Int[np.ndarray, "D B"]:
    """Compute histograms of resampled recordings, so that one recording's peculiarity widens the band."""
    names = np.unique(recording)
    each = np.stack([np.histogram(distance[recording == name], edges)[0] for name in names])
    weights = np.random.default_rng(seed).multinomial(len(names), np.full(len(names), 1 / len(names)), size=draws)
    return weights @ each


def shuffled_counts(
    start: Float[np.ndarray, "M 3"],
    end: Float[np.ndarray, "M 3"],
    recording: Shaped[np.ndarray, " M"],
    edges: Float[np.ndarray, " E"],
    *,
    draws: int,
    seed: int,
) -> Int[np.ndarray, "D B"]:
    """Compute histograms with the ends permuted within each recording, so that start and end are independent."""
    generator = np.random.default_rng(seed)
    members = [np.flatnonzero(recording == name) for name in np.unique(recording)]
    counts = np.empty((draws, len(edges) - 1), dtype=np.int64)
    for draw in range(draws):
        order = np.concatenate([generator.permutation(rows) for rows in members])
        counts[draw] = np.histogram(distances(start[np.concatenate(members)], end[order]), edges)[0]
    return counts


def largest_rise(counts: Int[np.ndarray, " B"]) -> tuple[int, int, float]:
    """Find (a, b, z) of the largest z = (n_b − n_a) / √(n_a + n_b) over bins a < b."""
    earlier, later = np.triu_indices(len(counts), k=1)
    rise = counts[later] - counts[earlier]
    z = rise / np.sqrt(np.maximum(counts[later] + counts[earlier], 1))
    best = int(z.argmax())
    return int(earlier[best]), int(later[best]), float(z[best])


def rise_test(
    distance: Float[np.ndarray, " M"],
    recording: Shaped[np.ndarray, " M"],
    edges: Float[np.ndarray, " E"],
    *,
    draws: int,
    seed: int,
) -> RiseTest:
    """Test for a rise after the mode. The Poisson null takes transitions as independent, so p is a lower bound."""
    edges = edges[np.histogram(distance, edges)[0].argmax() :]
    counts = np.histogram(distance, edges)[0]
    low, high, z = largest_rise(counts)
    null = np.random.default_rng(seed).poisson(monotone_trend(counts), size=(draws, len(counts)))
    as_large = sum(largest_rise(sample)[2] >= z for sample in null)
    boot = bootstrap_counts(distance, recording, edges, draws=draws, seed=seed)
    middle = (edges[:-1] + edges[1:]) / 2
    return RiseTest(
        bin_width=float(edges[1] - edges[0]),
        low=float(middle[low]),
        high=float(middle[high]),
        counts=(int(counts[low]), int(counts[high])),
        z=z,
        p_monotone=(1 + as_large) / (1 + draws),
        bootstrap_share=float((boot[:, high] > boot[:, low]).mean()),
    )


class Tail(NamedTuple):
    """Number of transitions beyond `high`, beside what an exponential fitted between `low` and `high` leads to expect."""

    low: float
    high: float
    observed: int
    expected: float
    ratio_band: tuple[float, float]  # 95 % of observed / expected over bootstrapped recordings


def exponential_tail(
    distance: Float[np.ndarray, " M"],
    recording: Shaped[np.ndarray, " M"],
    low: float,
    high: float,
    *,
    draws: int,
    seed: int,
) -> Tail:
    """Test whether the tail is heavier than exponential. The rate is the most likely one of the distances in [low, high]."""
    names = np.unique(recording)
    parts = [distance[recording == name] for name in names]
    chosen = np.random.default_rng(seed).integers(len(names), size=(draws, len(names)))
    ratios = []
    for draw in chosen:
        observed, expected = _beyond(np.concatenate([parts[index] for index in draw]), low, high)
        ratios.append(observed / expected)
    observed, expected = _beyond(distance, low, high)
    band = np.percentile(ratios, BAND)
    return Tail(low, high, observed, expected, (float(band[0]), float(band[1])))


def _beyond(distance: Float[np.ndarray, " M"], low: float, high: float) -> tuple[int, float]:
    """Count those at or beyond `high`, and N e^{−λw} / (1 − e^{−λw}) expected, w = high − low, N between them."""
    inside = distance[(distance >= low) & (distance < high)] - low
    width = high - low
    # The mean of a truncated exponential, 1/λ − w / (e^{λw} − 1), falls in λ: bisection.
    slow, fast = 1e-6 / width, 100.0 / width
    for _ in range(60):
        rate = (slow + fast) / 2
        too_slow = 1 / rate - width / np.expm1(rate * width) > inside.mean()
        slow, fast = (rate, fast) if too_slow else (slow, rate)
    return int((distance >= high).sum()), float(len(inside) / np.expm1(slow * width))


class Pairs(NamedTuple):
    """Transitions by pair of codes, [from, to]."""

    seen: Int[np.ndarray, "C C"]
    frequency: Float[np.ndarray, "C C"]  # share of the transitions out of `from`
    located: Int[np.ndarray, "C C"]  # those with both positions known
    mean_distance: Float[np.ndarray, "C C"]  # NaN without any located


def pair_table(
    source: Int[np.ndarray, " M"], target: Int[np.ndarray, " M"], distance: Float[np.ndarray, " M"], num_codes: int
) -> Pairs:
    """Compute mean distance and relative frequency of every pair (Figures 2(d) and 2(e)); an unknown distance is NaN."""
    shape = (num_codes, num_codes)
    seen, located, total = np.zeros(shape, np.int64), np.zeros(shape, np.int64), np.zeros(shape)
    known: Bool[np.ndarray, " M"] = np.isfinite(distance)
    np.add.at(seen, (source, target), 1)
    np.add.at(located, (source[known], target[known]), 1)
    np.add.at(total, (source[known], target[known]), distance[known])
    mean = np.divide(total, located, out=np.full(shape, np.nan), where=located > 0)
    return Pairs(seen, seen / np.maximum(seen.sum(axis=1, keepdims=True), 1), located, mean)


def frequent_long_pairs(pairs: Pairs, threshold: float, least: int, number: int) -> list[tuple[int, int]]:
    """List the most frequent pairs (by share of their start) located `least` times, with a mean distance ≥ threshold."""
    eligible = (pairs.located >= least) & (np.nan_to_num(pairs.mean_distance) >= threshold)
    order = np.argsort(np.where(eligible, -pairs.frequency, 1.0), axis=None, kind="stable")[:number]
    chosen = [tuple(int(part) for part in np.unravel_index(index, eligible.shape)) for index in order]
    return [(source, target) for source, target in chosen if eligible[source, target]]
