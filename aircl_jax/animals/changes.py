"""Test which changes are avoided: how often each was made beside how often it would be, were the pair ordinary."""

from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy import stats
from scipy.special import expit, logsumexp

from aircl_jax.animals.going import Choices, Weights, fit_going, utility
from envs.animals.full.steps import Recordings

SCATTER = 1.0  # σ: by how much, in nats, an ordinary pair may differ from what the model expects
PRIOR = 0.1  # share of the possible pairs that are forbidden before anything is seen
LAPSE = 0.01  # share of the expected number at which a forbidden pair may be made all the same
ROUNDS = 3  # of fitting without the flagged pairs and flagging anew
FLAGGED = 0.5  # posterior above which a pair is flagged
TESTABLE = 3.0  # expected times below which a pair's absence says little; Bonferroni counts the pairs above it
IN_RECORDING, IN_ANIMAL = 0.3, 0.1  # expected times from which a recording or an animal counts as one in which it could be

NODES, NODE_WEIGHTS = np.polynomial.hermite_e.hermegauss(41)
NODE_WEIGHTS = NODE_WEIGHTS / NODE_WEIGHTS.sum()


class Changes(NamedTuple):
    """Of every pair [from code, to code]: the test of whether it is avoided."""

    made: Float[np.ndarray, "C C"]  # n
    expected: Float[np.ndarray, "C C"]  # M, with the pair made ordinary
    log_bayes: Float[np.ndarray, "C C"]  # log P(n | forbidden) − log P(n | ordinary)
    posterior: Float[np.ndarray, "C C"]
    p: Float[np.ndarray, "C C"]  # P(at most n) under a Poisson law of mean M: optimistic, bouts and days cluster
    possible: Bool[np.ndarray, "C C"]
    recordings: Int[np.ndarray, "C C"]  # with an expected number above IN_RECORDING
    animals: Int[np.ndarray, "C C"]  # with an expected number above IN_ANIMAL

    @property
    def flagged(self) -> Bool[np.ndarray, "C C"]:
        return (self.posterior > FLAGGED) & self.possible

    @property
    def testable(self) -> Bool[np.ndarray, "C C"]:
        return (self.expected >= TESTABLE) & self.possible

    @property
    def bonferroni(self) -> float:
        """The p below which a flagged pair would be significant at 5 % among all testable pairs."""
        return 0.05 / max(int(self.testable.sum()), 1)


def log_bayes(
    made: Float[np.ndarray, "*s"], expected: Float[np.ndarray, "*s"], scatter: float = SCATTER
) -> Float[np.ndarray, "*s"]:
    """log Poisson(n; L) − log ∫ Poisson(n; M e^{σx}) N(x; 0, 1) dx, by Gauss–Hermite quadrature.

    The lapses L are .01 M, or fewer where .01 M is more than one and more than n: a ban that is kept better is still one.
    """
    mean = np.maximum(expected, 1e-12)
    rate = mean[..., None] * np.exp(NODES * scatter)
    allowed = np.asarray(logsumexp(made[..., None] * np.log(rate) - rate, b=NODE_WEIGHTS, axis=-1))
    lapses = np.minimum(LAPSE * mean, np.maximum(made, 1.0))
    return made * np.log(lapses) - lapses - allowed


def p_of(made: Float[np.ndarray, "*s"], expected: Float[np.ndarray, "*s"]) -> Float[np.ndarray, "*s"]:
    """Compute P(at most n) under a Poisson law of mean M."""
    return np.asarray(stats.poisson.cdf(made, np.maximum(expected, 1e-12)))


def avoided_changes(
    choices: Choices,
    recordings: Recordings,
    weight: Float[np.ndarray, " n"],
    scatter: float = SCATTER,
    prior: float = PRIOR,
    rounds: int = ROUNDS,
) -> Changes:
    """Fit where animals go with no effect of the pair, flag the pairs made too rarely, and fit anew without these.

    `weight` says how many changes each row of the choices stands for.

    M_cc' = Σ over the changes out of c of P(c' | place, neighbours, …), each pair as if it alone were not forbidden.
    """
    size = choices.possible.shape[1]
    made, log_odds = np.zeros((size, size)), np.log(prior / (1.0 - prior))
    np.add.at(made, (choices.left, choices.chosen), weight)
    possible = np.zeros((size, size), dtype=bool)
    np.logical_or.at(possible, choices.left[weight > 0], choices.possible[weight > 0])
    flagged = np.zeros_like(possible)
    found = _one_round(choices, weight, made, flagged, None, scatter)
    for _ in range(rounds - 1):
        flagged = (expit(found.log_bayes + log_odds) > FLAGGED) & possible
        found = _one_round(choices, weight, made, flagged, found.weights, scatter)
    steps = recordings.steps
    recording, animal = (column[choices.step] for column in (steps.recording, steps.track))
    return Changes(
        made,
        found.expected,
        found.log_bayes,
        expit(found.log_bayes + log_odds) * possible,
        p_of(made, found.expected),
        possible,
        _number_above(choices, found.share * weight[:, None], recording, IN_RECORDING),
        _number_above(choices, found.share * weight[:, None], animal, IN_ANIMAL),
    )


