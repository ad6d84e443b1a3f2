"""Write the card and the plain words of the row that is fitted to whole recordings of animals."""

from collections.abc import Mapping
from typing import Any

import numpy as np

from aircl_jax.analysis.activities import FORBIDDEN_BELOW, as_changes, found_of
from aircl_jax.reports import markdown
from aircl_jax.reports.behaviour_card import ALWAYS, untold, wants
from aircl_jax.reports.card_of_entries import SEEDS_AGREE
from aircl_jax.runs.result import Result

COMMAND = "python -m experiments.behaviour"
SHOWN = 12  # rows of each table


def of_activities(result: Result) -> dict[str, Any]:
    """Make the card: each entry with its spread over bootstrap samples of the recordings."""
    found, changes = found_of(result), as_changes(found_of(result))
    flagged = (found.delta < FORBIDDEN_BELOW) & found.possible
    pairs = [(int(one), int(other)) for one, other in np.argwhere(flagged.mean(axis=0) > SEEDS_AGREE)]
    pairs.sort(key=lambda pair: float(found.delta[:, pair[0], pair[1]].mean()))
    names, samples = found.recordings.names, len(found.delta)
    return {
        "wants": wants(found.recordings, found.reward.mean(axis=0), found.reward.std(axis=0), found.begun),
        "never": [
            {
                "what": f"{names[source]}, then {names[target]}",
                "limit": None,
                "spread": float(found.delta[:, source, target].std()),
                "tempted": float(changes.expected[source, target]),
                "done": float(found.made[source, target]),
                "how": f"flagged in {flagged[:, source, target].sum()} of {samples} bootstrap samples; {COMMAND} has its p",
            }
            for source, target in pairs
        ],
        "cannot_tell": [samples_in_words(result), *untold(found.recordings, changes, found.begun, {}), *ALWAYS],
        "separable": True,
    }


def samples_in_words(result: Result) -> str:
    """Say what a seed is, in a sentence or two."""
    recorded, samples = result.spec.env.recorded, len(result.summary["seeds"])
    number = len(np.unique(recorded.groups())) if recorded is not None and recorded.groups is not None else 0
    of = "One seed is a bootstrap sample" if samples == 1 else f"The {samples} seeds are bootstrap samples"
    return (
        f"{of} of the {number} recordings, as many drawn with replacement, and no random restarts: the problem is convex. A "
        "spread over seeds is a standard error over recordings, and each seed is judged on the recordings that it did not draw."
    )


def activities_in_words(result: Result) -> str:
    """Write what was found in ranked tables, with the gain over counting."""
    card, metrics = of_activities(result), result.summary["metrics"]
    held, where = (metrics[f"held_out_{name}_gain"] for name in ("chain", "where"))
    draws = [(one["what"], f"{one['weight']:.2f} ± {one['spread']:.2f}") for one in card["wants"][:SHOWN]]
    avoided = [(one["what"], f"{one['done']:.0f}", f"{one['tempted']:.1f}", one["how"]) for one in card["never"][:SHOWN]]
    return markdown.paragraphs(
        f"**What a seed is.** {samples_in_words(result)}",
        f"**Against counting.** On recordings that were not drawn the model gains {_gain(held)} nats a step over a smoothed "
        f"first-order chain of the same sample, and {_gain(where)} a change in where to go. `{COMMAND}` holds out every "
        "recording in turn.",
        "**Where they go.** Reward of beginning an activity at a place, above the place's mean.",
        markdown.table(("what", "reward, nats"), draws) if draws else "Nothing stands out.",
        "**What they avoid.** Times made in all recordings, and expected were the pair ordinary (median over samples). A "
        "sample that holds a recording twice flags more readily, and M grows with the pairs that are ruled out beside it.",
        markdown.table(("change", "made", "expected", "how it is known"), avoided) if avoided else "No change is flagged.",
    )


def beside_counting(result: Result) -> str:
    """Say of a run on windows of codes what it gains over counting, and which command asks what it does not."""
    row = result.summary["metrics"].get("chain_gain")
    gain = ""
    if row is not None:
        gain = f"This run's policy gains {_gain(row)} nats a step over a first-order chain; both have seen the windows. "
    return (
        f"{gain}When the animals leave an activity, and what draws them where, is asked by `{COMMAND}` or method=behaviour "
        "(docs/animals.md)."
    )


def _gain(row: Mapping[str, Any]) -> str:
    """Write a mean over seeds with its spread; a seed that drew every recording has none."""
    values = np.array([value for value in row["per_seed"] if value is not None], float)
    if not len(values):
        return "(undefined)"
    return f"{values.mean():+.4f}" + (f" ± {values.std(ddof=1):.4f}" if len(values) > 1 else "")
