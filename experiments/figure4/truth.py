"""Compare the functions recovered on simulated meerkats with the reward and the constraint that generated the data."""

from collections.abc import Mapping
from typing import Any, cast

import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool, Float, Int

from aircl_jax.algorithm.measures import auroc
from aircl_jax.analysis.recovered import LEAST_EXPECTED, expected
from aircl_jax.reports import markdown
from envs.animals.simulated_meerkats import Truth
from experiments.figure4.cells import Study, from_json
from experiments.shared.paired_tests import spread

MEASURED = ("reward_correlation", "feasibility_auroc", "feasibility_gap")
RATES = ("violation_rate", "violation_rate_policy")
NOTE = """\
Changes are tested where chance would have shown them 5 times; `—` is undefined. *Counting* learns nothing. Its reward is the
log share of a pair among those of its first code in the demonstrations; its first column is over their steps. Its feasibility
is the number of cases of a change per case expected by chance. In a world from code to code, f tends to log π_E plus a constant
and z₁ to the log of a ratio of frequencies, so that both repeat counting, smoothed by a small network."""


def against_truth(study: Study, cells: Mapping[str, Mapping[str, Any]]) -> str:
    """Tabulate each method's recovered reward and constraint beside the simulated meerkats' own."""
    truth = cast(Truth, study.herd.truth)
    heads = ("", "corr(f, r), π's feasible steps", "each seen pair once", "without going on", "AUROC of δ̄, windows", "gap")
    heads += ("AUROC of δ₁, changes", "violations, q", "π")
    rows = []
    moved = ~np.eye(len(truth.reward), dtype=bool)
    for name, cell in cells.items():
        recovered, measured = from_json(cell["recovered"]), cell["metrics"]
        seen = (recovered.seen > 0) & ~truth.forbidden
        among = (seen, seen & moved)
        by_pair, by_change = (
            spread([_correlation(reward[pairs], truth.reward[pairs]) for reward in recovered.reward], 2) for pairs in among
        )
        _, testable = _chance(recovered.seen, truth)
        ranked = [_auroc(delta[testable], ~truth.forbidden[testable]) for delta in recovered.delta]
        reward, windows, gap = (spread(measured[key]["per_seed"], 3) for key in MEASURED)
        rates = [spread(measured[key]["per_seed"], 3) for key in RATES]
        rows.append((name, reward, by_pair, by_change, windows, gap, spread(ranked, 2), *rates))
    correlations, ranking = _by_counting(study, truth, moved)
    rows.append(("*counting*", *correlations, "", "", ranking, "", ""))
    return "\n\n".join([markdown.table(heads, rows), NOTE])


def _chance(seen: Int[np.ndarray, "C C"], truth: Truth) -> tuple[Float[np.ndarray, "C C"], Bool[np.ndarray, "C C"]]:
    """Return how often chance would have shown each change, and whether that is often enough to test it."""
    cases = expected(seen, truth.structural)
    return cases, (cases >= LEAST_EXPECTED) & ~truth.structural


def _by_counting(study: Study, truth: Truth, moved: Bool[np.ndarray, "C C"]) -> tuple[list[str], str]:
    """Score counting, which learns nothing.

    Returns the correlations of a pair's log share with the reward, and the AUROC of a change's cases per expected case.
    """
    code = study.herd.windows.code
    seen = np.zeros(truth.reward.shape, dtype=np.int64)
    np.add.at(seen, (code[:, :-1], code[:, 1:]), 1)
    log_share = np.log(np.where(seen > 0, seen, 1.0) / np.maximum(seen.sum(axis=1, keepdims=True), 1.0))
    allowed = (seen > 0) & ~truth.forbidden
    once = [f"{_correlation(log_share[among], truth.reward[among]):.2f}" for among in (allowed, allowed & moved)]
    times = seen[allowed]
    by_step = _correlation(np.repeat(log_share[allowed], times), np.repeat(truth.reward[allowed], times))
    expected, testable = _chance(seen, truth)
    ranking = _auroc(seen[testable] / expected[testable], ~truth.forbidden[testable])
    return [f"{by_step:.3f}", *once], f"{ranking:.2f}"


def _correlation(learned: Float[np.ndarray, " K"], true: Float[np.ndarray, " K"]) -> float:
    return float(np.corrcoef(learned, true)[0, 1]) if np.isfinite(learned).all() and np.ptp(learned) > 0 else float("nan")


def _auroc(score: Float[np.ndarray, " K"], positive: Bool[np.ndarray, " K"]) -> float:
    if not np.isfinite(score).all():
        return float("nan")
    return float(auroc(jnp.asarray(score), jnp.asarray(positive, float), jnp.asarray(~positive, float)))
