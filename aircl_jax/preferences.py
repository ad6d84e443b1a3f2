"""What a run recovered, by pair of code and next code or of node and move: in numbers, ranks and plain words."""

from collections.abc import Sequence
from functools import partial
from itertools import combinations
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int
from scipy.stats import rankdata

from aircl_jax.api import Result
from aircl_jax.evidence import ONCE, gather_grid
from aircl_jax.networks import Networks
from aircl_jax.types import TrainState
from envs import Codes, Tabular

LEAST_SEEN = 5  # cases of a change that is ranked
LEAST_EXPECTED = 5.0  # cases that chance would give of a change whose absence says something
AVOIDED_HEAD = ("| after | never or rarely comes | feasibility | seen | expected by chance |", "|---|---|---|---|---|")
AVOIDED_BELOW = 0.5  # δ under which a change counts as avoided


class Recovered(NamedTuple):
    """Of every seed, f less its mean over D_E, δ₁ and log π; and how often D_E has the pair. NaN where not learned."""

    reward: Float[np.ndarray, "S C A"]
    delta: Float[np.ndarray, "S C A"]
    log_policy: Float[np.ndarray, "S C A"]
    seen: Int[np.ndarray, "C A"]


def recover(result: Result, table: Tabular) -> Recovered:
    """The learned functions over all pairs of a world whose observations are one-hot."""
    found, expert, method = gather_grid(result, table), result.expert, result.plan.method
    log_policy = jax.jit(jax.vmap(partial(_log_policy, result.networks)), compiler_options=ONCE)(result.states)
    first = np.asarray(expert.obs[0]).argmax(axis=-1), np.asarray(expert.action[0])
    seen = np.zeros(found.reward.shape[1:], dtype=np.int64)
    np.add.at(seen, first, np.asarray(expert.mask[0]).astype(np.int64))
    centre = np.average(found.reward, axis=(1, 2), weights=np.broadcast_to(seen, found.reward.shape))
    unknown = np.full_like(found.reward, np.nan)
    return Recovered(
        reward=found.reward - centre[:, None, None] if method.learns_reward else unknown,
        delta=found.step_delta if "step" in method.feasibility else unknown,
        log_policy=np.asarray(log_policy),
        seen=seen,
    )


def _log_policy(nets: Networks, state: TrainState) -> Float[Array, "C A"]:
    """log π(a|s) at t = 0; in these worlds π does not see t."""
    actions = jnp.arange(nets.env.action_space.feature_size)

    def of(obs: Float[Array, " O"]) -> Float[Array, " A"]:
        policy = nets.policy(state.params.policy, state.obs_stats, obs, jnp.asarray(0))
        return jax.vmap(lambda action: jnp.asarray(policy.log_prob(action)))(actions)

    return jax.vmap(of)(jnp.eye(nets.env.obs_size))


def rank_agreement(values: Float[np.ndarray, "S K"]) -> Float[np.ndarray, " P"]:
    """Spearman's rank correlation of every pair of seeds; empty with one seed."""
    pairs = combinations(range(len(values)), 2)
    ranks = rankdata(values, axis=1)
    return np.array([np.corrcoef(ranks[one], ranks[other])[0, 1] for one, other in pairs])


def changes(seen: Int[np.ndarray, "C C"]) -> Int[np.ndarray, "C C"]:
    """The counts without what goes on as it is."""
    return np.where(np.eye(len(seen), dtype=bool), 0, seen)


def beginning(recovered: Recovered) -> Float[np.ndarray, "S C"]:
    """Mean reward of beginning each code, over the changes to it as D_E has them; NaN where it never begins."""
    weight = changes(recovered.seen)
    total = weight.sum(axis=0)
    return np.where(total > 0, (recovered.reward * weight).sum(axis=1) / np.maximum(total, 1), np.nan)


def expected(seen: Int[np.ndarray, "C C"], impossible: Bool[np.ndarray, "C C"]) -> Float[np.ndarray, "C C"]:
    """Cases of each change if the next code were drawn by how often it begins, among those that are possible."""
    weight = changes(seen)
    share = np.where(impossible | np.eye(len(seen), dtype=bool), 0.0, weight.sum(axis=0))
    total = share.sum(axis=1, keepdims=True)
    return weight.sum(axis=1, keepdims=True) * share / np.where(total > 0, total, 1.0)


