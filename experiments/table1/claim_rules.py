"""Judge a claim from the cells by one of three rules; each verdict is holds, does not hold or cannot be told."""

from collections.abc import Mapping, Sequence
from typing import Literal, NamedTuple, Protocol

import numpy as np

from aircl_jax.reports.summary import statistics
from experiments.shared.paired_tests import FEWEST_SEEDS, SIGNIFICANCE, Gain, gain, holm, interval, mean
from experiments.shared.paper import COLUMNS, METHODS_OF_THE_PAPER, PAPER
from experiments.table1.cells import Study

Verdict = Literal["holds", "does not hold", "cannot be told"]
LOWER_IS_BETTER = ("violation_rate", "violation_rate_policy", "logit_size")


class Finding(NamedTuple):
    """One line of evidence."""

    env: str
    what: str
    measured: str
    verdict: Verdict
    because: str = ""


def overall(findings: Sequence[Finding]) -> Verdict:
    """Return the verdict of more than half of the lines; lines that cannot be told count as lines."""
    for verdict in ("holds", "does not hold"):
        if sum(finding.verdict == verdict for finding in findings) * 2 > len(findings):
            return verdict
    return "cannot be told"


def of_enough_seeds(finding: Finding, seeds: int) -> Finding:
    """Return the finding, or the verdict that it cannot be told where the seeds are too few."""
    if seeds >= FEWEST_SEEDS:
        return finding
    return finding._replace(verdict="cannot be told", because=f"{seeds} seeds are too few")


class Contrast(NamedTuple):
    """Rule that one row is better than another: a paired test on each measure in each environment, Holm over all."""

    better: str
    worse: str
    metrics: tuple[str, ...] = ("rc_acc", "violation_rate")
    envs: tuple[str, ...] = COLUMNS

    rule = (
        "Holds: better by the test (Wilcoxon over seeds, or by exchanging seeds between both rows where they have none in "
        "common, Holm over all that two rows are compared in, p < 0.05). Does not hold: worse by that test, or no difference "
        "shown and one as large as the paper's lies beyond the bootstrap interval. Cannot be told: neither."
    )

    def findings(self, study: Study) -> list[Finding]:
        places = [(env, metric) for env in self.envs for metric in self.metrics]
        gains = {place: self._gain(study, *place) for place in places}
        p_values = {place: found.p for place, found in gains.items() if found is not None}
        adjusted = dict(zip(p_values, holm(list(p_values.values())), strict=True))
        return [self._finding(study, place, gains[place], adjusted.get(place, 1.0)) for place in places]

    def _gain(self, study: Study, env: str, metric: str) -> Gain | None:
        """Compute the gain of `better` over `worse`; None where a cell is missing or the measure is undefined."""
        column = study.column(env, metric, (self.better, self.worse))
        if len(column) < 2:
            return None
        higher, lower = (self.worse, self.better) if metric in LOWER_IS_BETTER else (self.better, self.worse)
        return gain(column[higher], column[lower])

    def _finding(self, study: Study, place: tuple[str, str], found: Gain | None, p: float) -> Finding:
        env, metric = place
        what = f"{metric}: {self.better} before {self.worse}"
        absent = missing(study, env, (self.better, self.worse))
        if found is None:
            return Finding(env, what, "—", "cannot be told", absent or "undefined")
        printed = self._printed(env, metric)
        sides = " against ".join(mean_std(study, env, metric, method) for method in (self.better, self.worse))
        spread = f" [{found.bounds[0]:+.3f}, {found.bounds[1]:+.3f}]" if found.bounds else ""
        theirs = "" if printed is None else f"; the paper's gain {printed:+.3f}"
        seeds = "" if found.paired else ", other seeds"
        measured = f"{sides}; gain {found.mean:+.3f}{spread}, p = {p:.2g}{seeds}{theirs}"
        verdict: tuple[Verdict, str] = "cannot be told", "no difference shown"
        if p < SIGNIFICANCE:
            verdict = ("holds", "") if found.mean > 0 else ("does not hold", "worse")
        elif found.bounds and printed is not None and printed > 0 and found.bounds[1] < printed:
            verdict = "does not hold", "no difference shown, and one like the paper's is excluded"
        return of_enough_seeds(Finding(env, what, measured, *verdict), found.seeds)

    def _printed(self, env: str, metric: str) -> float | None:
        both = [PAPER[env].get(method, {}).get(metric) for method in (self.better, self.worse)]
        if both[0] is None or both[1] is None:
            return None
        gain = both[0][0] - both[1][0]
        return -gain if metric in LOWER_IS_BETTER else gain


