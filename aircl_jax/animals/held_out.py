"""Judge the behaviour model on recordings that it was not fitted to, beside the smoothed chain, with intervals."""

from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy import stats

from aircl_jax.animals.behaviour import Behaviour, Design, Prediction, fit, predict
from aircl_jax.animals.counting import counts_by_recording, smoothed_chain
from envs.animals.full.steps import Recordings

MOST_FOLDS = 10
RESAMPLES = 4000
AGES = ((1, 1), (2, 2), (3, 5), (6, 10), (11, 20), (21, 40), (41, 80), (81, None))  # rows; classes of the calibration


class HeldOut(NamedTuple):
    """Every step's prediction by the model and by the chain of the folds that do not hold its recording."""

    model: Prediction
    chain: Prediction
    fold: Int[np.ndarray, " N"]
    rows: Bool[np.ndarray, " N"]  # the steps that were fitted to and are judged


class Gain(NamedTuple):
    """A mean difference, its 95 % interval, and in how many of its parts it is above 0."""

    mean: float
    low: float
    high: float
    won: int
    of: int


def folds_of(recordings: Recordings) -> Int[np.ndarray, " R"]:
    """Number the fold that holds out each recording: two at a time, in order of camera and name, at most ten folds.

    Raises ValueError where there is nothing to hold out.
    """
    number = len(recordings.recordings)
    if number < 2:
        raise ValueError(
            "one animal in one recording: there is nothing to hold out, so nothing that a prediction can be judged by"
        )
    site = np.zeros(number, dtype=np.int64)
    site[recordings.steps.recording] = recordings.steps.site
    order = sorted(range(number), key=lambda one: (site[one], recordings.recordings[one]))
    folds = np.empty(number, dtype=np.int64)
    folds[order] = np.arange(number) % min(max(number // 2, 2), MOST_FOLDS)
    return folds


def evaluate(columns: Design, rows: Bool[np.ndarray, " N"] | None = None) -> tuple[HeldOut, list[Behaviour]]:
    """Fit on all but one fold in turn and predict that fold; the chain is fitted to the same steps."""
    steps = columns.recordings.steps
    judged = np.ones(len(steps.code), dtype=bool) if rows is None else rows
    folds = folds_of(columns.recordings)
    counts = counts_by_recording(columns.recordings, judged.astype(np.float64))
    model, chain = (Prediction(*np.zeros((3, len(steps.code)))) for _ in range(2))
    fitted: list[Behaviour] = []
    for fold in range(int(folds.max()) + 1):
        trained = folds != fold
        fitted.append(fit(columns, trained, judged, fitted[-1] if fitted else None))
        here = ~trained[steps.recording]
        for total, part in (
            (model, predict(columns, fitted[-1], trained)),
            (chain, predict_chain(columns, smoothed_chain(counts, trained)[0])),
        ):
            for array, values in zip(total, part, strict=True):
                array[here] = values[here]
    return HeldOut(model, chain, folds[steps.recording], judged), fitted


def predict_chain(columns: Design, log_chain: Float[np.ndarray, "C C"]) -> Prediction:
    """Split a chain's log P(c' | c) into whether to leave and where to go."""
    steps = columns.recordings.steps
    stay = np.diag(log_chain)[steps.code]
    log_hazard = np.log1p(-np.exp(stay))
    went = log_chain[steps.code, steps.following]
    return Prediction(
        np.where(columns.left, log_hazard, stay), np.where(columns.left, went - log_hazard, 0.0), np.exp(log_hazard)
    )


def over_folds(values: Float[np.ndarray, " n"], count: Float[np.ndarray, " n"], fold: Int[np.ndarray, " n"]) -> Gain:
    """Average Σ values / Σ count over folds, with a t interval; NaN with fewer than two folds."""
    shares = _shares(values, count, fold)
    mean, number = float(shares.mean()), len(shares)
    half = float(stats.t.ppf(0.975, number - 1)) * shares.std(ddof=1) / number**0.5 if number > 1 else float("nan")
    return Gain(mean, mean - float(half), mean + float(half), int((shares > 0).sum()), len(shares))


def over_recordings(values: Float[np.ndarray, " n"], count: Float[np.ndarray, " n"], recording: Int[np.ndarray, " n"]) -> Gain:
    """Compute Σ values / Σ count of all, with a bootstrap interval over recordings."""
    total, weight = np.bincount(recording, values), np.bincount(recording, count)
    total, weight = total[weight > 0], weight[weight > 0]
    drawn = np.random.default_rng(0).integers(0, len(total), (RESAMPLES, len(total)))
    low, high = np.percentile(total[drawn].sum(axis=1) / weight[drawn].sum(axis=1), [2.5, 97.5])
    return Gain(float(total.sum() / weight.sum()), float(low), float(high), int((total > 0).sum()), len(total))


def _shares(values: Float[np.ndarray, " n"], count: Float[np.ndarray, " n"], group: Int[np.ndarray, " n"]) -> np.ndarray:
    weight = np.bincount(group, count)
    return (np.bincount(group, values) / np.maximum(weight, 1.0))[weight > 0]


class AgeClass(NamedTuple):
    """The share that leaves among the steps of an age whose bout was seen to begin."""

    first: int
    last: int | None
    steps: int
    observed: float
    chain: float
    model: float


def calibration(columns: Design, held: HeldOut) -> list[AgeClass]:
    """Compare the held-out chance of leaving with the share that left, by the age of the bout."""
    steps = columns.recordings.steps
    found = []
    for first, last in AGES:
        here = held.rows & ~steps.unseen & (steps.age >= first)
        if last is not None:
            here &= steps.age <= last
        if here.any():
            shares = (columns.left[here], held.chain.hazard[here], held.model.hazard[here])
            found.append(AgeClass(first, last, int(here.sum()), *(float(share.mean()) for share in shares)))
    return found


def jackknife(leave_one_out: Float[np.ndarray, "M *K"]) -> Float[np.ndarray, "*K"]:
    """Compute the standard error √((M − 1) / M Σ (θ₋ᵣ − θ̄)²) of coefficients, from M fits that leave out one recording each."""
    number = len(leave_one_out)
    return np.asarray(np.sqrt((number - 1) / number * ((leave_one_out - leave_one_out.mean(axis=0)) ** 2).sum(axis=0)))
