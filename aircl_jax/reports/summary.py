"""Make the content of summary.json: every measure's mean, standard deviation and seeds, and the timing."""

import platform
from collections.abc import Collection, Mapping, Sequence
from importlib.metadata import version
from typing import Any

import numpy as np

from aircl_jax.runs.loop import since_of
from aircl_jax.runs.metrics_log import is_number, numbers
from aircl_jax.runs.seeds import devices
from aircl_jax.runs.spec import RunSpec

MEANINGS = {
    "violation_rate": "share of timesteps that violate, samples of q (the paper's)",
    "violation_rate_policy": "the same, samples of the policy",
    "violation_rate_expert": "the same, demonstrations",
    "infeasible_share": "share of trajectories that are infeasible, samples of q",
    "infeasible_share_policy": "the same, samples of the policy",
    "rc_acc": "share of the demonstrations with D > ½ (the paper's)",
    "balanced_acc": "mean of D's accuracy on demonstrations and on fresh samples",
    "feasibility_auroc": "does δ̄ rank feasible trajectories above infeasible ones",
    "feasibility_gap": "mean δ̄ of feasible minus of infeasible trajectories",
    "step_feasibility_auroc": "does δ₁ rank feasible steps above violating ones, on the same set",
    "goal_rate": "share of episodes that end in the goal",
    "expert_goal_rate": "the same, demonstrations",
    "return": "true return of the policy",
    "return_sampled": "true return of q",
    "expert_return": "true return of the demonstrations",
    "feasible_return": "true return of the policy up to its first violation",
    "violation_reward_only": "violation rate of the soft-optimal policy of f alone",
    "reward_correlation": "correlation of f with the true reward",
    "reward_correlation_reference": "the same, on the reference set",
    "occupancy_tv": "total variation between the expert's and the policy's state occupancy",
    "effective_sample_size": "of the resampling, as a share of the pool",
    "feasibility_expert": "mean δ̄ of the demonstrations",
    "feasibility_policy": "mean δ̄ of the policy's samples",
    "logit_size": "mean size of the discriminator's logit",
    "entropy": "of the policy, per step",
    "log_std_at_bound": "share of the policy's log σ that stand at a bound",
}
ANIMAL_MEANINGS = {  # of recorded animals: aircl_jax.algorithm.learners.likelihood
    "chain_gain": "log-probability of the demonstrations' next codes under π, less that of a first-order chain; both saw them",
    "log_prob": "log-probability a step of the demonstrations' next codes under π",
    "held_out_chain_gain": "nats a step over a smoothed first-order chain, on recordings that the seed did not draw",
    "held_out_whether_gain": "of it: whether to leave",
    "held_out_where_gain": "where to go, nats a change",
    "held_out_log_prob": "log-probability a step on recordings that the seed did not draw",
    "held_out_recordings": "how many recordings the seed did not draw",
}
LIMIT_MEANINGS = {  # of rows with a twin: aircl_jax.algorithm.boxes
    "moment_gap": "least root mean square of E_E φ − E_π φ until the constraint began, in demonstrated standard deviations",
    "gap_at_end": "root mean square of E_E φ − E_π φ of the final policy, on fresh episodes",
    "rechosen": "how often f was chosen anew, because π had left the demonstrations by it",
    "strayed": "share of the policy's steps beyond the demonstrations' range by more than it may stray in practice",
    "untested": "share of the limits of which none was drawn",
}
SWAP_MEANINGS = {  # of a run on a grid: aircl_jax.transfer.table_tests
    "self_return": "score of planning on (f, δ) in the same world: 0 the uniform policy's return, 1 the truth's",
    "self_violation": "episodes that violate in that plan, less those of the truth's plan",
    "transfer_return": "score of planning on (f, δ) in eight changed worlds, their mean",
    "transfer_return_worst": "the same, in the worst of them",
    "transfer_violation": "episodes that violate in those plans, less those of the truth's plans",
    "constraint_transfer_return": "score of planning on other, known rewards under δ",
    "constraint_transfer_violation": "episodes that violate in those plans, less those of the truth's plans",
    "reward_transfer_return": "score of planning on f under another, known constraint",
    "lift": "what the plan of f alone gains over the constrained plan, as a share of what r alone gains",
    "lift_violation": "episodes that violate in the plan of f alone, over those of r alone",
    "split": "steps that violate in the soft plan of f alone, over those of r alone: 1 right, 0 f holds the constraint",
    "reward_distance": "of f from the true reward: 0 the same up to shaping and scale, 0.71 unrelated",
    "constraint_precision": "share of the cells with δ₁ < ½ that are forbidden",
    "constraint_recall": "share of the forbidden cells with δ₁ < ½",
    "constraint_iou": "intersection over union of the cells with δ₁ < ½ and the forbidden ones",
}


