"""Raise alarms: sentences that say what looks degenerate in a run's final metrics, and in which seeds."""

import math
from collections.abc import Callable, Mapping, Sequence
from typing import Any, NamedTuple

from aircl_jax.settings.env_defaults import GUESTS, has_own_settings
from envs import Env


class Alarm(NamedTuple):
    """A metric, the values at which the alarm rings, what that means, and what to do about it."""

    metric: str
    rings: Callable[[float], bool]
    meaning: str
    advice: str


_OF_FLAGS = "Look whether all demonstrations keep the constraint; a smaller train.coefficients.threshold flags less"
ALARMS = (
    Alarm(
        "feasibility_expert",
        lambda x: x < 0.05,
        "δ̄ has collapsed: it calls the demonstrations themselves infeasible",
        _OF_FLAGS,
    ),
    Alarm("feasibility_expert", lambda x: 0.05 <= x < 0.6, "δ̄ over-flags: many demonstrations count as infeasible", _OF_FLAGS),
    Alarm(
        "feasibility_auroc",
        lambda x: x < 0.5,
        "δ̄ is inverted: it ranks violating trajectories above clean ones",
        "Look at what it forbids in card.md: it has learned a habit of the demonstrators in place of their constraint",
    ),
    Alarm(
        "feasibility_gap",
        lambda x: abs(x) < 0.05,
        "δ̄ is silent: it gives clean and violating trajectories the same value",
        "Give more demonstrations, or ones that come nearer to what they avoid",
    ),
    Alarm(
        "untested",
        lambda x: x >= 1.0,
        "no limit was drawn: a policy of f alone hardly ever goes beyond what was demonstrated (M in card.md), or was seen to",
        "Give more demonstrations, or ones of a task that tempts more; where there is no constraint nothing is wrong",
    ),
    Alarm(
        "moment_gap",
        lambda x: x > 0.35,
        "π never came near what was demonstrated: its mean features stayed another policy's, so f was not identified",
        "Train longer (iterations=), or roll out more (train.num_trajectories=)",
    ),
    Alarm(
        "gap_at_end",
        lambda x: x > 1.0,
        "π is far from what was demonstrated: f is no reward of the demonstrator's",
        "Train longer (iterations=), or give more demonstrations; what f leaves out may be no feature of single coordinates",
    ),
    Alarm(
        "strayed",
        lambda x: x > 0.02,
        "π goes where no demonstration is, as a body that falls: there f says nothing",
        "Train longer (iterations=)",
    ),
    Alarm(
        "effective_sample_size",
        lambda x: x < 0.1,
        "the resampling is degenerate: few trajectories carry all weight",
        "Draw from a larger pool (train.pool_factor=)",
    ),
    Alarm(
        "logit_size",
        lambda x: x > 10.0,
        "the discriminator is saturated: its mean |logit| is above 10",
        "Train it less (train.adversary.num_steps=, train.adversary.learning_rate=)",
    ),
    Alarm(
        "log_std_at_bound",
        lambda x: x > 0.0,
        "the policy's log σ stands at a bound",
        "At the lower bound it has settled; at the upper one, or where it should explore, move the bound "
        "(train.ppo.log_std_min=, train.ppo.log_std_max=)",
    ),
    Alarm(
        "balanced_acc",
        lambda x: x > 0.65,
        "the discriminator still tells π from the expert: π or f lags behind",
        "Train longer (iterations=)",
    ),
)


def untuned(env: Env) -> list[str]:
    """One sentence where an environment has no settings of its own; none where it has."""
    if has_own_settings(env):
        return []
    rest = "those of the shipped robots" if env.registered and env.name in GUESTS else "the same for every such world"
    return [f"env={env.title} runs with untuned settings: what `config` does not name is {rest}."]


def not_finite(summary: Mapping[str, Any]) -> list[str]:
    """Write a sentence where numbers of some seeds were not finite; none where all were."""
    since = summary.get("not_finite") or {}
    if not since:
        return []
    which = "; ".join(f"seed {seed}, from iteration {iteration} on" for seed, iteration in since.items())
    others = len(summary["seeds"]) - len(since)
    means = f"means are of the other {others}" if others else "no mean is left"
    return [f"not finite: {which} (parameters, losses or observations); such a seed's measures are undefined, and {means}."]


def alarms(seeds: Sequence[int], metrics: Mapping[str, Mapping[str, Sequence[float | None]]]) -> list[str]:
    """Write one sentence for each alarm that rings, from the `seeds` and `metrics` of a summary."""
    sentences = []
    for alarm in ALARMS:
        values = metrics.get(alarm.metric, {}).get("per_seed", [])
        ringing = [
            seed
            for seed, value in zip(seeds, values, strict=False)
            if value is not None and math.isfinite(value) and alarm.rings(value)
        ]
        if ringing:
            which = ", ".join(map(str, ringing))
            shown = ", ".join(f"{value:.3g}" for seed, value in zip(seeds, values, strict=False) if seed in ringing)
            sentences.append(f"{alarm.meaning} ({alarm.metric} {shown}; seed {which}). {alarm.advice}.")
    return sentences
