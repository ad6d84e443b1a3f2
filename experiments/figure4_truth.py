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


def against_truth(study: Study, cells: Mapping[str, Mapping[str, Any]]) -> str:
    """Of each method's cell: recovered reward and constraint beside the simulated mob's own."""
    truth = cast(Truth, study.herd.truth)
    heads = ("", "corr(f, r), visited steps", "corr(f, r), each seen change once", "AUROC of δ̄, windows", "gap")
    heads += ("AUROC of δ₁, changes", "violations, q", "π")
    lines = [f"| {' | '.join(heads)} |", "|---" * len(heads) + "|"]
    for name, cell in cells.items():
        recovered, measured = from_json(cell["recovered"]), cell["metrics"]
        seen = (recovered.seen > 0) & ~truth.forbidden
        by_change = [_correlation(one[seen], truth.reward[seen]) for one in recovered.reward]
        judged = (preferences.expected(recovered.seen, truth.structural) >= preferences.LEAST_EXPECTED) & ~truth.structural
        ranked = [_auroc(one[judged], ~truth.forbidden[judged]) for one in recovered.delta]
        reward, windows, gap = (spread(measured[key]["per_seed"], 3) for key in MEASURED)
        rates = [spread(measured[key]["per_seed"], 3) for key in RATES]
        row = (name, reward, spread(by_change, 2), windows, gap, spread(ranked, 2), *rates)
        lines.append(f"| {' | '.join(row)} |")
    return "\n".join([*lines, "", "Changes are judged where chance would have shown them 5 times; `—` is undefined."])


def _correlation(found: Float[np.ndarray, " K"], true: Float[np.ndarray, " K"]) -> float:
    return float(np.corrcoef(found, true)[0, 1]) if np.isfinite(found).all() and np.ptp(found) > 0 else float("nan")


def _auroc(score: Float[np.ndarray, " K"], positive: Bool[np.ndarray, " K"]) -> float:
    if not np.isfinite(score).all():
        return float("nan")
    return float(auroc(jnp.asarray(score), jnp.asarray(positive, float), jnp.asarray(~positive, float)))
