"""Sample bouts, each with its start and its stop, at even times."""

import numpy as np
from jaxtyping import Bool, Float, Int

MOST_SAMPLES = 20_000_000  # of one table; more is a wrong unit of `step`
ROUNDING = 1e-6  # of a step: a start so little after a sample still holds it


def overlap(new_track: Bool[np.ndarray, " Q"], start: Float[np.ndarray, " R"], stop: Float[np.ndarray, " R"]) -> int | None:
    """Find the first bout that ends after the next of its track begins; None where there is none."""
    slack = 2 * np.spacing(np.abs(stop[:-1]))
    at = np.flatnonzero(~new_track & (stop[:-1] > start[1:] + slack))
    return int(at[0]) if len(at) else None


def sampled(
    start: Float[np.ndarray, " R"], stop: Float[np.ndarray, " R"], step: float, source: str
) -> tuple[Int[np.ndarray, " M"], Float[np.ndarray, " M"]]:
    """List the multiples k·step with start ≤ k·step < stop: the row of each, and its time.

    Bouts that follow each other share no sample and leave none out. Raises ValueError for more samples than memory is for.
    """
    with np.errstate(over="ignore", invalid="ignore"):  # of a step so short that a time in steps is infinite
        first, last = (np.ceil(ends / step - ROUNDING - 2 * np.spacing(np.abs(ends / step))) for ends in (start, stop))
        number = np.maximum(last - first, 0.0)
    if not number.sum() <= MOST_SAMPLES:
        longest = f"the longest bout lasts {(stop - start).max():g}"
        raise ValueError(f"{source}: {number.sum():.3g} samples with step {step:g}; {longest}: choose a longer step")
    count = number.astype(np.int64)
    rows = np.repeat(np.arange(len(start)), count)
    within = np.arange(len(rows)) - np.repeat(np.cumsum(count) - count, count)
    return rows, (first[rows] + within) * step
