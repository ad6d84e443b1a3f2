"""Compute what a run recovered for each pair of code and next code, or of node and move: values, ranks and their agreement."""

from functools import partial
from itertools import combinations
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int
from scipy.stats import rankdata

from aircl_jax.analysis.episodes import ONCE, gather_grid
from aircl_jax.model.networks import Networks
from aircl_jax.runs.result import Result
from aircl_jax.runs.seeds import in_groups
from aircl_jax.types import TrainState
from envs import Codes, Tabular
from envs.animals.account import LEAST_SEEN

LEAST_EXPECTED = 5.0  # a change that chance would show less often is not judged by its absence
AVOIDED_BELOW = 0.5  # δ under which a change counts as avoided


class Recovered(NamedTuple):
    """f less its mean over D_E, δ₁ and log π of every seed, and how often D_E has the pair. NaN where not learned."""

    reward: Float[np.ndarray, "S C A"]
    delta: Float[np.ndarray, "S C A"]
    log_policy: Float[np.ndarray, "S C A"]
    seen: Int[np.ndarray, "C A"]


def recover(result: Result, table: Tabular) -> Recovered:
    """Evaluate the learned functions on all pairs of a world whose observations are one-hot."""
    found, expert, method = gather_grid(result, table), result.expert, result.spec.method
    of_seeds = jax.jit(jax.vmap(partial(_log_policy, result.networks)), compiler_options=ONCE)
    log_policy = in_groups(of_seeds, result.states)
    first = np.asarray(expert.obs[0]).argmax(axis=-1), np.asarray(expert.action[0])
    seen = np.zeros(found.reward.shape[1:], dtype=np.int64)
    np.add.at(seen, first, np.asarray(expert.mask[0]).astype(np.int64))
    centre = np.average(found.reward, axis=(1, 2), weights=np.broadcast_to(seen, found.reward.shape))
    unknown = np.full_like(found.reward, np.nan)
    return Recovered(
        reward=found.reward - centre[:, None, None] if method.learns_reward else unknown,
        delta=found.step_delta if method.tests_steps else unknown,
        log_policy=log_policy,
        seen=seen,
    )


def _log_policy(networks: Networks, state: TrainState) -> Float[Array, "C A"]:
    """Evaluate log π(a|s) at t = 0; in these worlds π does not see t."""
    nets = networks.bind(state.params, state.obs_stats)
    actions = jnp.arange(nets.env.action_space.feature_size)

    def of(obs: Float[Array, " O"]) -> Float[Array, " A"]:
        policy = nets.policy(obs, jnp.asarray(0))
        return jax.vmap(lambda action: jnp.asarray(policy.log_prob(action)))(actions)

    return jax.vmap(of)(jnp.eye(nets.env.obs_size))


def rank_agreement(values: Float[np.ndarray, "S K"]) -> Float[np.ndarray, " P"]:
    """Compute Spearman's rank correlation of every pair of seeds, NaN of equal values; empty where there are not two."""
    if values.shape[1] < 2:
        return np.array([])
    pairs = combinations(range(len(values)), 2)
    ranks = rankdata(values, axis=1)
    with np.errstate(invalid="ignore", divide="ignore"):
        return np.array([np.corrcoef(ranks[one], ranks[other])[0, 1] for one, other in pairs])


def changes(seen: Int[np.ndarray, "C C"]) -> Int[np.ndarray, "C C"]:
    """Set the counts of pairs of a code with itself to 0."""
    return np.where(np.eye(len(seen), dtype=bool), 0, seen)


def beginning(recovered: Recovered) -> Float[np.ndarray, "S C"]:
    """Average the reward over the changes to each code, weighted as in D_E; NaN where a code never begins."""
    weight = changes(recovered.seen)
    total = weight.sum(axis=0)
    return np.where(total > 0, (recovered.reward * weight).sum(axis=1) / np.maximum(total, 1), np.nan)


def expected(seen: Int[np.ndarray, "C C"], impossible: Bool[np.ndarray, "C C"]) -> Float[np.ndarray, "C C"]:
    """Count the cases of each change that chance would give: the next possible code drawn by how often it begins."""
    weight = changes(seen)
    share = np.where(impossible | np.eye(len(seen), dtype=bool), 0.0, weight.sum(axis=0))
    total = share.sum(axis=1, keepdims=True)
    return weight.sum(axis=1, keepdims=True) * share / np.where(total > 0, total, 1.0)


def avoided(recovered: Recovered, codes: Codes) -> list[tuple[int, int]]:
    """List the changes with a mean δ₁ below ½ that chance would have shown often enough, least δ₁ first."""
    chance, delta = expected(recovered.seen, codes.impossible), recovered.delta.mean(axis=0)
    listed = _pairs((chance >= LEAST_EXPECTED) & (delta < AVOIDED_BELOW))
    return sorted(listed, key=lambda pair: (delta[pair], -chance[pair]))


def rewarding(recovered: Recovered) -> list[tuple[int, int]]:
    """List the changes seen often enough, greatest mean reward first."""
    reward = recovered.reward.mean(axis=0)
    return sorted(_pairs(changes(recovered.seen) >= LEAST_SEEN), key=lambda pair: -reward[pair])


def _pairs(where: Bool[np.ndarray, "C C"]) -> list[tuple[int, int]]:
    return [(int(source), int(target)) for source, target in np.argwhere(where)]
