"""Predict the next activity by counting alone: a smoothed first-order chain, and chains that back off from richer contexts."""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Bool, Float, Int, Shaped

from envs.animals.full.steps import Recordings

SMOOTHINGS = (0.01, 0.03, 0.1, 0.3, 1.0, 3.0)  # pseudo-counts that leaving out one recording at a time chooses from
BACK_OFF = (3.0, 10.0, 30.0, 100.0)  # pseudo-counts of a richer context
FIRST = 2.5  # pseudo-count of the code alone, spread over all codes


def counts_by_recording(recordings: Recordings, weight: Shaped[np.ndarray, " N"]) -> Float[np.ndarray, "R C C"]:
    """Count the steps from code to code in each recording, each by its weight."""
    steps, size = recordings.steps, len(recordings.names)
    shape = (len(recordings.recordings), size, size)
    change = (steps.recording.astype(np.int64) * size + steps.code) * size + steps.following
    return np.bincount(change, weight, minlength=shape[0] * size * size).reshape(shape)


def smoothed_chain(
    counts: Float[np.ndarray, "R C C"], trained: Bool[np.ndarray, " R"]
) -> tuple[Float[np.ndarray, "C C"], float]:
    """Fit log P(c' | c) = log (n + s) / Σ (n + s) to the `trained` recordings; return it and the pseudo-count s.

    s predicts each of these recordings best from the others.
    """
    own = counts[trained]
    total = own.sum(axis=0)

    def score(smoothing: float) -> float:
        return float((own * _log_share(total - own, smoothing)).sum())

    best = max(SMOOTHINGS, key=score)
    return _log_share(total, best), best


def _log_share(counts: Float[np.ndarray, "*R C C"], smoothing: float) -> Float[np.ndarray, "*R C C"]:
    smooth = counts + smoothing
    return np.log(smooth / smooth.sum(axis=-1, keepdims=True))


def back_off(
    recordings: Recordings,
    contexts: Sequence[Sequence[Int[np.ndarray, " N"]]],
    trained: Bool[np.ndarray, " R"],
    weight: Float[np.ndarray, " N"],
    strength: float,
) -> Float[np.ndarray, " N"]:
    """Compute log P(c' | context): (n + a P of the context before) / (Σ n + a), from the poorest context to the richest.

    A context is a list of what it knows beside the code; a is FIRST for the code alone, else `strength`.
    """
    steps, size = recordings.steps, len(recordings.names)
    use = trained[steps.recording] * weight
    share = np.full((len(steps.code), size), 1.0 / size)
    for number, context in enumerate(contexts):
        _, group = np.unique(np.stack([steps.code, *context]), axis=1, return_inverse=True)
        counts = np.zeros((int(group.max()) + 1, size))
        np.add.at(counts, (group, steps.following), use)
        pseudo = FIRST if number == 0 else strength
        seen = counts[group]
        share = (seen + pseudo * share) / (seen.sum(axis=1, keepdims=True) + pseudo)
    return np.log(share[np.arange(len(share)), steps.following])
