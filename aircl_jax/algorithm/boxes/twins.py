"""The contrast row where actions are of a box: a reward by moments, limits by what a tempted twin of the policy does.

One fused step of one seed, as in `trainer`. π is paid f and kept within the limits by PPO-Lagrangian; those of actions clip
what it draws besides. The twin goes on with f alone, from the π of the iteration in which the feature means have nearly met
(docs/equations.md).
"""

from collections.abc import Callable
from dataclasses import replace
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int, PRNGKeyArray

from aircl_jax.algorithm.boxes import action_limits, moments, state_limits
from aircl_jax.algorithm.boxes.practice_rollouts import box_of, motor_limits, practice_world, reached, rolled_out
from aircl_jax.algorithm.learners import practice as practising
from aircl_jax.algorithm.learners.practice import Learning, Practice
from aircl_jax.algorithm.learners.scale_free import falls
from aircl_jax.algorithm.learners.scale_free_update import make_optimiser
from aircl_jax.algorithm.measures import FINITE, all_finite, step_metrics
from aircl_jax.algorithm.pooling import ALONE, Pool
from aircl_jax.algorithm.sampler import take
from aircl_jax.algorithm.scoring import calibrated, trajectory_feasibility
from aircl_jax.model.feasibility import FORBIDDEN_BELOW, log_step_feasibility
from aircl_jax.model.features import UNLIMITED
from aircl_jax.model.networks import BoundNetworks, Networks
from aircl_jax.settings.learner_config import LearnerConfig
from aircl_jax.settings.train_config import TrainConfig
from aircl_jax.types import Metrics, ObsStats, Params, TrainState, Trajectory

ASKED = 5  # demonstrated trajectories in whose states the twin is asked each iteration
WIDER = 1.7  # σ of the first policy, in standard deviations of the demonstrated actions
MOST_CHARGED = 10.0  # of a step, where the line is 1
MOST_STRAYS = 0.2  # a rollout, where motors stop at the limits whatever is charged
AT_FIRST = 1.0 / 30.0  # share of λ to begin with, there too
STILL_LEARNS = 0.8  # share of the iterations until the learning rate is 0, after which f is not chosen anew
LASTING = 10  # iterations in a row in which the means have nearly met, so that it is no chance
_NO_REPLAY: Any = None  # no term of the row has negatives


class Contrast(NamedTuple):
    """What reward and limits are learned from."""

    weights: moments.Weights
    made: action_limits.Made  # over all tasks, as M
    expected: Float[Array, "A B"]  # M / steps of actions: mean over all iterations so far, or since f was chosen anew
    num_averaged: Float[Array, ""]  # their number
    near: Float[Array, ""]  # iterations in a row in which the means had nearly met
    since: Float[Array, ""]  # iterations since the constraint and the twin began
    twin: Practice
    reach: state_limits.Reach
    met: state_limits.Met | None  # what states were met; None where actions are counted


class Steps(NamedTuple):
    """`init(key, expert, stats) -> state` and `step(state, expert) -> (state, metrics)` of one seed."""

    init: Callable[[PRNGKeyArray, Trajectory, ObsStats], TrainState]
    step: Callable[[TrainState, Trajectory], tuple[TrainState, Metrics]]