class Bound(NamedTuple):
    """Rule that a measure of a row keeps each environment's limit, by its bootstrap interval."""

    method: str
    metric: str
    limits: Mapping[str, float]
    most: bool  # True: the limit is an upper one
    reason: str = ""  # where the limit comes from

    rule = (
        "Holds: the bootstrap interval of the mean lies within. Does not hold: all of it lies beyond. "
        "Cannot be told: otherwise."
    )

    def findings(self, study: Study) -> list[Finding]:
        return [self._finding(study, env, limit) for env, limit in self.limits.items()]

    def _finding(self, study: Study, env: str, limit: float) -> Finding:
        sign, reason = "≤" if self.most else "≥", f", {self.reason}" if self.reason else ""
        what = f"{self.metric} of {self.method} {sign} {limit:.3g}{reason}"
        absent = missing(study, env, (self.method,))
        if absent:
            return Finding(env, what, "—", "cannot be told", absent)
        values = list(study.column(env, self.metric, (self.method,))[self.method].values())
        bounds = interval(values)
        if bounds is None:
            return Finding(env, what, "—", "cannot be told", "undefined")
        measured = f"{mean_std(study, env, self.metric, self.method)} [{bounds[0]:.3f}, {bounds[1]:.3f}]"
        within = [bound <= limit if self.most else bound >= limit for bound in bounds]
        verdict: Verdict = "holds" if all(within) else "cannot be told" if any(within) else "does not hold"
        return of_enough_seeds(Finding(env, what, measured, verdict), len(values))


class Harder(NamedTuple):
    """Rule that every row of the paper violates more in one environment than in another, by means of rows with both."""

    env: str
    than: str

    rule = "Holds: the mean of every row of the paper is worse. Does not hold: of half or fewer. Cannot be told: otherwise."

    def findings(self, study: Study) -> list[Finding]:
        here, there = (study.column(env, "violation_rate", METHODS_OF_THE_PAPER) for env in (self.env, self.than))
        both = [(mean(here[method]), mean(there[method])) for method in here if method in there]
        pairs = [(harder, easier) for harder, easier in both if harder is not None and easier is not None]
        what = f"violation_rate higher than on {self.than}"
        absent = missing(study, self.env, METHODS_OF_THE_PAPER) or missing(study, self.than, METHODS_OF_THE_PAPER)
        if absent or not pairs:
            return [Finding(self.env, what, "—", "cannot be told", absent or "undefined")]
        worse, rows = sum(harder > easier for harder, easier in pairs), len(pairs)
        verdict: Verdict = "holds" if worse == rows else "does not hold" if 2 * worse <= rows else "cannot be told"
        return [of_enough_seeds(Finding(self.env, what, f"{worse} of {rows} rows", verdict), min(map(len, here.values())))]


class Rule(Protocol):
    """What judges a claim: lines of evidence, each with its verdict."""

    def findings(self, study: Study) -> Sequence[Finding]: ...


def missing(study: Study, env: str, methods: Sequence[str]) -> str:
    """Name the missing ones of these cells; empty where none is missing."""
    absent = [method for method in methods if (env, method) not in study.cells]
    return f"cells missing: {', '.join(absent)}" if absent else ""


def mean_std(study: Study, env: str, metric: str, method: str) -> str:
    values = study.column(env, metric, (method,))[method]
    row = statistics([np.nan if value is None else value for value in values.values()])
    return "—" if row["mean"] is None else f"{row['mean']:.3f}" + ("" if row["std"] is None else f" ± {row['std']:.3f}")
