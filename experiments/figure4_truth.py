"""What was recovered on the simulated mob beside the reward and the constraint that it was drawn with."""

from collections.abc import Mapping
from typing import Any, cast

import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool, Float

from aircl_jax import preferences
from aircl_jax.metrics import auroc
from envs.mob import Truth
from experiments.comparison import spread
from experiments.figure4_cells import Study, from_json

MEASURED = ("reward_correlation", "feasibility_auroc", "feasibility_gap")
RATES = ("violation_rate", "violation_rate_policy")
NOTE = """\
Changes are judged where chance would have shown them 5 times; `—` is undefined. *Log frequency* learns nothing: log of the
share of a pair among those of its first code, in the demonstrations (its first column is over their steps). Where the world
is code to code, f comes to be log π_E and a constant, so that it says of the reward what frequencies say, less what a small
network smooths away."""


def against_truth(study: Study, cells: Mapping[str, Mapping[str, Any]]) -> str:
    """Of each method's cell: recovered reward and constraint beside the simulated mob's own."""
    truth = cast(Truth, study.herd.truth)
    heads = ("", "corr(f, r), π's feasible steps", "each seen pair once", "without going on", "AUROC of δ̄, windows", "gap")
    heads += ("AUROC of δ₁, changes", "violations, q", "π")
    lines = [f"| {' | '.join(heads)} |", "|---" * len(heads) + "|"]
    moved = ~np.eye(len(truth.reward), dtype=bool)
    for name, cell in cells.items():
        recovered, measured = from_json(cell["recovered"]), cell["metrics"]
        seen = (recovered.seen > 0) & ~truth.forbidden
        among = (seen, seen & moved)
        by_pair, by_change = (
            spread([_correlation(one[pairs], truth.reward[pairs]) for one in recovered.reward], 2) for pairs in among
        )
        judged = (preferences.expected(recovered.seen, truth.structural) >= preferences.LEAST_EXPECTED) & ~truth.structural
        ranked = [_auroc(one[judged], ~truth.forbidden[judged]) for one in recovered.delta]
        reward, windows, gap = (spread(measured[key]["per_seed"], 3) for key in MEASURED)
        rates = [spread(measured[key]["per_seed"], 3) for key in RATES]
        row = (name, reward, by_pair, by_change, windows, gap, spread(ranked, 2), *rates)
        lines.append(f"| {' | '.join(row)} |")
    lines.append(f"| *log frequency* | {' | '.join(_of_frequencies(study, truth, moved))} |" + " |" * 5)
    return "\n".join([*lines, "", NOTE])


def _of_frequencies(study: Study, truth: Truth, moved: Bool[np.ndarray, "C C"]) -> tuple[str, ...]:
    """What the logarithm of a pair's share among its first code's own says of the reward, with no learning at all."""
    code = study.herd.windows.code
    seen = np.zeros_like(truth.reward)
    np.add.at(seen, (code[:, :-1], code[:, 1:]), 1.0)
    log_share = np.log(np.where(seen > 0, seen, 1.0) / np.maximum(seen.sum(axis=1, keepdims=True), 1.0))
    allowed = (seen > 0) & ~truth.forbidden
    once = (f"{_correlation(log_share[among], truth.reward[among]):.2f}" for among in (allowed, allowed & moved))
    times = seen[allowed].astype(int)
    by_step = _correlation(np.repeat(log_share[allowed], times), np.repeat(truth.reward[allowed], times))
    return f"{by_step:.3f}", *once


def _correlation(found: Float[np.ndarray, " K"], true: Float[np.ndarray, " K"]) -> float:
    return float(np.corrcoef(found, true)[0, 1]) if np.isfinite(found).all() and np.ptp(found) > 0 else float("nan")


def _auroc(score: Float[np.ndarray, " K"], positive: Bool[np.ndarray, " K"]) -> float:
    if not np.isfinite(score).all():
        return float("nan")
    return float(auroc(jnp.asarray(score), jnp.asarray(positive, float), jnp.asarray(~positive, float)))
