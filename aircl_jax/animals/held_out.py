"""Judge the behaviour model on recordings that it was not fitted to, beside the smoothed chain, with intervals."""

from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy import stats

from aircl_jax.animals.behaviour import Design, fit
from aircl_jax.animals.counting import counts_by_recording, smoothed_chain
from aircl_jax.animals.going import log_going
from aircl_jax.animals.leaving import log_leaving
from envs.animals.full.steps import Recordings, Steps

MOST_FOLDS = 10
RESAMPLES = 4000
AGES = ((1, 1), (2, 2), (3, 5), (6, 10), (11, 20), (21, 40), (41, 80), (81, None))  # rows; classes of the calibration


class Nats(NamedTuple):
    """Sums over the judged steps of each recording: log-probabilities of staying or leaving as it did, and of where it went."""

    whether: Float[np.ndarray, " R"]
    where: Float[np.ndarray, " R"]

    @property
    def both(self) -> Float[np.ndarray, " R"]:
        return self.whether + self.where


class AgeClass(NamedTuple):
    """The share that leaves among the steps of an age whose bout was seen to begin."""

    first: int
    last: int | None
    steps: int
    observed: float
    chain: float
    model: float


class HeldOut(NamedTuple):
    """What the model and the chain of the folds that do not hold a recording say of it."""

    model: Nats
    chain: Nats
    fold: Int[np.ndarray, " R"]
    steps: Float[np.ndarray, " R"]  # judged
    changes: Float[np.ndarray, " R"]  # among them
    ages: list[AgeClass]


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


def evaluate(columns: Design, rows: Bool[np.ndarray, " N"] | None = None) -> HeldOut:
    """Fit on all but one fold in turn and predict that fold; the chain is fitted to the same steps, all or the `rows` alone."""
    steps, choices = columns.recordings.steps, columns.choices
    number, folds = len(columns.recordings.recordings), folds_of(columns.recordings)
    judged = np.ones(len(steps.code), dtype=bool) if rows is None else rows
    counts = counts_by_recording(columns.recordings, judged)
    times, changed_in = choices.weighed(judged[choices.change] * 1.0), steps.recording[choices.step]
    model, chain = Nats(*np.zeros((2, number))), Nats(*np.zeros((2, number)))
    by_age, fitted = np.zeros((len(AGES), 4)), None
    for fold in range(int(folds.max()) + 1):
        trained = folds != fold
        leaving = columns.leaving(trained)
        fitted = fit(columns, leaving, trained, judged, fitted)
        here = np.flatnonzero(judged & ~trained[steps.recording])
        whether, hazard = log_leaving(leaving, fitted.leaving, columns.left, here)
        model.whether[:] += np.bincount(steps.recording[here], whether, minlength=number)
        where = times * ~trained[changed_in] * log_going(choices, fitted.going)
        model.where[:] += np.bincount(changed_in, where, minlength=number)
        log_chain = smoothed_chain(counts, trained)[0]
        said = predict_chain(log_chain, ~trained[:, None, None] * counts)
        chain.whether[:] += said.whether
        chain.where[:] += said.where
        by_age += _by_age(steps.take(here), columns.left[here], hazard, -np.expm1(np.diag(log_chain)))
    ages = [
        AgeClass(first, last, int(size), *(float(total / size) for total in sums))
        for (first, last), (size, *sums) in zip(AGES, by_age, strict=True)
        if size
    ]
    changes = np.bincount(changed_in, times, minlength=number)
    return HeldOut(model, chain, folds, counts.sum(axis=(1, 2)), changes, ages)


def predict_chain(log_chain: Float[np.ndarray, "C C"], counts: Float[np.ndarray, "R C C"]) -> Nats:
    """Sum a chain's log P(c' | c) over the steps that were counted, split into whether to leave and where to go."""
    stay = np.diag(log_chain)
    log_hazard = np.log1p(-np.exp(stay))
    stays = np.eye(len(stay), dtype=bool)
    whether = np.where(stays, stay[:, None], log_hazard[:, None])
    where = np.where(stays, 0.0, log_chain - log_hazard[:, None])
    return Nats((counts * whether).sum(axis=(1, 2)), (counts * where).sum(axis=(1, 2)))


def _by_age(
    steps: Steps, left: Bool[np.ndarray, " Q"], hazard: Float[np.ndarray, " Q"], of_chain: Float[np.ndarray, " C"]
) -> Float[np.ndarray, "G 4"]:
    """Of each class of age: how many steps, how many left, and the sums of the chain's and of the model's hazard."""
    found = []
    for first, last in AGES:
        here = ~steps.unseen & (steps.age >= first)
        if last is not None:
            here &= steps.age <= last
        found.append((here.sum(), left[here].sum(), of_chain[steps.code[here]].sum(), hazard[here].sum()))
    return np.array(found, np.float64)


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


def jackknife(leave_one_out: Float[np.ndarray, "M *K"]) -> Float[np.ndarray, "*K"]:
    """Compute the standard error √((M − 1) / M Σ (θ₋ᵣ − θ̄)²) of coefficients, from M fits that leave out one recording each."""
    number = len(leave_one_out)
    return np.asarray(np.sqrt((number - 1) / number * ((leave_one_out - leave_one_out.mean(axis=0)) ** 2).sum(axis=0)))
