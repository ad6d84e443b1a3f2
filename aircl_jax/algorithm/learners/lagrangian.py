"""Train by PPO-Lagrangian: max_π J_r(π) subject to J_c(π) ≤ d, on the true reward and cost (Ray et al. 2019)."""

from collections.abc import Callable
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import optax
from jaxtyping import Array, Float, Int, PRNGKeyArray

from aircl_jax.algorithm.learners import ppo
from aircl_jax.algorithm.learners.shuffling import shuffled
from aircl_jax.algorithm.rollout import rollouts
from aircl_jax.methods import Method
from aircl_jax.model.distributions import project_log_std
from aircl_jax.model.networks import BoundNetworks, Networks, make_networks
from aircl_jax.settings.lagrangian_config import LagrangianConfig
from aircl_jax.settings.learner_config import LearnerConfig
from aircl_jax.settings.train_config import PPOConfig, TrainConfig
from aircl_jax.types import Metrics, ObsStats, Params, Thresholds, Trajectory
from envs import Env
from envs.robots.practice_worlds import restarting, weakened

_TRUE_REWARD = Method(reward="true", discriminator_of="none", feasibility="none", terms=())


class Moments(NamedTuple):
    """Number, mean and Σ (s − mean)² of all observations in training so far."""

    number: Float[Array, ""]
    mean: Float[Array, " O"]
    square: Float[Array, " O"]


class LagrangianState(NamedTuple):
    """State that one seed's training carries from one iteration to the next."""

    policy: Any
    value: Any  # V_r
    cost_value: Any  # V_c
    opt: Any
    multiplier: Float[Array, ""]  # λ
    moments: Moments
    key: PRNGKeyArray
    step: Int[Array, ""]


class Batch(NamedTuple):
    """Single steps with their advantage and both critics' targets, [B, …]."""

    obs: Float[Array, "B O"]
    action: Float[Array, "B A"]
    t: Int[Array, " B"]
    log_prob: Float[Array, " B"]
    advantage: Float[Array, " B"]
    target: Float[Array, " B"]
    cost_target: Float[Array, " B"]
    mask: Float[Array, " B"]


class Lagrangian(NamedTuple):
    """`init(key) -> state`, `step(state, constrained) -> (state, metrics)`: pure, for one seed; `constrained` is 1 or 0."""

    init: Callable[[PRNGKeyArray], LagrangianState]
    step: Callable[[LagrangianState, Float[Array, ""]], tuple[LagrangianState, Metrics]]
    nets: Networks


def make_lagrangian(env: Env, config: LagrangianConfig) -> Lagrangian:
    """Make PPO-Lagrangian's two functions; with `constrained` 0 it is plain PPO from `release` on."""
    nets = make_networks(env, _TRUE_REWARD, TrainConfig(hidden=config.hidden, ppo=config.ppo))
    optimiser = make_optimiser(config.ppo)

    def init(key: PRNGKeyArray) -> LagrangianState:
        key, key_reward, key_cost = jax.random.split(key, 3)
        first, second = nets.init(key_reward), nets.init(key_cost)
        trained = (first.policy, first.value, second.value)
        zero, zeros = jnp.zeros(()), jnp.zeros(env.obs_size)
        multiplier = jnp.asarray(config.multiplier_init, jnp.float32)
        return LagrangianState(
            *trained, optimiser.init(trained), multiplier, Moments(zero, zeros, zeros), key, zero.astype(jnp.int32)
        )

    def step(state: LagrangianState, constrained: Float[Array, ""]) -> tuple[LagrangianState, Metrics]:
        key, key_rollout, key_update = jax.random.split(state.key, 3)
        acting = bound(nets, state)
        held = (constrained > 0) | (state.step < config.release * config.iterations)
        multiplier = jnp.where(held, state.multiplier, 0.0)
        limit = jnp.where(held, config.motor_limit, jnp.inf)
        motors = weakened(env, -limit, limit) if config.motor_limit else env
        world = restarting(motors, config.fall_cost)
        episodes = rollouts(acting, key_rollout, config.num_trajectories, world)
        batch = make_batch(acting, state.cost_value, episodes, multiplier, config)
        state, metrics = update(acting, state, batch, key_update, config)
        cost = (episodes.cost * episodes.mask).sum(axis=1)
        state = state._replace(
            multiplier=next_multiplier(state.multiplier, cost.mean(), config),
            moments=observe(state.moments, episodes),
            key=key,
            step=state.step + 1,
        )
        return state, {
            **metrics,
            "return": (episodes.reward * episodes.mask).sum(axis=1).mean(),
            "cost": cost.mean(),
            "clean_share": (cost == 0).mean(),
            "multiplier": multiplier,
            "std": jnp.exp(state.policy["params"]["log_std"]).mean(),
        }

    return Lagrangian(init, step, nets)