def make_steps(nets: Networks, pool: Pool = ALONE) -> Steps:
    """Make the training loop's two functions; n and M of the limits are sums over the tasks of the pool.

    Raises:
        ValueError: in one line, where actions are not of a bounded box, or the task ends at the horizon.
    """
    env, config = nets.env, nets.config
    base = learning_of(nets)

    def init(key: PRNGKeyArray, expert: Trajectory, stats: ObsStats) -> TrainState:
        key, key_nets, key_cost, key_world = jax.random.split(key, 4)
        taken = jax.vmap(jax.vmap(env.action_space.features))(expert.action)
        params, (low, high) = with_std(nets.init(key_nets), taken, expert.mask), reached(expert)
        reach = pool.least(low), pool.greatest(high)
        world = practice_world(env, reach, config)
        practice = practising.begin(base, params, nets.init(key_cost).value, world, key_world)
        own = action_limits.actions_made(taken.reshape(-1, taken.shape[-1]), expert.mask.ravel())
        made = action_limits.pooled(own, pool)
        scale, zero = state_limits.scale_of(reach, config.moments.margin), jnp.zeros(())
        met = state_limits.begin(expert, scale, pool) if nets.feasibility_sees_state else None
        weights = moments.first_weights(params.reward["params"]["weights"].size, config)
        contrast = Contrast(weights, made, jnp.zeros_like(made.number), zero, zero, zero, practice, reach, met)
        params = params._replace(policy=held(nets, params.policy, params.feasibility, zero))
        return TrainState(params, practice, contrast, stats, _NO_REPLAY, key, jnp.zeros((), jnp.int32))

    def step(state: TrainState, expert: Trajectory) -> tuple[TrainState, Metrics]:
        key, key_rollout, key_asked, key_update, key_twin, key_twin_update = jax.random.split(state.key, 6)
        contrast: Contrast = state.adversary_opt
        rolled = rolled_out(nets, base, state, key_rollout, key_twin)
        policy, learning = rolled.policy, dearer(base, contrast.since > 0, config)
        before = nets.bind(state.params, state.obs_stats)
        bound = (contrast.since > 0).astype(jnp.float32)

        gap = moments.mean_features(before, expert) - moments.mean_features(before, policy)
        near = (contrast.near + 1.0) * (moments.size_of(gap) < config.moments.near)
        begun = contrast.since > 0
        began = begun | (near >= LASTING) | (state.step >= config.feasibility_delay)
        weights = moments.next_weights(
            contrast.weights, gap, state.step, began, begun, learns(state.step, config), config.moments
        )
        # What twins of another f did is no evidence of a limit: where f is chosen anew, M and twins begin anew, in all tasks.
        kept = pool.every(weights.rechosen == contrast.weights.rechosen)
        share = pool.mean(asked_of(practising.acting(before, contrast.twin), expert, key_asked), expert.mask.sum())
        expected, num_averaged = averaged(contrast, share, kept)
        feasibility = limited(nets, contrast._replace(expected=expected), state.obs_stats)
        params = state.params._replace(reward={"params": {"weights": weights.now}}, feasibility=feasibility)
        params, expert_log_delta = calibrated(nets.bind(params, state.obs_stats), expert, pool)

        after = nets.bind(params, state.obs_stats)
        cost = bound * beyond(after, policy)
        new, losses = practising.learn(
            learning, before, rolled.practice, policy, jax.vmap(after.f)(policy), cost, bound, key_update
        )

        def alone(twin: Practice, tempted: Trajectory) -> tuple[Practice, Trajectory]:
            pay, nothing = jax.vmap(after.f)(tempted), jnp.zeros_like(tempted.mask)
            return practising.learn(learning, before, twin, tempted, pay, nothing, jnp.zeros(()), key_twin_update)[0], tempted

        goes_on = kept & (contrast.since > 0)
        twin, tempted = jax.lax.cond(goes_on, alone, lambda *_: (new, policy), rolled.twin, rolled.tempted)
        policy_params = held(nets, new.trained.policy, params.feasibility, (contrast.since + began > 0).astype(jnp.float32))
        params = params._replace(policy=policy_params, value=new.trained.value)
        done = policy if nets.feasibility_sees_state else policy._replace(action=jnp.clip(policy.action, *motor_limits(before)))
        metrics = {
            **step_metrics(env, done, done, trajectory_feasibility(after, done), expert_log_delta),
            **losses,
            "moment_gap": moments.size_of(gap),
            "rechosen": weights.rechosen,
            "multiplier": new.multiplier,
            "constrained": bound,
            "strays": falls(policy.mask).sum(axis=1).mean(),
            "twin_return": (tempted.reward * tempted.mask).sum(axis=1).mean(),
            "twin_violation_rate": (tempted.cost * tempted.mask).sum() / tempted.mask.sum(),
        }
        metrics[FINITE] = all_finite((params, losses, policy.obs)).astype(jnp.float32)
        met = met_by(contrast, tempted, kept, config, pool, expert.mask.sum())
        since = contrast.since + began
        contrast = Contrast(weights, contrast.made, expected, num_averaged, near, since, twin, contrast.reach, met)
        return TrainState(params, new, contrast, state.obs_stats, _NO_REPLAY, key, state.step + 1), metrics

    return Steps(init, step)


def learns(step: Int[Array, ""], config: TrainConfig) -> Bool[Array, ""]:
    """Whether π still learns fast enough to follow another f."""
    return jnp.asarray(not config.lr_decay_iterations) | (step < STILL_LEARNS * config.lr_decay_iterations)


def learning_of(nets: Networks) -> Learning:
    """What does not change in training. Raises ValueError where the world has no such box."""
    box_of(nets.env)
    sees_state = nets.feasibility_sees_state
    settings = learner_of(nets.config, sees_state=sees_state, stops=not sees_state)
    return Learning(settings, make_optimiser(settings, nets.env.horizon))


def dearer(learning: Learning, later: Bool[Array, ""], config: TrainConfig) -> Learning:
    """The same with what a stray costs by now: more once f is chosen, when a fall forward may pay."""
    price = jnp.where(later, config.moments.stray_cost_later, config.moments.stray_cost)
    return learning._replace(config=replace(learning.config, stray_cost=price))


