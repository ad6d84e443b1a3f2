"""Write the card of a row with a twin: which coordinates it wants, the limits that it keeps, what was never tested."""

from typing import Any

import numpy as np
from jaxtyping import Float

from aircl_jax.algorithm.boxes.action_limits import EDGES
from aircl_jax.algorithm.boxes.state_limits import scale_of
from aircl_jax.analysis.recovered_limits import Limits, recovered_limits
from aircl_jax.runs.result import Result
from envs import Box

LEAST_WEIGHT = 0.01  # of ‖θ‖: a feature about which nothing is said
SEEDS_AGREE = 0.5  # share of the seeds that must draw a limit for it to be listed
_OF_ACTIONS = (
    (
        "An action counts as beyond a limit where it is taken less than {share:.0%} as often as a policy of f alone would take "
        "it in the same states. A demonstrator who errs more often than that hides a limit."
    ),
    (
        "f is of states alone. A dislike of large actions, which no state shows, reads as a limit where it is strong; so does "
        "a habit that no reward of states asks for."
    ),
    "Limits of states were not looked for.",
)
_OF_STATES = (
    (
        "A state counts as beyond a limit where it is met less than {share:.0%} as often as by a policy of f alone that has "
        "kept every other limit so far. A demonstrator who errs more often than that hides a limit."
    ),
    (
        "f is a sum over coordinates and their squares. A dislike that begins sharply reads as a limit; what f explains by a "
        "place that is liked most is no limit, whatever lies beyond."
    ),
    "Limits of actions were not looked for.",
)


def of_limits(result: Result) -> dict[str, Any]:
    """Make the card of a robot of which actions or states were counted."""
    limits = recovered_limits(result)
    if limits is None:
        raise TypeError(f"{result.spec.method_name} has no limits")
    never, untested = _limits(result, limits)
    said = _OF_STATES if result.networks.feasibility_sees_state else _OF_ACTIONS
    share = float(result.spec.config.coefficients.threshold)
    told = [*untested, *(sentence.format(share=share) for sentence in said)]
    return {"wants": wants(result), "never": never, "cannot_tell": told, "separable": True}


def wants(result: Result) -> list[dict[str, Any]]:
    """List θ_k, greatest size first: what one standard deviation of a coordinate is worth, or half of its square.

    These are features of which the mean over seeds is at least a hundredth of ‖θ‖.
    """
    theta = np.asarray(result.states.params.reward["params"]["weights"], float)
    names = result.spec.env.coordinate_names
    called = (*names, *(f"({name})², less what is usual" for name in names))
    size = np.linalg.norm(theta, axis=1).mean()
    entries = [
        {"what": what, "weight": float(values.mean()), "spread": float(values.std())}
        for what, values in zip(called, theta.T, strict=True)
        if abs(values.mean()) >= LEAST_WEIGHT * size
    ]
    return sorted(entries, key=lambda entry: -abs(entry["weight"]))


def beyond(result: Result, index: int, side: str, limit: float) -> tuple[float, float]:
    """Return M and n beyond a limit of one action or coordinate, in its own unit: expected of the twin, and of D_E.

    Means over seeds. M beyond a limit of a coordinate is that by which it was drawn.
    """
    contrast, space = result.states.adversary_opt, result.spec.env.action_space
    if not isinstance(space, Box):
        raise TypeError(f"{result.spec.env.name} has no box of actions")
    if contrast.met is None:
        edges, made, share = np.asarray(space.from_half_widths(EDGES))[None], contrast.made, contrast.expected
        drawn = np.zeros(1)
    else:
        scale = scale_of(contrast.reach, result.spec.config.moments.margin)
        edges = np.asarray(scale.middle[:, index, None] + scale.half[:, index, None] * EDGES)
        made, share, drawn = contrast.met.made, contrast.met.share, contrast.met.tempted[:, int(side == "above"), index]
    outside = edges[:, :-1] >= limit if side == "above" else edges[:, 1:] <= limit
    done = np.asarray(made.number[:, index], float) * outside
    expected = np.asarray(share[:, index], float) * np.asarray(made.steps, float)[:, None] * outside
    tempted = np.where(np.asarray(drawn) > 0, drawn, expected.sum(axis=1))
    return float(tempted.mean()), float(done.sum(axis=1).mean())


def _limits(result: Result, limits: Limits) -> tuple[list[dict[str, Any]], list[str]]:
    entries: list[dict[str, Any]] = []
    untested: list[str] = []
    for index, name in enumerate(limits.names):
        for side, drawn, end in (
            ("above", limits.upper[:, index], float(limits.greatest[index])),
            ("below", limits.lower[:, index], float(limits.least[index])),
        ):
            known = drawn[np.isfinite(drawn)]
            if len(known) <= SEEDS_AGREE * len(drawn):
                untested.append(f"{name} {side} {end:.3g} ({beyond(result, index, side, end)[0]:.0f})")
                continue
            tempted, done = beyond(result, index, side, float(known.mean()))
            entries.append(_entry(f"{name} {side}", known, len(drawn), tempted, done))
    told = f"Not tested: {', '.join(untested)}. In brackets, how often a policy of f alone would have gone there; too rarely."
    return sorted(entries, key=lambda entry: -entry["tempted"]), [told] if untested else []


def _entry(what: str, known: Float[np.ndarray, " S"], seeds: int, tempted: float, done: float) -> dict[str, Any]:
    return {
        "what": what,
        "limit": float(known.mean()),
        "spread": float(known.std()),
        "tempted": tempted,
        "done": done,
        "how": f"n against M, in {len(known)} of {seeds} seeds",
    }