def make_optimiser(config: PPOConfig) -> optax.GradientTransformation:
    """Make Adam on the policy and both critics, clipped by the norm of all three, as in training the shipped experts."""
    return optax.chain(optax.clip_by_global_norm(config.max_grad_norm), optax.adam(config.learning_rate, eps=1e-5))


def next_multiplier(
    multiplier: Float[Array, ""], cost: Float[Array, ""], config: LagrangianConfig | LearnerConfig
) -> Float[Array, ""]:
    """λ ← min(λ exp(rate · min(J_c − d, 1)), max): dual ascent on log λ, its step bounded while costs are large."""
    ascent = config.multiplier_rate * jnp.minimum(cost - config.cost_budget, 1.0)
    return jnp.minimum(multiplier * jnp.exp(ascent), config.multiplier_max)


def observe(moments: Moments, episodes: Trajectory) -> Moments:
    """Update the moments with further observations (Chan et al. 1979)."""
    count = episodes.mask.sum()
    mean = jnp.einsum("nt,nto->o", episodes.mask, episodes.obs) / count
    square = jnp.einsum("nt,nto->o", episodes.mask, (episodes.obs - mean) ** 2)
    total, apart = moments.number + count, mean - moments.mean
    share = count / total
    return Moments(
        number=total,
        mean=moments.mean + apart * share,
        square=moments.square + square + apart**2 * moments.number * share,
    )


def stats_of(moments: Moments) -> ObsStats:
    """Return mean and standard deviation so far; 0 and 1 before the first iteration."""
    spread = jnp.sqrt(moments.square / jnp.maximum(moments.number, 1.0))
    return ObsStats.of(moments.mean, jnp.where(moments.number > 0, spread, 1.0))


def bound(nets: Networks, state: LagrangianState) -> BoundNetworks:
    """Bind the policy and V_r to their parameters and to the statistics of observations so far."""
    thresholds = Thresholds(jnp.zeros(()), jnp.zeros(()))
    params = Params(state.policy, state.value, reward=None, feasibility=None, thresholds=thresholds)
    return nets.bind(params, stats_of(state.moments))


def lagrangian_advantage(
    gain: Float[Array, "N T"], cost_gain: Float[Array, "N T"], mask: Float[Array, "N T"], multiplier: Float[Array, ""]
) -> Float[Array, "N T"]:
    """(Â_r / std Â_r − λ Â_c) / (1 + λ), both centred; Â_c keeps its unit, because scaling would blow up rare costs."""
    gain, cost_gain = (x - ppo.masked_mean(x, mask) for x in (gain, cost_gain))
    spread = jnp.sqrt(ppo.masked_mean(gain**2, mask))
    return (gain / (spread + 1e-8) - multiplier * cost_gain) / (1.0 + multiplier)


