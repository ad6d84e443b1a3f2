"""Test which differences a few seeds can show: tests by pairs or without, Holm's correction and bootstrap intervals."""

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
from scipy import stats

SIGNIFICANCE = 0.05
CONFIDENCE = 0.95
RESAMPLES = 9999

FEWEST_SEEDS = 6  # with fewer, no paired test of ours gives a p below 5 %

Values = Mapping[int, float | None]  # {seed: value}, None where undefined


class Gain(NamedTuple):
    """Difference of two rows' means, its bootstrap interval, p, and the seeds of the row that has fewer."""

    mean: float
    bounds: tuple[float, float] | None
    p: float
    seeds: int
    paired: bool


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
        values, _between_means, permutation_type="independent", vectorized=True, n_resamples=RESAMPLES, rng=draws
    )
    return float(found.pvalue)


def _between_means(first: np.ndarray, second: np.ndarray, axis: int) -> np.ndarray:
    return np.mean(first, axis=axis) - np.mean(second, axis=axis)


def least_p(pairs: int) -> float:
    """Return the smallest p that the paired test can give with this number of pairs: all signs alike, 2 of 2^n cases."""
    return min(2.0 ** (1 - pairs), 1.0)


def least_unpaired_p(first: int, second: int) -> float:
    """Return the smallest p of the unpaired test of so many seeds: 2 of all exchanges, or of those that it draws."""
    exchanges = min(math.comb(first + second, first), RESAMPLES + 1)
    return min(2.0 / exchanges, 1.0)


def have_pairs(first: Values, second: Values) -> bool:
    """Whether two rows have seeds in common, by which they are then compared."""
    return bool(first.keys() & second.keys())


def gain(first: Values, second: Values) -> Gain | None:
    """Compute first − second, seed by seed where both have seeds in common, else as independent samples.

    Seeds at which a value is undefined are left out; None where none is left.
    """
    if have_pairs(first, second):
        pairs = differences(first, second)
        return Gain(float(pairs.mean()), interval(pairs), _p_of(first, second), len(pairs), True) if len(pairs) else None
    one, other = _defined(first), _defined(second)
    if not one or not other:
        return None
    mean = float(np.mean(one) - np.mean(other))
    return Gain(mean, unpaired_interval(one, other), _p_of(first, second), min(len(one), len(other)), False)


def _defined(values: Values) -> list[float]:
    return [value for value in values.values() if value is not None]


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
    return None if np.isnan(sample).any() else _bootstrap(np.mean, sample)


def unpaired_interval(first: Sequence[float], second: Sequence[float]) -> tuple[float, float] | None:
    """Compute the percentile bootstrap interval of the difference of means of two samples, each resampled by itself."""
    return _bootstrap(_between_means, np.array(first, float), np.array(second, float))


def _bootstrap(statistic: Callable[..., Any], *samples: np.ndarray) -> tuple[float, float] | None:
    if min(map(len, samples)) < 2:
        return None
    if all(np.ptp(sample) == 0 for sample in samples):
        always = float(statistic(*(sample[:1] for sample in samples), axis=0))
        return always, always
    draws = np.random.default_rng(0)
    bootstrap = stats.bootstrap(
        samples, statistic, n_resamples=RESAMPLES, confidence_level=CONFIDENCE, method="percentile", rng=draws
    )
    return float(bootstrap.confidence_interval.low), float(bootstrap.confidence_interval.high)


def against_best(column: Mapping[str, Values], lower: bool) -> dict[str, float]:
    """Compute the Holm-adjusted p of each method against the method with the best mean, whose own p is 1.

    Rows with seeds in common are compared by pairs, others without. Methods that are undefined on a seed are left out. The
    result is empty where the seeds are too few to show a difference.
    """
    means = {name: average for name, values in column.items() if (average := mean(values)) is not None}
    if len(means) < 2:
        return {}
    best = (min if lower else max)(means, key=lambda name: means[name])
    others = [name for name in means if name != best]
    if max(_least_p_of(column[name], column[best]) for name in others) * len(others) >= SIGNIFICANCE:
        return {}
    adjusted = holm([_p_of(column[name], column[best]) for name in others])
    return {best: 1.0, **dict(zip(others, adjusted, strict=True))}


def _p_of(first: Values, second: Values) -> float:
    if have_pairs(first, second):
        return paired_p(differences(first, second))
    return unpaired_p(_defined(first), _defined(second))


def _least_p_of(first: Values, second: Values) -> float:
    if have_pairs(first, second):
        return least_p(len(differences(first, second)))
    return least_unpaired_p(len(first), len(second))


def best_or_tied(column: Mapping[str, Values], lower: bool) -> set[str]:
    """Return the method with the best mean, and the methods that the seeds do not show to be worse."""
    return {name for name, p in against_best(column, lower).items() if p >= SIGNIFICANCE}
