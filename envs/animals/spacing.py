"""Tell from the times of a track whether two rows follow each other, and whether a table is sampled as its mapping says."""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Bool, Float

TOLERANCE = 0.1  # of a step: rounded and jittered times stay within it, and a missing row does not


def one_step(time: Float[np.ndarray, " R"], step: float) -> Bool[np.ndarray, " Q"]:
    """Say of each row but the first whether it is one step after the row before, but for rounding."""
    rounding = np.spacing(np.maximum(np.abs(time[1:]), np.abs(time[:-1])))
    return np.abs(np.diff(time) - step) <= TOLERANCE * step + rounding


def check_spacing(between: Float[np.ndarray, " Q"], step: float, stops: Sequence[str]) -> None:
    """Raise ValueError, with medians, where most rows of a track are not one step apart.

    `between` holds the times between two rows of a track, `stops` the columns that seem to hold the ends of bouts.
    """
    if not len(between):
        raise ValueError("no track has two rows; choose columns of time and individual in which an animal is seen again")
    low, median, high = np.quantile(between, (0.05, 0.5, 0.95))
    if abs(median - step) > TOLERANCE * step:
        end = repr(stops[0]) if stops else "…"
        raise ValueError(
            f"two rows of a track are {median:g} apart in the median, {low:g} to {high:g} in nine cases of ten, and step is "
            f"{step:g}; set step in the mapping to the time between two rows; where a row is a bout, with a start and an end, "
            f"name the column of its end, as in columns: {{stop: {end}}}"
        )
