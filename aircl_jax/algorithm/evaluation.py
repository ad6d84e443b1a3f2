"""Evaluate a seed: the paper's metrics and ours on fresh episodes and on the reference set."""

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from aircl_jax.algorithm.boxes import moments
from aircl_jax.algorithm.boxes.state_limits import scale_of
from aircl_jax.algorithm.boxes.twins import Contrast
from aircl_jax.algorithm.measures import (
    all_finite,
    auroc,
    correlation,
    feasible_return,
    goal_rate,
    infeasible,
    step_metrics,
    undiscounted_return,
    violation_rate,
)
from aircl_jax.algorithm.scoring import roll_out_and_draw, trajectory_feasibility
from aircl_jax.algorithm.terms.logits import discriminator_logits, per_trajectory
from aircl_jax.demonstrations.soft_optimal import occupancy, soft_value_iteration
from aircl_jax.model.feasibility import log_feasibility
from aircl_jax.model.networks import BoundNetworks, Networks
from aircl_jax.types import Metrics, Scores, TrainState, Trajectory
from envs import Activities, Codes

SMOOTHING = 0.01  # pseudo-count of the chain that has seen what it is asked
TV_BINS = 16  # bins per coordinate of s̃, between −4 and 4, for the occupancies of worlds that are not tabular


def evaluate(networks: Networks, state: TrainState, expert: Trajectory, reference: Trajectory) -> Metrics:
    """Compute all metrics of one seed on fresh episodes of π, on draws of q from them, and on the reference set.

    All are undefined where a parameter or an observation of those episodes is not finite. Reads the true reward and cost.
    The state stays unchanged, because its key is folded and not split.
    """
    env, number = networks.env, networks.config.num_evaluation
    nets = networks.bind(state.params, state.obs_stats)
    key_policy, key_sampler = jax.random.split(jax.random.fold_in(state.key, state.step))
    drawn = roll_out_and_draw(nets, key_policy, key_sampler, number, number)
    policy, policy_scores, expert_scores = drawn.policy, _scores(nets, drawn.policy), _scores(nets, expert)
    expert_log_delta = trajectory_feasibility(nets, expert)
    metrics = {
        **step_metrics(env, drawn.sampled, policy, drawn.log_delta, expert_log_delta),
        **_accuracies(nets, expert_scores, drawn.draws_of(policy_scores)),
        **_feasibility_metrics(nets, reference),
        **_reward_metrics(nets, policy, policy_scores, reference),
        "violation_rate_expert": violation_rate(expert),
        "expert_return": undiscounted_return(expert),
        "feasible_return": feasible_return(policy) if env.has_reward else jnp.full((), jnp.nan),
        "goal_rate": goal_rate(policy, env.success_return),
        "expert_goal_rate": goal_rate(expert, env.success_return),
        "occupancy_tv": occupancy_tv(nets, expert, policy),
        "log_std_at_bound": _log_std_at_bound(nets),
        **_next_codes(nets, expert, expert_scores),
        **(_nearness(nets, state.adversary_opt, expert, policy) if networks.method.has_twin else {}),
        **(state.adversary_opt._asdict() if networks.method.is_fitted else {}),
    }
    finite = all_finite((state.params, jnp.where(policy.mask[..., None] > 0, policy.obs, 0.0)))
    return {name: jnp.where(finite, metric, jnp.nan) for name, metric in metrics.items()}


def occupancy_tv(nets: BoundNetworks, expert: Trajectory, policy: Trajectory) -> Float[Array, ""]:
    """½ Σ |p_E − p_π| of the observed states' occupancies; outside tables, its mean over the binned coordinates of s̃."""

    def histogram(trajectories: Trajectory) -> Float[Array, "K B"]:
        weight = trajectories.mask / jnp.maximum(trajectories.mask.sum(), 1.0)
        if nets.env.tabular is not None:
            return jnp.einsum("nt,nto->o", weight, trajectories.obs)[None]
        seen = jax.vmap(jax.vmap(nets.normalise))(trajectories.obs)
        bins = jnp.clip((seen + 4.0) / 8.0 * TV_BINS, 0, TV_BINS - 1).astype(jnp.int32)
        return jnp.einsum("nt,ntob->ob", weight, jax.nn.one_hot(bins, TV_BINS))

    return 0.5 * jnp.abs(histogram(expert) - histogram(policy)).sum(axis=-1).mean()


def _nearness(nets: BoundNetworks, contrast: Contrast, expert: Trajectory, policy: Trajectory) -> Metrics:
    """Measure how near π's mean features came and are to the demonstrations', and how often it is where none of those was.

    `moment_gap` is the least root mean square of E_E φ − E_k φ over the iterations k until the constraint began: π goes on by
    what was chosen then, and may do better than it was shown. `gap_at_end` is that of the policy as it is, `rechosen` how
    often f was chosen anew, `strayed` the share of the policy's steps with a coordinate further beyond the demonstrations'
    range than π may stray in practice.
    """
    gaps = jax.vmap(moments.size_of)(contrast.weights.gaps[: -moments.LATER_GAPS])
    now = moments.mean_features(nets, expert) - moments.mean_features(nets, policy)
    least = jnp.where(gaps > 0, gaps, jnp.inf).min()
    outside = (jnp.abs(scale_of(contrast.reach, nets.config.moments.margin).of(policy.obs)) >= 1.0).any(axis=-1)
    strayed = (outside * policy.mask).sum() / policy.mask.sum()
    rechosen = contrast.weights.rechosen
    return {"moment_gap": least, "gap_at_end": moments.size_of(now), "rechosen": rechosen, "strayed": strayed}