def make_batch(
    nets: BoundNetworks,
    cost_critic: Any,
    episodes: Trajectory,
    multiplier: Float[Array, ""],
    config: LagrangianConfig,
) -> Batch:
    """Flatten all steps of the rollouts but each one's last, whose values bootstrap both critics."""
    t = jnp.broadcast_to(jnp.arange(episodes.mask.shape[1]), episodes.mask.shape)
    cost_value = jax.vmap(jax.vmap(nets.with_params(value=cost_critic).value))(episodes.obs, t)

    def estimate(reward: Array, value: Array, discount: float) -> Array:
        last = value[:, -1] * episodes.mask[:, -1]
        gae = jax.vmap(ppo.gae, (0, 0, 0, 0, None, None))
        return gae(reward[:, :-1], value[:, :-1], last, episodes.mask[:, :-1], discount, config.ppo.gae_lambda)

    reward = episodes.reward - config.centred * ppo.masked_mean(episodes.reward, episodes.mask)
    gain = estimate(config.reward_scale * reward, episodes.value, config.ppo.discount)
    cost_gain = estimate(episodes.cost, cost_value, config.cost_discount)
    early = jax.tree.map(
        lambda leaf: leaf[:, :-1],
        (episodes.obs, episodes.action, t, episodes.log_prob, episodes.value, cost_value, episodes.mask),
    )
    obs, action, t, log_prob, value, cost_value, mask = early
    advantage = lagrangian_advantage(gain, cost_gain, mask, multiplier)
    steps = Batch(obs, action, t, log_prob, advantage, value + gain, cost_value + cost_gain, mask)
    return jax.tree.map(lambda leaf: leaf.reshape(-1, *leaf.shape[2:]), steps)


def loss(trained: tuple[Any, Any, Any], nets: BoundNetworks, batch: Batch, config: PPOConfig) -> tuple[Array, Metrics]:
    """−surrogate + value_coef · ½ ((V_r − target)² + (V_c − cost target)²), means over unmasked steps."""
    policy, value, cost_value = trained
    acting, cost_critic = nets.with_params(policy=policy, value=value), nets.with_params(value=cost_value)

    def evaluate(step: Batch) -> tuple[Array, Array, Array]:
        log_prob = jnp.asarray(acting.policy(step.obs, step.t).log_prob(step.action))
        return log_prob, acting.value(step.obs, step.t), cost_critic.value(step.obs, step.t)

    log_prob, values, cost_values = jax.vmap(evaluate)(batch)
    surrogate = ppo.clipped_surrogate(log_prob, batch.log_prob, batch.advantage, config.clip_eps)
    policy_loss = -ppo.masked_mean(surrogate, batch.mask)
    errors = (values - batch.target) ** 2 + (cost_values - batch.cost_target) ** 2
    value_loss = 0.5 * ppo.masked_mean(errors, batch.mask)
    kl = ppo.masked_mean(batch.log_prob - log_prob, batch.mask)
    return policy_loss + config.value_coef * value_loss, {"value_loss": value_loss, "approx_kl": kl}


def update(
    nets: BoundNetworks, state: LagrangianState, batch: Batch, key: PRNGKeyArray, config: LagrangianConfig
) -> tuple[LagrangianState, Metrics]:
    """Run `num_epochs` passes over the steps in shuffled minibatches; the step size falls linearly over the iterations."""
    number = batch.mask.size
    num_minibatches = max(1, number // config.ppo.minibatch_size)
    optimiser = make_optimiser(config.ppo)
    left = jnp.maximum(1.0 - state.step / config.iterations, 0.0)

    def minibatch_step(carry: tuple[Any, Any], index: Array) -> tuple[tuple[Any, Any], Metrics]:
        trained, opt = carry
        minibatch = jax.tree.map(lambda leaf: leaf[index], batch)
        grads, metrics = jax.grad(loss, has_aux=True)(trained, nets, minibatch, config.ppo)
        updates, opt = optimiser.update(grads, opt)
        policy, *values = jax.tree.map(lambda old, change: old + left * change, trained, updates)
        return ((project_log_std(policy, config.ppo), *values), opt), metrics

    def epoch(carry: tuple[Any, Any], key_epoch: PRNGKeyArray) -> tuple[tuple[Any, Any], Metrics]:
        size = number // num_minibatches
        order = shuffled(key_epoch, number)[: num_minibatches * size]
        return jax.lax.scan(minibatch_step, carry, order.reshape(num_minibatches, size))

    start = ((state.policy, state.value, state.cost_value), state.opt)
    keys = jax.random.split(key, config.ppo.num_epochs)
    (trained, opt), metrics = jax.lax.scan(epoch, start, keys)
    policy, value, cost_value = trained
    state = state._replace(policy=policy, value=value, cost_value=cost_value, opt=opt)
    return state, {name: by_epoch[-1].mean() for name, by_epoch in metrics.items()}
