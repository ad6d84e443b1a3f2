"""What is measured: the paper's metrics and ours, on each iteration's batches and on fresh episodes at an evaluation."""

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from aircl_jax.algorithm.measures import (
    auroc,
    correlation,
    feasible_return,
    goal_rate,
    infeasible,
    step_metrics,
    undiscounted_return,
    violation_rate,
)
from aircl_jax.algorithm.rollout import rollouts
from aircl_jax.algorithm.sampler import SAMPLERS, take
from aircl_jax.algorithm.terms.logits import judge, verdict
from aircl_jax.demonstrations.soft_optimal import occupancy, soft_value_iteration
from aircl_jax.model.feasibility import log_feasibility
from aircl_jax.model.networks import Networks
from aircl_jax.types import Metrics, ObsStats, Params, Scores, TrainState, Trajectory

TV_BINS = 16  # per coordinate of s̃, between −4 and 4, for the occupancies of worlds that are not tabular


def evaluate(nets: Networks, state: TrainState, expert: Trajectory, reference: Trajectory) -> Metrics:
    """All metrics of one seed on fresh episodes of π and draws of q from them, and on the reference set.

    Reads the true reward and cost; changes nothing of the state (its key is folded, not split).
    """
    env, config, params, stats = nets.env, nets.config, state.params, state.obs_stats
    key_policy, key_sampler = jax.random.split(jax.random.fold_in(state.key, state.step))
    policy = rollouts(env, nets, params, stats, key_policy, config.num_evaluation)
    policy_scores = _scores(nets, params, stats, policy)
    log_delta = log_feasibility(nets.method, config.coefficients, policy_scores)
    if nets.method.sampled_from == "policy":
        index = jnp.arange(config.num_evaluation)
    else:
        index = SAMPLERS[config.adversary.sampler](log_delta, config.num_evaluation, key_sampler)
    sampled, sampled_scores = take(policy, index), jax.tree.map(lambda leaf: leaf[index], policy_scores)
    expert_scores = _scores(nets, params, stats, expert)
    expert_log_delta = log_feasibility(nets.method, config.coefficients, expert_scores)
    return {
        **step_metrics(env, sampled, policy, log_delta, expert_log_delta),
        **_accuracies(nets, expert_scores, sampled_scores),
        **_feasibility_metrics(nets, params, stats, reference),
        **_reward_metrics(nets, params, stats, policy, policy_scores),
        "violation_rate_expert": violation_rate(expert),
        "expert_return": undiscounted_return(expert),
        "feasible_return": feasible_return(policy) if env.has_reward else jnp.full((), jnp.nan),
        "goal_rate": goal_rate(policy, env.success_return),
        "expert_goal_rate": goal_rate(expert, env.success_return),
        "occupancy_tv": occupancy_tv(nets, stats, expert, policy),
        "log_std_at_bound": _log_std_at_bound(nets, params),
    }


def occupancy_tv(nets: Networks, stats: ObsStats, expert: Trajectory, policy: Trajectory) -> Float[Array, ""]:
    """½ Σ |p_E − p_π| of the observed states' occupancies; else the mean over coordinates of s̃, binned."""

    def histogram(trajectories: Trajectory) -> Float[Array, "K B"]:
        weight = trajectories.mask / jnp.maximum(trajectories.mask.sum(), 1.0)
        if nets.env.tabular is not None:
            return jnp.einsum("nt,nto->o", weight, trajectories.obs)[None]
        seen = jax.vmap(jax.vmap(nets.normalise, (None, 0)), (None, 0))(stats, trajectories.obs)
        bins = jnp.clip((seen + 4.0) / 8.0 * TV_BINS, 0, TV_BINS - 1).astype(jnp.int32)
        return jnp.einsum("nt,ntob->ob", weight, jax.nn.one_hot(bins, TV_BINS))

    return 0.5 * jnp.abs(histogram(expert) - histogram(policy)).sum(axis=-1).mean()


def _scores(nets: Networks, params: Params, stats: ObsStats, trajectories: Trajectory) -> Scores:
    log_pi = jax.vmap(nets.log_pi, (None, None, 0))(params, stats, trajectories)
    return jax.vmap(nets.scores, (None, None, 0, 0))(params, stats, trajectories, log_pi)


