"""Write the card of a behaviour model: what the animals want, what they avoid, what their recordings cannot tell."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from jaxtyping import Float

from aircl_jax.animals.changes import TESTABLE, Changes, Halves
from envs.animals.full.steps import LACKS, Recordings

LEAST_BEGUN = 10  # times that an activity was begun at a place, below which its reward there is not listed
SURE = 1.96  # standard errors by which a reward must exceed the place's mean

ALWAYS = (
    "Rewards compare the activities that can be begun at one place; a constant for each place is free.",
    "The reward is of the next activity alone. Whether the animals look further ahead is not tested.",
    "Whether an animal goes on because it likes to or out of habit: leaving is described by a hazard, not by a reward.",
    "Strongly disliked and forbidden look the same.",
)


def behaviour_card(
    recordings: Recordings,
    reward: Float[np.ndarray, "P C"],
    spread: Float[np.ndarray, "P C"],
    begun: Float[np.ndarray, "P C"],
    changes: Changes,
    halves: Mapping[str, Halves],
) -> dict[str, Any]:
    """Make the card, of the form of a run's: `wants`, `never`, `cannot_tell`, `separable`."""
    return {
        "wants": wants(recordings, reward, spread, begun),
        "never": [_never(recordings.names, changes, pair) for pair in ranked(changes)],
        "cannot_tell": [*untold(recordings, changes, begun, halves), *ALWAYS],
        "separable": True,
    }


def ranked(changes: Changes) -> list[tuple[int, int]]:
    """List the flagged pairs, the least probable first."""
    pairs = [(int(source), int(target)) for source, target in np.argwhere(changes.flagged)]
    return sorted(pairs, key=lambda pair: changes.p[pair])


def survives(changes: Changes, pair: tuple[int, int]) -> bool:
    """Return whether a pair's p is below 5 % divided by the number of testable pairs (Bonferroni)."""
    return bool(changes.p[pair] < changes.bonferroni)


def wants(
    recordings: Recordings, reward: Float[np.ndarray, "P C"], spread: Float[np.ndarray, "P C"], begun: Float[np.ndarray, "P C"]
) -> list[dict[str, Any]]:
    places = recordings.places if "places" not in recordings.lacks else ("",)
    entries = []
    for place, activity in np.argwhere(begun[:, : recordings.num_behaviours] >= LEAST_BEGUN):
        weight, error = float(reward[place, activity]), float(spread[place, activity])
        if weight > SURE * error and recordings.names[activity] != recordings.moving:  # which is a way, no aim
            where = f" at {places[place]}" if places[place] else ""
            times = f" ({begun[place, activity]:.0f} of the {begun[place].sum():.0f} changes{' there' if where else ''})"
            entries.append({"what": recordings.names[activity] + where + times, "weight": weight, "spread": error})
    return sorted(entries, key=lambda entry: -entry["weight"])


def _never(names: Sequence[str], changes: Changes, pair: tuple[int, int]) -> dict[str, Any]:
    kind = "significant" if survives(changes, pair) else "a hint"
    how = (
        f"{kind}: p {changes.p[pair]:.1g}, Bonferroni's line {changes.bonferroni:.1g}; Bayes factor "
        f"{np.exp(changes.log_bayes[pair]):.0f}; expected in {changes.recordings[pair]} recordings and of "
        f"{changes.animals[pair]} animals"
    )
    return {
        "what": f"{names[pair[0]]}, then {names[pair[1]]}",
        "limit": None,
        "spread": None,
        "tempted": float(changes.expected[pair]),
        "done": float(changes.made[pair]),
        "how": how,
    }


def untold(
    recordings: Recordings, changes: Changes, begun: Float[np.ndarray, "P C"], halves: Mapping[str, Halves]
) -> list[str]:
    possible, testable = int(changes.possible.sum()), int(changes.testable.sum())
    silent = int((changes.possible & ~changes.testable & (changes.made == 0)).sum())
    of_these = f"{possible - testable} were expected fewer than {TESTABLE:g} times"
    lines = [f"Of {possible} possible changes {of_these}; {silent} of these were never made, and that says nothing."]
    total = begun.sum(axis=0)
    rare = [f"{recordings.names[code]} ({total[code]:.0f})" for code in np.flatnonzero(total < LEAST_BEGUN)]
    if rare:
        lines.append(f"Too rarely begun to say what they are worth: {', '.join(rare)}.")
    judged = halves.get("flagged")
    if judged and judged.expected:
        at_rate = f"at {judged.rate:.2f} of the ordinary rate on the other"
        lines.append(f"Avoided is not forbidden: changes flagged on one half of the recordings were made {at_rate}.")
    return lines + [LACKS[name] for name in recordings.lacks]
