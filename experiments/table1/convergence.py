"""Test whether our learning curves have settled, and whether the paper's values are those of runs stopped early."""

from typing import NamedTuple

import numpy as np

from experiments.shared.paper import COLUMNS, METHODS_OF_THE_PAPER, PAPER, PRINTED, Printed
from experiments.table1.cells import Cell, Study
from experiments.table1.claim_rules import Finding, Verdict, of_enough_seeds

RULE = (
    "Curves are means over seeds at the evaluations; 0 is the untrained policy. Near: every measure that the paper prints for "
    "the row is within the paper's standard deviation of the paper's mean. Holds: near at some evaluation, and not at the end. "
    "Does not hold: near at the end, or never."
)
STILL = 0.005  # largest change of the violation rate that counts as none


class Passage(NamedTuple):
    """A curve's first and last value, and the iteration of its first evaluation beyond a given value (None: never)."""

    start: float
    end: float
    iteration: int | None

    @property
    def words(self) -> str:
        if self.iteration is None:
            return f"{self.start:.3f} → {self.end:.3f}, never passes"
        return f"{self.start:.3f} → {self.end:.3f}, passes at {self.iteration}"


def curve(cell: Cell, metric: str) -> tuple[np.ndarray, np.ndarray]:
    """Return the evaluated iterations and the mean over seeds, without the iterations at which it is undefined."""
    iterations = np.array(cell["curves"]["iteration"])
    rows = cell["curves"].get(metric, [])
    values = np.array([[np.nan if value is None else value for value in row] for row in rows], float)
    mean = values.mean(axis=1) if len(values) else np.full(len(iterations), np.nan)
    defined = np.isfinite(mean)
    return iterations[defined], mean[defined]


def passage(iterations: np.ndarray, mean: np.ndarray, value: float) -> Passage:
    """Find the first evaluation that reaches the value, or lies on the other side of it than the curve's start."""
    beyond = (mean - value) * (mean[0] - value) <= 0
    first = int(iterations[beyond.argmax()]) if beyond.any() else None
    return Passage(float(mean[0]), float(mean[-1]), first)


def near(cell: Cell, printed: Printed) -> dict[int, bool]:
    """Return {iteration: whether every printed measure is within the paper's standard deviation of the paper's mean}.

    Iterations at which a measure is undefined are left out.
    """
    all_near: dict[int, bool] | None = None
    for metric, (value, std) in printed.items():
        iterations, mean = curve(cell, metric)
        here = {int(step): bool(abs(ours - value) <= std) for step, ours in zip(iterations, mean, strict=True)}
        all_near = here if all_near is None else {step: all_near[step] and here[step] for step in all_near if step in here}
    return all_near or {}


def settled(cell: Cell) -> str:
    """Say whether the violation rate of π has settled: yes, no, or — with fewer than eight evaluations."""
    curve = np.array(cell["curves"].get("violation_rate_policy", []), float)
    if len(curve) < 8:
        return "—"
    mean, quarter = curve.mean(axis=1), len(curve) // 4
    change = abs(mean[-quarter:].mean() - mean[-2 * quarter : -quarter].mean())
    spread = curve[-1].std(ddof=1) if curve.shape[1] > 1 else 0.0
    return "yes" if change <= max(spread, STILL) else "no"


def findings(study: Study) -> list[Finding]:
    """Judge each row and environment of the paper's table."""
    return [_finding(study, env, method) for env in COLUMNS for method in METHODS_OF_THE_PAPER]


def _finding(study: Study, env: str, method: str) -> Finding:
    cell, printed = study.cells.get((env, method)), PAPER[env][method]
    if cell is None:
        return Finding(env, method, "—", "cannot be told", f"cells missing: {method}")
    words = []
    for metric in PRINTED:
        iterations, mean = curve(cell, metric)
        if metric in printed and len(mean):
            words.append(f"{metric} {printed[metric][0]:.3f}: ours {passage(iterations, mean, printed[metric][0]).words}")
    close = near(cell, printed)
    if not close:
        return Finding(env, method, "; ".join(words) or "—", "cannot be told", "no curve of all that the paper prints")
    steps = [step for step, is_near in close.items() if is_near]
    span = f"near first at {steps[0]}, last at {steps[-1]}" if steps else "never near"
    measured = "; ".join([*words, f"{span}, of {cell['iterations']} iterations"])
    at_end = close[max(close)]
    verdict: Verdict = "holds" if steps and not at_end else "does not hold"
    return of_enough_seeds(Finding(env, method, measured, verdict, "near at the end" if at_end else ""), len(cell["seeds"]))
