"""Write the card of a row with a twin: which coordinates it wants, the limits that it keeps, what was never tested."""

from typing import Any

import numpy as np
from jaxtyping import Float

from aircl_jax.algorithm.boxes.action_limits import EDGES
from aircl_jax.algorithm.boxes.state_limits import scale_of
from aircl_jax.analysis.recovered_limits import LAPSES, Limits, demonstrated_steps, recovered_limits
from aircl_jax.runs.result import Result
from envs import Box

LEAST_WEIGHT = 0.01  # of ‖θ‖: a feature about which nothing is said
SEEDS_AGREE = 0.5  # share of the seeds that must draw a limit for it to be listed
ROUNDING = 1e-6  # of the box: what a change of unit may move a limit by
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


def beyond(
    result: Result, index: int, side: str, limit: Float[np.ndarray, " S"]
) -> tuple[Float[np.ndarray, " S"], Float[np.ndarray, " S"]]:
    """Return M and n of each seed beyond its limit of one action or coordinate, in its own unit: of the twin, and of D_E.

    M is of the bins that begin at the limit or further out, n of those in which more than the limit was done. M beyond a
    limit of a coordinate is that by which it was drawn.
    """
    contrast, space = result.states.adversary_opt, result.spec.env.action_space
    if not isinstance(space, Box):
        raise TypeError(f"{result.spec.env.name} has no box of actions")
    above = side == "above"
    if contrast.met is None:
        made, share, drawn = contrast.made, contrast.expected, np.zeros(1)
        middle, half = space.middle, space.half_width
    else:
        made, share, drawn = contrast.met.made, contrast.met.share, contrast.met.tempted[:, int(above), index]
        scale = scale_of(contrast.reach, result.spec.config.moments.margin)
        middle, half = scale.middle[:, index, None], scale.half[:, index, None]
    outermost = (made.greatest if above else made.least)[:, index]
    edges, furthest = (np.asarray(middle + half * ends) for ends in (EDGES[None], outermost))
    sign, limit = 1.0 if above else -1.0, limit[:, None]
    rounding = ROUNDING * (edges[:, -1:] - edges[:, :1])
    outside = sign * (edges[:, :-1] if above else edges[:, 1:]) >= sign * limit - rounding
    exceeded = sign * furthest > sign * limit + rounding
    done = np.asarray(made.number[:, index], float) * exceeded
    expected = np.asarray(share[:, index], float) * np.asarray(made.steps, float)[:, None] * outside
    return np.where(np.asarray(drawn) > 0, drawn, expected.sum(axis=1)), done.sum(axis=1)


def _limits(result: Result, limits: Limits) -> tuple[list[dict[str, Any]], list[str]]:
    entries: list[dict[str, Any]] = []
    untested: list[str] = []
    used: list[str] = []
    of_actions = result.states.adversary_opt.met is None
    for index, name in enumerate(limits.names):
        for side, drawn, end in (
            ("above", limits.upper[:, index], float(limits.greatest[index])),
            ("below", limits.lower[:, index], float(limits.least[index])),
        ):
            known = np.isfinite(drawn)
            tempted, done = beyond(result, index, side, np.where(known, drawn, end))
            if known.sum() > SEEDS_AGREE * len(drawn):
                entries.append(_entry(f"{name} {side}", drawn[known], len(drawn), tempted[known].mean(), done[known].mean()))
            elif of_actions and _is_used_to_the_end(result, index, side):
                used.append(f"{name} {side}")
            else:
                untested.append(f"{name} {side} {end:.3g} ({tempted[~known].mean():.0f})")
    told = [f"Not tested: {', '.join(untested)}. In brackets, how often a policy of f alone would have gone there; too rarely."]
    ends = [f"Done to the end of what is possible: {', '.join(used)}. No limit can lie beyond."]
    return sorted(entries, key=lambda entry: -entry["tempted"]), (told if untested else []) + (ends if used else [])


def _is_used_to_the_end(result: Result, index: int, side: str) -> bool:
    """Whether the demonstrations do what is most possible on this side more often than by lapses."""
    space: Any = result.spec.env.action_space
    done = demonstrated_steps(result)[:, result.spec.env.obs_size + index]
    end = space.high if side == "above" else space.low
    return bool((np.abs(done - end) <= ROUNDING * (space.high - space.low)).mean() > LAPSES)


def _entry(what: str, known: Float[np.ndarray, " S"], seeds: int, tempted: float, done: float) -> dict[str, Any]:
    return {
        "what": what,
        "limit": float(known.mean()),
        "spread": float(known.std()),
        "tempted": float(tempted),
        "done": float(done),
        "how": f"n against M, in {len(known)} of {seeds} seeds",
    }