def meaning(name: str) -> str:
    """Say what a measure is."""
    if name.startswith("recovered_limit/"):
        return "where δ₁ begins to forbid"
    return (MEANINGS | ANIMAL_MEANINGS | LIMIT_MEANINGS | SWAP_MEANINGS).get(name, "")


def statistics(per_seed: Sequence[Any] | np.ndarray, left_out: Collection[int] = ()) -> dict[str, Any]:
    """Compute mean and standard deviation beside every seed; both are undefined if any seed is.

    The seeds at the places `left_out` are undefined, and mean and deviation are `of` the others, whose number is given.
    """
    values = np.asarray(per_seed, np.float64)
    values[list(left_out)] = np.nan
    of = np.delete(values, list(left_out))
    with np.errstate(invalid="ignore"):  # of undefined seeds
        mean, std = numbers([of.mean() if len(of) else np.nan, of.std(ddof=1) if len(of) > 1 else np.nan])
    return {"mean": mean, "std": std, "per_seed": numbers(values)} | ({"of": len(of)} if left_out else {})


def summarise(spec: RunSpec, final: Mapping[str, np.ndarray], timing: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    """Make summary.json from the metrics at the end, [S] each, and one line of timing a chunk.

    The speed is taken from the end of the first chunk to the end of the last. It leaves out the first chunk of each
    session, which compiles. `not_finite` has the first iteration in which a number of a seed was not finite.
    """
    since = since_of(timing) or [None] * len(spec.seeds)
    lost = [place for place, iteration in enumerate(since) if iteration is not None]
    steady = [line for line in timing if not line["first"]]
    seconds = sum(line["seconds"] - line["compile_s"] for line in steady)
    return {
        "env": spec.env.title,
        "method": spec.method_name,
        "seeds": list(spec.seeds),
        "iterations": spec.config.iterations,
        "env_steps": spec.config.iterations * spec.env_steps,
        "wall_s": round(sum(line["seconds"] for line in timing), 3),
        "compile_s": round(sum(line["compile_s"] for line in timing), 3),
        "env_steps_per_s": round(sum(line["env_steps"] for line in steady) / seconds, 1) if seconds else None,
        "versions": versions(),
        "not_finite": {str(spec.seeds[place]): since[place] for place in lost},
        "metrics": {name: statistics(final[name], lost) for name in sorted(final, key=_rank)},
    }


def fits(summary: Mapping[str, Any], spec: RunSpec) -> bool:
    """Say whether a summary that was read from a file is one of this run."""
    same = summary.get("seeds") == list(spec.seeds) and summary.get("iterations") == spec.config.iterations
    texts = all(isinstance(summary.get(name), str) for name in ("env", "method"))
    effort = all(is_number(summary.get(name, "")) for name in ("env_steps", "wall_s", "compile_s", "env_steps_per_s"))
    metrics, since = summary.get("metrics"), summary.get("not_finite", {})
    whole = isinstance(metrics, dict) and bool(metrics) and all(_is_statistics(row, spec) for row in metrics.values())
    return same and texts and effort and whole and isinstance(since, dict) and all(map(is_number, since.values()))


def _is_statistics(row: Any, spec: RunSpec) -> bool:
    if not isinstance(row, dict) or not {"mean", "std", "per_seed"} <= row.keys():
        return False
    values = row["per_seed"]
    one_each = isinstance(values, list) and len(values) == len(spec.seeds) and all(map(is_number, values))
    return one_each and is_number(row["mean"]) and is_number(row["std"])


def versions() -> dict[str, str]:
    packages = ("aircl-jax", "jax", "jaxlib", "flax", "optax", "distrax", "mujoco", "mujoco-mjx", "numpy")
    return {
        "python": platform.python_version(),
        **{package: version(package) for package in packages},
        "devices": devices(),
    }


def _rank(name: str) -> tuple[int, str]:
    names = [*MEANINGS, *ANIMAL_MEANINGS, *SWAP_MEANINGS]
    return (names.index(name) if name in names else len(names), name)
