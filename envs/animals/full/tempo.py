"""Say how restless an animal has been: the changes that it has shown, beside those that its activities let one expect."""

import numpy as np
from jaxtyping import Bool, Float, Int

from envs.animals.full.steps import Recordings

ROWS = 10.0  # pseudo-rows of an activity's rate of leaving
CHANGES = 2.0  # pseudo-changes of an animal's tempo


def tempo_of(recordings: Recordings, trained: Bool[np.ndarray, " R"]) -> Float[np.ndarray, " N"]:
    """Compute log((changes seen + 2) / (changes expected + 2)) of each animal before each step."""
    seen, expected = seen_and_expected(recordings, expected_rates(recordings, trained))
    return np.log((seen + CHANGES) / (expected + CHANGES))


def expected_rates(recordings: Recordings, trained: Bool[np.ndarray, " R"]) -> Float[np.ndarray, "R C"]:
    """Compute each activity's rate of leaving in the `trained` recordings, for each recording without itself."""
    steps, size = recordings.steps, len(recordings.names)
    shape = (len(recordings.recordings), size)
    pair = steps.recording.astype(np.int32) * np.int32(size) + steps.code
    rows, changes = (
        np.bincount(pairs, minlength=shape[0] * size).reshape(shape).astype(np.float64)
        for pairs in (pair, pair[steps.code != steps.following])
    )
    kept_changes, kept_rows = (array * trained[:, None] for array in (changes, rows))
    other_changes, other_rows = (kept.sum(axis=0) - kept for kept in (kept_changes, kept_rows))
    everywhere = other_changes.sum(axis=1, keepdims=True) / np.maximum(other_rows.sum(axis=1, keepdims=True), 1.0)
    return (other_changes + ROWS * everywhere) / (other_rows + ROWS)


def seen_and_expected(
    recordings: Recordings, rates: Float[np.ndarray, "R C"]
) -> tuple[Float[np.ndarray, " N"], Float[np.ndarray, " N"]]:
    """Count the changes of each animal before each step, and those that the rates let one expect."""
    steps = recordings.steps
    left = (steps.code != steps.following).astype(np.float64)
    return _before(left, steps.track), _before(rates[steps.recording, steps.code], steps.track)


def _before(values: Float[np.ndarray, " N"], track: Int[np.ndarray, " N"]) -> Float[np.ndarray, " N"]:
    """Sum the values of a track before each step."""
    total = np.cumsum(values)
    total -= values
    first = np.flatnonzero(np.append(True, track[1:] != track[:-1]))
    total -= np.repeat(total[first], np.diff(np.append(first, len(track))))
    return total