class _Round(NamedTuple):
    weights: Weights
    share: Float[np.ndarray, "n C"]
    expected: Float[np.ndarray, "C C"]
    log_bayes: Float[np.ndarray, "C C"]


def _one_round(
    choices: Choices,
    weight: Float[np.ndarray, " n"],
    made: Float[np.ndarray, "C C"],
    flagged: Bool[np.ndarray, "C C"],
    start: Weights | None,
    scatter: float,
) -> _Round:
    weights = fit_ordinary(choices, weight, flagged, start)
    share = ordinary_share(choices, weights, flagged)
    expected = expected_times(choices, share, weight)
    return _Round(weights, share, expected, log_bayes(made, expected, scatter))


def fit_ordinary(
    choices: Choices, weight: Float[np.ndarray, " n"], flagged: Bool[np.ndarray, "C C"], start: Weights | None = None
) -> Weights:
    """Fit the reward of where to go with the flagged pairs ruled out, but where they were made."""
    return fit_going(ruled_out(choices, flagged), weight, start)


def ruled_out(choices: Choices, flagged: Bool[np.ndarray, "C C"]) -> Choices:
    """Take the flagged pairs from what is possible, but where they were made."""
    possible = choices.possible & ~flagged[choices.left]
    possible[np.arange(len(possible)), choices.chosen] = True
    return choices._replace(possible=possible)


def ordinary_share(choices: Choices, weights: Weights, flagged: Bool[np.ndarray, "C C"]) -> Float[np.ndarray, "n C"]:
    """Compute P(c' | x) at every row of changes: flagged codes do not compete, but each as if it alone were ordinary."""
    values = utility(choices, weights)
    barred = flagged[choices.left]
    competing = np.where(choices.possible & ~barred, values, -np.inf)
    total = np.asarray(logsumexp(competing, axis=1, keepdims=True))
    share = np.where(barred, np.exp(values - np.logaddexp(values, total)), np.exp(values - total))
    return np.where(choices.possible, share, 0.0)


def expected_times(
    choices: Choices, share: Float[np.ndarray, "n C"], weight: Float[np.ndarray, " n"]
) -> Float[np.ndarray, "C C"]:
    """Sum the shares of every pair over the changes out of its first code."""
    expected = np.zeros((share.shape[1], share.shape[1]))
    np.add.at(expected, choices.left, share * weight[:, None])
    return expected


def _number_above(
    choices: Choices, share: Float[np.ndarray, "n C"], group: Int[np.ndarray, " n"], least: float
) -> Int[np.ndarray, "C C"]:
    """Count, for each pair, the groups of changes (recordings, animals) with an expected number above `least`."""
    size = share.shape[1]
    names, index = np.unique(group, return_inverse=True)
    expected = np.zeros((len(names), size, size))
    np.add.at(expected, (index, choices.left), share)
    return (expected > least).sum(axis=0)


class Halves(NamedTuple):
    """Pairs chosen on one half of the recordings, and how often the other half made them, beside the expected number."""

    pairs: float
    made: float
    expected: float

    @property
    def rate(self) -> float:
        return self.made / self.expected if self.expected else float("nan")


def judge_on_halves(choices: Choices, recordings: Recordings, halves: int = 6) -> dict[str, Halves]:
    """Flag pairs on a random half of the recordings and count them on the other; means over `halves` splits.

    `never made` are the pairs of which .5 or more were expected, none was made, and that were not flagged.
    """
    recording, times = recordings.steps.recording[choices.step], choices.times
    draws = np.random.default_rng(0)
    totals: dict[str, list[tuple[float, float, float]]] = {"flagged": [], "never made, not flagged": []}
    for _ in range(halves):
        order = draws.permutation(len(recordings.recordings))
        first = times * np.isin(recording, order[: len(order) // 2])
        found = avoided_changes(choices, recordings, first)
        weights = fit_ordinary(choices, first, found.flagged)
        share = ordinary_share(choices, weights, found.flagged)
        other = times - first
        expected = expected_times(choices, share, other)
        made = np.zeros_like(expected)
        np.add.at(made, (choices.left, choices.chosen), other)
        never = (found.made == 0) & (found.expected > 0.5) & found.possible & ~found.flagged
        for name, pairs in (("flagged", found.flagged), ("never made, not flagged", never)):
            totals[name].append((float(pairs.sum()), float(made[pairs].sum()), float(expected[pairs].sum())))
    return {name: Halves(*np.mean(values, axis=0).tolist()) for name, values in totals.items()}