def avoided(recovered: Recovered, codes: Codes) -> list[tuple[int, int]]:
    """Changes with a mean δ₁ under a half that chance would have shown often enough, least δ₁ first."""
    chance, delta = expected(recovered.seen, codes.impossible), recovered.delta.mean(axis=0)
    listed = _pairs((chance >= LEAST_EXPECTED) & (delta < AVOIDED_BELOW))
    return sorted(listed, key=lambda pair: (delta[pair], -chance[pair]))


def rewarding(recovered: Recovered) -> list[tuple[int, int]]:
    """Changes seen often enough, greatest mean reward first."""
    reward = recovered.reward.mean(axis=0)
    return sorted(_pairs(changes(recovered.seen) >= LEAST_SEEN), key=lambda pair: -reward[pair])


def _pairs(where: Bool[np.ndarray, "C C"]) -> list[tuple[int, int]]:
    return [(int(source), int(target)) for source, target in np.argwhere(where)]


def reading(result: Result) -> str:
    """The ranked tables of a finished run; empty where the world has no codes."""
    env = result.plan.env
    if env.codes is None or env.tabular is None:
        return ""
    return in_words(recover(result, env.tabular), env.codes)


def in_words(recovered: Recovered, codes: Codes, number: int = 12) -> str:
    """Ranked tables for someone who knows the animals and not the method."""
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
    order = shown[np.argsort(-reward[:, shown].mean(axis=0))]
    rows = [
        f"| {rank} | {names[code]} | {_spread(reward[:, code])} | {_spread(going_on[:, code])} | {begun[code]} |"
        for rank, code in enumerate(order, 1)
    ]
    return "\n".join(
        [
            "**What they go for.** Each activity by how much reward the run infers for beginning it, and for going on with",
            "it; 0 is the average step of the recordings. Where the discriminator has settled, it is the logarithm of how",
            f"likely the step is for the animals, and a constant. {_agreement(reward[:, shown], 'activities')}",
            "",
            "| | activity | reward of beginning it | of going on with it | begun |",
            "|---|---|---|---|---|",
            *rows,
        ]
    )


def _rewarding(recovered: Recovered, names: Sequence[str], number: int) -> str:
    ranked, leaving = rewarding(recovered), changes(recovered.seen).sum(axis=1)
    values = np.stack([recovered.reward[:, source, target] for source, target in ranked], axis=1)
    rows = [
        f"| {names[source]} | {names[target]} | {_spread(recovered.reward[:, source, target])} "
        f"| {recovered.seen[source, target]} of {leaving[source]} |"
        for source, target in ranked[:number]
    ]
    return "\n".join(
        [
            f"**What they change to.** The {len(rows)} changes with the most reward, of {len(ranked)} that were seen at least",
            f"{LEAST_SEEN} times. {_agreement(values, 'changes')}",
            "",
            "| after | comes | reward | seen, of the times the first ended |",
            "|---|---|---|---|",
            *rows,
        ]
    )


def _avoided(recovered: Recovered, codes: Codes, number: int) -> str:
    listed, chance = avoided(recovered, codes), expected(recovered.seen, codes.impossible)
    judged = chance >= LEAST_EXPECTED
    rows = [
        f"| {codes.names[source]} | {codes.names[target]} | {_spread(recovered.delta[:, source, target])} "
        f"| {recovered.seen[source, target]} | {chance[source, target]:.0f} |"
        for source, target in listed[:number]
    ]
    kept = "" if len(rows) == len(listed) else f" The {len(rows)} lowest of them:"
    often, below = f"{LEAST_EXPECTED:g}", f"{AVOIDED_BELOW:g}"
    return "\n".join(
        [
            f"**What they avoid.** Of {judged.sum()} changes that chance would have shown at least {often} times, the run",
            f"calls {len(listed)} infeasible (feasibility below {below}; 1 is free, 0 is forbidden).{kept}",
            f"Never shown and forbidden look the same here. {_agreement(recovered.delta[:, judged], 'changes')}",
            *(["", *AVOIDED_HEAD, *rows] if rows else []),
        ]
    )


def _agreement(values: Float[np.ndarray, "S K"], what: str) -> str:
    """How far the seeds rank alike, in a sentence."""
    found = rank_agreement(values)
    if not len(found) or not np.isfinite(found).all():
        return "One seed alone: how stable the order is, is unknown."
    least = f"{found.mean():.2f} on average, {found.min():.2f} at worst"
    return f"Over {len(values)} seeds the order of these {values.shape[1]} {what} agrees by a rank correlation of {least}."


def _spread(values: Float[np.ndarray, " S"]) -> str:
    return f"{values.mean():.2f}" + (f" ± {values.std(ddof=1):.2f}" if len(values) > 1 else "")
