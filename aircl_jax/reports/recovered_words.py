"""Write what a run recovered of a world of codes, in ranked tables and plain words."""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float

from aircl_jax.analysis.recovered import (
    AVOIDED_BELOW,
    LEAST_EXPECTED,
    LEAST_SEEN,
    Recovered,
    avoided,
    beginning,
    changes,
    expected,
    rank_agreement,
    recover,
    rewarding,
)
from aircl_jax.reports import markdown
from aircl_jax.reports.card_of_activities import activities_in_words, beside_counting
from aircl_jax.runs.result import Result
from envs import Codes

AVOIDED_HEAD = ("after", "never or rarely comes", "feasibility", "seen", "expected by chance")


def reading(result: Result) -> str:
    """Write the ranked tables of a finished run; empty where the world has no codes and no activities."""
    env = result.spec.env
    if result.spec.method.is_fitted:
        return activities_in_words(result)
    if not isinstance(env.view, Codes) or env.tabular is None:
        return ""
    return in_words(recover(result, env.tabular), env.view) + f"\n\n**Beside counting.** {beside_counting(result)}"


def in_words(recovered: Recovered, codes: Codes, number: int = 12) -> str:
    """Write ranked tables for a reader who knows the animals and not the method."""
    parts = []
    if np.isfinite(recovered.reward).all():
        parts += [_beginnings(recovered, codes.names), _rewarding(recovered, codes.names, number)]
    if np.isfinite(recovered.delta).all():
        parts.append(_avoided(recovered, codes, number))
    return "\n\n".join(parts)


def _beginnings(recovered: Recovered, names: Sequence[str]) -> str:
    reward, begun = beginning(recovered), changes(recovered.seen).sum(axis=0)
    going_on = recovered.reward[:, np.arange(len(names)), np.arange(len(names))]
    shown = np.flatnonzero(begun >= LEAST_SEEN)
    if not len(shown):
        return f"**What they go for.** No activity begins {LEAST_SEEN} times or more in the recordings, so that none is ranked."
    order = shown[np.argsort(-reward[:, shown].mean(axis=0))]
    rows = [
        (rank, names[code], _spread(reward[:, code]), _spread(going_on[:, code]), begun[code])
        for rank, code in enumerate(order, 1)
    ]
    return "\n".join(
        [
            "**What they go for.** Each activity by how much reward the run infers for beginning it, and for going on with",
            "it; 0 is the average step of the recordings. Where the discriminator has settled, it is the logarithm of how",
            f"likely the step is for the animals, and a constant. {_agreement(reward[:, shown], 'activities')}",
            "",
            markdown.table(("", "activity", "reward of beginning it", "of going on with it", "begun"), rows),
        ]
    )


def _rewarding(recovered: Recovered, names: Sequence[str], number: int) -> str:
    ranked, leaving = rewarding(recovered), changes(recovered.seen).sum(axis=1)
    if not ranked:
        return f"**What they change to.** No change was seen {LEAST_SEEN} times or more, so that none is ranked."
    values = np.stack([recovered.reward[:, source, target] for source, target in ranked], axis=1)
    rows = [
        (
            names[source],
            names[target],
            _spread(recovered.reward[:, source, target]),
            f"{recovered.seen[source, target]} of {leaving[source]}",
        )
        for source, target in ranked[:number]
    ]
    return "\n".join(
        [
            f"**What they change to.** The {len(rows)} changes with the most reward, of {len(ranked)} that were seen at least",
            f"{LEAST_SEEN} times. {_agreement(values, 'changes')}",
            "",
            markdown.table(("after", "comes", "reward", "seen, of the times the first ended"), rows),
        ]
    )


def _avoided(recovered: Recovered, codes: Codes, number: int) -> str:
    listed, chance = avoided(recovered, codes), expected(recovered.seen, codes.impossible)
    ranked = chance >= LEAST_EXPECTED
    rows = [
        (
            codes.names[source],
            codes.names[target],
            _spread(recovered.delta[:, source, target]),
            recovered.seen[source, target],
            f"{chance[source, target]:.0f}",
        )
        for source, target in listed[:number]
    ]
    lowest = "" if len(rows) == len(listed) else f" The {len(rows)} lowest of them:"
    often, below = f"{LEAST_EXPECTED:g}", f"{AVOIDED_BELOW:g}"
    return "\n".join(
        [
            f"**What they avoid.** Of {ranked.sum()} changes that chance would have shown at least {often} times, the run",
            f"calls {len(listed)} infeasible (feasibility below {below}; 1 is free, 0 is forbidden).{lowest}",
            f"Never shown and forbidden look the same here. {_agreement(recovered.delta[:, ranked], 'changes')}",
            *(["", markdown.table(AVOIDED_HEAD, rows)] if rows else []),
        ]
    )


def _agreement(values: Float[np.ndarray, "S K"], what: str) -> str:
    """Say in a sentence how far the seeds rank alike."""
    found = rank_agreement(values)
    if not len(found) or not np.isfinite(found).all():
        few = "One seed alone" if len(values) < 2 else f"Too few {what}" if values.shape[1] < 2 else "Equal values"
        return f"{few}: how stable the order is, is unknown."
    least = f"{found.mean():.2f} on average, {found.min():.2f} at worst"
    return f"Over {len(values)} seeds the order of these {values.shape[1]} {what} agrees by a rank correlation of {least}."


def _spread(values: Float[np.ndarray, " S"]) -> str:
    return f"{values.mean():.2f}" + (f" ± {values.std(ddof=1):.2f}" if len(values) > 1 else "")