def learner_of(config: TrainConfig, *, sees_state: bool, stops: bool) -> LearnerConfig:
    """The learner's settings: the run's own where it has them.

    A cost of the action alone is charged to it alone, with no discount: what is charged later is no fault of this one. Where
    motors stop at the limits in any case, it is charged little at first, and less while π falls.
    """
    return replace(
        LearnerConfig(),
        iterations=config.lr_decay_iterations,
        num_trajectories=config.num_trajectories,
        hidden=config.hidden,
        ppo=config.ppo,
        cost_discount=LearnerConfig().cost_discount if sees_state else 0.0,
        stray_cost=config.moments.stray_cost,
        most_strays=MOST_STRAYS if stops else LearnerConfig().most_strays,
        multiplier_init=config.moments.multiplier_init * (AT_FIRST if stops else 1.0),
        multiplier_rate=config.moments.multiplier_rate,
    )


def with_std(params: Params, taken: Float[Array, "N T A"], mask: Float[Array, "N T"]) -> Params:
    """Give the first policy a σ of the demonstrated actions' size, whatever share of the box they use."""
    weight = mask / mask.sum()
    mean = jnp.einsum("nta,nt->a", taken, weight)
    log_std = jnp.log(WIDER) + 0.5 * jnp.log(jnp.einsum("nta,nt->a", (taken - mean) ** 2, weight) + 1e-8)
    return params._replace(policy={"params": {**params.policy["params"], "log_std": log_std}})


def asked_of(nets: BoundNetworks, expert: Trajectory, key: PRNGKeyArray) -> Float[Array, "A B"]:
    """How a policy's actions would be spread over the bins of each action, where the demonstrated one is on the same side."""
    asked = take(expert, jax.random.permutation(key, expert.mask.shape[0])[:ASKED])
    obs = asked.obs.reshape(-1, asked.obs.shape[-1])
    now = jnp.zeros((), jnp.int32)  # no policy here sees the time
    mean = jax.vmap(lambda seen: box_of(nets.env).in_half_widths(jnp.asarray(nets.policy(seen, now).mean())))(obs)
    taken = jax.vmap(nets.env.action_space.features)(asked.action.reshape(len(obs), -1))
    return action_limits.share_expected(mean, jnp.exp(nets.params.policy["params"]["log_std"]), taken, asked.mask.ravel())


def averaged(
    contrast: Contrast, share: Float[Array, "A B"], kept: Bool[Array, ""]
) -> tuple[Float[Array, "A B"], Float[Array, ""]]:
    """The mean of M's share over this iteration too, and how many there are; nothing yet where f was not `kept`."""
    number = kept * (contrast.num_averaged + 1.0)
    return kept * (contrast.expected + (share - contrast.expected) / jnp.maximum(number, 1.0)), number


def met_by(
    contrast: Contrast, twin: Trajectory, kept: Bool[Array, ""], config: TrainConfig, pool: Pool, steps: Float[Array, ""]
) -> state_limits.Met | None:
    """What states were met, with those of this iteration's twins once each task's goes its own way; `steps` are of D_E.

    Where f was not `kept`, nothing was met so far.
    """
    if contrast.met is None:
        return None
    scale = state_limits.scale_of(contrast.reach, config.moments.margin)
    later = state_limits.next_limits(contrast.met, twin, scale, config.coefficients, pool, steps)
    alone, nothing = pool.every(contrast.since > 0), state_limits.reset(contrast.met)
    return jax.tree.map(lambda new, old, none: jnp.where(kept, jnp.where(alone, new, old), none), later, contrast.met, nothing)


def limited(nets: Networks, contrast: Contrast, stats: ObsStats) -> dict:
    """The feasibility's parameters: the limits that n against M draws, of states or of actions."""
    if contrast.met is not None:
        scale = state_limits.scale_of(contrast.reach, nets.config.moments.margin)
        lower, upper = state_limits.drawn(contrast.met, scale, stats)
    else:
        lower, upper = action_limits.limits(contrast.made, contrast.expected, nets.config.coefficients)
    return {"step": {"params": {"lower": lower, "upper": upper}}}


def held(nets: Networks, policy: Any, feasibility: dict, bound: Float[Array, ""]) -> Any:
    """The policy's parameters with the limits of actions that clip what it draws; wider than any box where `bound` is 0.

    Of a constraint on states they are those that were given.
    """
    if nets.feasibility_sees_state:
        return policy
    drawn = feasibility["step"]["params"]
    ends = {side: jnp.where(bound > 0, drawn[side], free) for side, free in (("lower", -UNLIMITED), ("upper", UNLIMITED))}
    return {"params": {**policy["params"], **ends}}


def beyond(nets: BoundNetworks, trajectories: Trajectory) -> Float[Array, "N T"]:
    """−log₂ δ₁ at each step with δ₁ < ½, at most `MOST_CHARGED`, and else 0: 1 on the line, and more the further beyond.

    A charge that is the same everywhere beyond would tell a policy whose every action lies there nothing.
    """
    scores = jax.vmap(nets.feasibility_scores)(trajectories)
    delta = log_step_feasibility(nets.method, nets.config.coefficients, scores)
    charged = jnp.minimum(-delta / jnp.log(2.0), MOST_CHARGED)
    return jnp.where(delta < jnp.log(FORBIDDEN_BELOW), charged, 0.0) * trajectories.mask