def _scores(nets: BoundNetworks, trajectories: Trajectory) -> Scores:
    return jax.vmap(nets.scores)(trajectories, jax.vmap(nets.log_pi)(trajectories))


def _accuracies(nets: BoundNetworks, expert: Scores, sampled: Scores) -> Metrics:
    """Compute RCAcc, the share of D_E with D > ½ (recall on experts alone), and its mean with the share of q with D < ½."""
    if not nets.method.discriminates:
        return {name: jnp.full((), jnp.nan) for name in ("rc_acc", "balanced_acc", "logit_size")}
    expert_logit, sampled_logit = discriminator_logits(nets.method, nets.config, expert, sampled)
    right_expert = (per_trajectory(expert_logit, expert.mask) > 0).mean()
    right_sampled = (per_trajectory(sampled_logit, sampled.mask) < 0).mean()
    size_expert = per_trajectory(jnp.abs(expert_logit), expert.mask).mean()
    size_sampled = per_trajectory(jnp.abs(sampled_logit), sampled.mask).mean()
    return {
        "rc_acc": right_expert,
        "balanced_acc": 0.5 * (right_expert + right_sampled),
        "logit_size": 0.5 * (size_expert + size_sampled),
    }


def _feasibility_metrics(nets: BoundNetworks, reference: Trajectory) -> Metrics:
    """Measure how well δ̄ separates clean from violating trajectories of the reference set, and δ₁ their steps."""
    undefined = jnp.full((), jnp.nan)
    if not nets.method.learns_feasibility:
        return dict.fromkeys(("feasibility_auroc", "feasibility_gap", "step_feasibility_auroc"), undefined)
    scores = jax.vmap(nets.feasibility_scores)(reference)
    log_delta = log_feasibility(nets.method, nets.config.coefficients, scores)
    delta, clean = jnp.exp(log_delta), 1.0 - infeasible(reference)
    gap = (delta * clean).sum() / clean.sum() - (delta * (1.0 - clean)).sum() / (1.0 - clean).sum()
    mask, cost = reference.mask.ravel(), reference.cost.ravel()
    of_steps = auroc(scores.step_logit.ravel(), mask * (1.0 - cost), mask * cost)
    return {
        "feasibility_auroc": auroc(log_delta, clean, 1.0 - clean),
        "feasibility_gap": gap,
        "step_feasibility_auroc": of_steps if nets.method.tests_steps else undefined,
    }


def _reward_metrics(nets: BoundNetworks, policy: Trajectory, scores: Scores, reference: Trajectory) -> Metrics:
    """Correlate f with the true reward on feasible steps, and measure in tabular worlds how much constraint f holds."""
    undefined = jnp.full((), jnp.nan)
    if not nets.method.learns_reward:
        names = ("reward_correlation", "reward_correlation_reference", "violation_reward_only")
        return dict.fromkeys(names, undefined)

    def agreement(f: Float[Array, "N T"], trajectories: Trajectory) -> Float[Array, ""]:
        feasible = trajectories.mask * (1.0 - trajectories.cost) * _spoken_of(nets, trajectories)
        return correlation(f, trajectories.reward, feasible) if nets.env.has_reward else undefined

    return {
        "reward_correlation": agreement(scores.f, policy),
        "reward_correlation_reference": agreement(jax.vmap(nets.f)(reference), reference),
        "violation_reward_only": _violation_reward_only(nets),
    }


def _violation_reward_only(nets: BoundNetworks) -> Float[Array, ""]:
    """Compute the violation rate of the exact soft-optimal policy of f alone, undiscounted, at the entropy's own β."""
    table = nets.env.tabular
    if table is None:
        return jnp.full((), jnp.nan)
    actions = jnp.arange(table.transition.shape[1])
    reward = jax.vmap(jax.vmap(nets.reward, (None, 0)), (0, None))(table.obs, actions)
    planned = soft_value_iteration(table, reward, nets.env.horizon, nets.networks.entropy_weight, forbid=False)
    return (occupancy(table, planned.log_policy) @ table.cost).mean()


def _spoken_of(nets: BoundNetworks, trajectories: Trajectory) -> Float[Array, "N T"]:
    """Mark the steps that f speaks of: all, but for a row whose reward is of beginning an activity, not of going on."""
    if not nets.method.is_fitted:
        return jnp.ones_like(trajectories.mask)
    code = trajectories.obs[..., : nets.env.action_space.feature_size].argmax(axis=-1)
    return (code != trajectories.action).astype(jnp.float32)


def _next_codes(nets: BoundNetworks, expert: Trajectory, scores: Scores) -> Metrics:
    """Compare log π of D_E's next codes with a first-order chain's of D_E itself, where codes follow codes."""
    view = nets.env.view
    if not isinstance(view, Codes | Activities):
        return {}
    size = nets.env.action_space.feature_size
    now, after = expert.obs[..., :size], jax.nn.one_hot(expert.action, size)
    weight = expert.mask / expert.mask.sum()
    count = jnp.einsum("nt,nti,ntj->ij", expert.mask, now, after) + SMOOTHING
    chain = jnp.einsum("nti,ij,ntj->nt", now, jnp.log(count / count.sum(axis=1, keepdims=True)), after)
    return {"log_prob": (weight * scores.log_pi).sum(), "chain_gain": (weight * (scores.log_pi - chain)).sum()}


def _log_std_at_bound(nets: BoundNetworks) -> Float[Array, ""]:
    """Compute the share of the policy's log σ that are at a bound; NaN for discrete actions."""
    log_std = nets.params.policy["params"].get("log_std")
    if log_std is None:
        return jnp.full((), jnp.nan)
    bounds = nets.config.ppo
    return ((log_std <= bounds.log_std_min) | (log_std >= bounds.log_std_max)).mean()
