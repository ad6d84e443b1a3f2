"""Test which differences a few seeds can show: paired tests, Holm's correction and bootstrap intervals."""

from collections.abc import Iterable, Mapping, Sequence
from typing import NamedTuple

import numpy as np
from scipy import stats

SIGNIFICANCE = 0.05
CONFIDENCE = 0.95
RESAMPLES = 9999

FEWEST_SEEDS = 6  # with fewer, no paired test of ours gives a p below 5 %

Values = Mapping[int, float | None]  # {seed: value}, None where undefined


class Effect(NamedTuple):
    """Paired difference over seeds: mean, 95 % t interval, Cohen's d of the pairs, Wilcoxon's p."""

    mean: float
    low: float
    high: float
    size: float
    p: float


def effect(first: Sequence[float], second: Sequence[float]) -> Effect:
    """Compute first − second, pair by pair; interval, size and p are NaN with fewer than two pairs."""
    difference = np.array(first, float) - np.array(second, float)
    number, mean = len(difference), float(difference.mean())
    if number < 2:
        return Effect(mean, *[float("nan")] * 4)
    spread = float(difference.std(ddof=1))
    half = float(stats.t.ppf(0.5 + CONFIDENCE / 2, number - 1)) * spread / number**0.5
    return Effect(mean, mean - half, mean + half, mean / spread if spread else float("nan"), paired_p(difference))


def spread(values: Sequence[float | None], digits: int = 4) -> str:
    """Format mean ± sample standard deviation; — where a value is undefined, or where there is none."""
    array = np.array(values, float)
    if not array.size or not np.isfinite(array).all():
        return "—"
    return f"{array.mean():.{digits}f}" + (f" ± {array.std(ddof=1):.{digits}f}" if len(array) > 1 else "")


def each(values: Iterable[float | None]) -> str:
    """Format every seed's value."""
    return " ".join("—" if value is None else f"{value:.3f}" for value in values)


def mean(values: Values) -> float | None:
    """Average over seeds; None where the value of any seed is undefined."""
    defined = [value for value in values.values() if value is not None]
    return sum(defined) / len(defined) if defined and len(defined) == len(values) else None


def differences(first: Values, second: Values) -> np.ndarray:
    """Compute first − second on the seeds where both are defined."""
    seeds = [seed for seed in first if first[seed] is not None and second.get(seed) is not None]
    return np.array([first[seed] for seed in seeds], float) - np.array([second[seed] for seed in seeds], float)


def paired_p(difference: np.ndarray) -> float:
    """Compute the two-sided p of Wilcoxon's signed-rank test; 1 where nothing differs."""
    if not difference.any():
        return 1.0
    _, p = stats.wilcoxon(difference)
    return float(p)  # pyright: ignore[reportArgumentType]


def unpaired_p(first: Sequence[float], second: Sequence[float]) -> float:
    """Compute the two-sided p of the difference of means by exchanging seeds between both rows, which were not the same."""
    values = (np.array(first, float), np.array(second, float))
    draws = np.random.default_rng(0)
    found = stats.permutation_test(
        values,
        lambda one, other: np.mean(one) - np.mean(other),
        permutation_type="independent",
        n_resamples=RESAMPLES,
        rng=draws,
    )
    return float(found.pvalue)


def least_p(pairs: int) -> float:
    """Return the smallest p that the test can give with this number of pairs: all signs alike, 2 of 2^n cases."""
    return min(2.0 ** (1 - pairs), 1.0)


def holm(p_values: Sequence[float]) -> list[float]:
    """Apply Holm's step-down correction, in the order of the input: p_(i) ← max_{j ≤ i} min(1, (m − j + 1) p_(j))."""
    order = np.argsort(p_values, kind="stable")
    scaled = np.asarray(p_values, float)[order] * np.arange(len(p_values), 0, -1)
    adjusted = np.empty(len(p_values))
    adjusted[order] = np.minimum(np.maximum.accumulate(scaled), 1.0)
    return adjusted.tolist()


def interval(values: Iterable[float | None]) -> tuple[float, float] | None:
    """Compute the percentile bootstrap interval of the mean; None with fewer than two values, or an undefined one."""
    sample = np.array([np.nan if value is None else value for value in values], float)
    if len(sample) < 2 or np.isnan(sample).any():
        return None
    if np.ptp(sample) == 0:
        return float(sample[0]), float(sample[0])
    draws = np.random.default_rng(0)
    bootstrap = stats.bootstrap(
        (sample,), np.mean, n_resamples=RESAMPLES, confidence_level=CONFIDENCE, method="percentile", rng=draws
    )
    return float(bootstrap.confidence_interval.low), float(bootstrap.confidence_interval.high)


def against_best(column: Mapping[str, Values], lower: bool) -> dict[str, float]:
    """Compute the Holm-adjusted p of each method against the method with the best mean, whose own p is 1.

    Methods that are undefined on a seed are left out. The result is empty where the seeds are too few to show a difference.
    """
    means = {name: average for name, values in column.items() if (average := mean(values)) is not None}
    if len(means) < 2:
        return {}
    best = (min if lower else max)(means, key=lambda name: means[name])
    others = [name for name in means if name != best]
    if least_p(min(len(column[name]) for name in means)) * len(others) >= SIGNIFICANCE:
        return {}
    adjusted = holm([paired_p(differences(column[name], column[best])) for name in others])
    return {best: 1.0, **dict(zip(others, adjusted, strict=True))}


def best_or_tied(column: Mapping[str, Values], lower: bool) -> set[str]:
    """Return the method with the best mean, and the methods that the seeds do not show to be worse."""
    return {name for name, p in against_best(column, lower).items() if p >= SIGNIFICANCE}