def _accuracies(nets: Networks, expert: Scores, sampled: Scores) -> Metrics:
    """RCAcc, the share of D_E with D > ½ (recall on experts alone), and its mean with the share of q told apart."""
    if nets.method.judge == "none":
        return {name: jnp.full((), jnp.nan) for name in ("rc_acc", "balanced_acc", "logit_size")}
    expert_logit, sampled_logit = judge(nets.method, nets.config, expert, sampled)
    right_expert = (verdict(expert_logit, expert.mask) > 0).mean()
    right_sampled = (verdict(sampled_logit, sampled.mask) < 0).mean()
    size_expert = verdict(jnp.abs(expert_logit), expert.mask).mean()
    size_sampled = verdict(jnp.abs(sampled_logit), sampled.mask).mean()
    return {
        "rc_acc": right_expert,
        "balanced_acc": 0.5 * (right_expert + right_sampled),
        "logit_size": 0.5 * (size_expert + size_sampled),
    }


def _feasibility_metrics(nets: Networks, params: Params, stats: ObsStats, reference: Trajectory) -> Metrics:
    """Does δ̄ separate clean from violating trajectories of the reference set, and by how much; and δ₁ their steps."""
    undefined = jnp.full((), jnp.nan)
    if nets.method.feasibility == "none":
        return dict.fromkeys(("feasibility_auroc", "feasibility_gap", "step_feasibility_auroc"), undefined)
    scores = _scores(nets, params, stats, reference)
    log_delta = log_feasibility(nets.method, nets.config.coefficients, scores)
    delta, clean = jnp.exp(log_delta), 1.0 - infeasible(reference)
    gap = (delta * clean).sum() / clean.sum() - (delta * (1.0 - clean)).sum() / (1.0 - clean).sum()
    mask, cost = reference.mask.ravel(), reference.cost.ravel()
    of_steps = auroc(scores.step_logit.ravel(), mask * (1.0 - cost), mask * cost)
    return {
        "feasibility_auroc": auroc(log_delta, clean, 1.0 - clean),
        "feasibility_gap": gap,
        "step_feasibility_auroc": of_steps if "step" in nets.method.feasibility else undefined,
    }


def _reward_metrics(nets: Networks, params: Params, stats: ObsStats, policy: Trajectory, scores: Scores) -> Metrics:
    """Is f the true reward on feasible steps, and how much of the constraint hides in it (tabular worlds)."""
    undefined = jnp.full((), jnp.nan)
    if not nets.method.learns_reward:
        return {"reward_correlation": undefined, "violation_reward_only": undefined}
    feasible = policy.mask * (1.0 - policy.cost)
    found = correlation(scores.f, policy.reward, feasible) if nets.env.has_reward else undefined
    return {"reward_correlation": found, "violation_reward_only": _violation_reward_only(nets, params, stats)}


def _violation_reward_only(nets: Networks, params: Params, stats: ObsStats) -> Float[Array, ""]:
    """Violation rate of the exact soft-optimal policy of f alone, undiscounted, at the entropy's own β."""
    table = nets.env.tabular
    if table is None:
        return jnp.full((), jnp.nan)
    actions = jnp.arange(table.transition.shape[1])
    reward = jax.vmap(jax.vmap(nets.reward, (None, None, None, 0)), (None, None, 0, None))(
        params.reward, stats, table.obs, actions
    )
    planned = soft_value_iteration(table, reward, nets.env.horizon, nets.entropy_weight, forbid=False)
    return (occupancy(table, planned.log_policy) @ table.cost).mean()


def _log_std_at_bound(nets: Networks, params: Params) -> Float[Array, ""]:
    """Share of the policy's log σ that stand at a bound; undefined (NaN) for discrete actions."""
    log_std = params.policy["params"].get("log_std")
    if log_std is None:
        return jnp.full((), jnp.nan)
    bounds = nets.config.ppo
    return ((log_std <= bounds.log_std_min) | (log_std >= bounds.log_std_max)).mean()
