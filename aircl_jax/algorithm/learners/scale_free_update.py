"""The update of the scale-free learner: two advantages, two critics, minibatches of single steps."""

from collections.abc import Hashable
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import optax
from jaxtyping import Array, Float, PRNGKeyArray

from aircl_jax.algorithm.learners import ppo
from aircl_jax.algorithm.learners.lagrangian import lagrangian_advantage
from aircl_jax.algorithm.learners.shuffling import shuffled
from aircl_jax.algorithm.masks import masked_mean
from aircl_jax.model.distributions import project_log_std
from aircl_jax.model.networks import BoundNetworks
from aircl_jax.settings.learner_config import LearnerConfig
from aircl_jax.types import Metrics, Trajectory


class Trained(NamedTuple):
    """The parameters that gradients move."""

    policy: Any
    value: Any  # V_r
    cost_value: Any  # V_c


class Batch(NamedTuple):
    """Single steps with their advantage and both critics' targets, [B, …]."""

    obs: Float[Array, "B O"]
    action: Float[Array, "B A"]
    log_prob: Float[Array, " B"]
    advantage: Float[Array, " B"]
    target: Float[Array, " B"]
    cost_target: Float[Array, " B"]
    mask: Float[Array, " B"]


def make_optimiser(config: LearnerConfig, horizon: int) -> optax.GradientTransformation:
    """Adam with a rate that falls to 0; each network's gradient is clipped by its own norm."""
    clips: dict[Hashable, optax.GradientTransformation] = {
        name: optax.clip_by_global_norm(config.ppo.max_grad_norm) for name in Trained._fields
    }
    updates = config.ppo.num_epochs * num_minibatches(config, horizon)
    rate = optax.linear_schedule(float(config.ppo.learning_rate), 0.0, config.iterations * updates)
    return optax.chain(optax.partition(clips, Trained(*Trained._fields)), optax.adam(rate, eps=1e-5))


def num_minibatches(config: LearnerConfig, horizon: int) -> int:
    """How many minibatches of about `minibatch_size` steps an iteration's rollouts make."""
    return max(1, config.num_trajectories * horizon // config.ppo.minibatch_size)


def make_batch(
    acting: BoundNetworks,
    cost_critic: Any,
    trajectories: Trajectory,
    last_obs: Float[Array, "N O"],
    reward: Float[Array, "N T"],
    cost: Float[Array, "N T"],
    multiplier: Float[Array, ""],
    config: LearnerConfig,
) -> Batch:
    """All steps with Â = (Â_r / std Â_r − λ Â_c) / (1 + λ) and the targets V + Â of both critics."""
    mask, cost_critic = trajectories.mask, acting.with_params(value=cost_critic)
    cost_value = jax.vmap(cost_critic.values)(trajectories)
    last_cost = jax.vmap(lambda obs: cost_critic.value(obs, jnp.asarray(acting.env.horizon)))(last_obs)
    estimate = jax.vmap(ppo.gae, (0, 0, 0, 0, None, None))
    gain = estimate(reward, trajectories.value, trajectories.bootstrap, mask, config.ppo.discount, config.ppo.gae_lambda)
    cost_gain = estimate(cost, cost_value, last_cost * mask[:, -1], mask, config.cost_discount, config.ppo.gae_lambda)
    advantage = lagrangian_advantage(gain, cost_gain, mask, multiplier)
    steps = Batch(
        trajectories.obs,
        trajectories.action,
        trajectories.log_prob,
        advantage,
        trajectories.value + gain,
        cost_value + cost_gain,
        mask,
    )
    return jax.tree.map(lambda leaf: leaf.reshape(-1, *leaf.shape[2:]), steps)


def loss(trained: Trained, acting: BoundNetworks, batch: Batch, config: LearnerConfig) -> tuple[Array, Metrics]:
    """−surrogate + value_coef · ½ ((V_r − target)² + (V_c − cost target)²), means over unmasked steps."""
    nets, cost_critic = (
        acting.with_params(policy=trained.policy, value=trained.value),
        acting.with_params(value=trained.cost_value),
    )
    now = jnp.zeros((), jnp.int32)  # no network sees t: nothing here ends at the horizon

    def one(step: Batch) -> tuple[Array, Array, Array]:
        log_prob = jnp.asarray(nets.policy(step.obs, now).log_prob(step.action))
        return log_prob, nets.value(step.obs, now), cost_critic.value(step.obs, now)

    log_prob, value, cost_value = jax.vmap(one)(batch)
    surrogate = ppo.clipped_surrogate(log_prob, batch.log_prob, batch.advantage, config.ppo.clip_eps)
    errors = (value - batch.target) ** 2 + (cost_value - batch.cost_target) ** 2
    value_loss = 0.5 * masked_mean(errors, batch.mask)
    kl = masked_mean(batch.log_prob - log_prob, batch.mask)
    total = -masked_mean(surrogate, batch.mask) + config.ppo.value_coef * value_loss
    return total, {"value_loss": value_loss, "approx_kl": kl}


def update(
    acting: BoundNetworks,
    trained: Trained,
    opt: Any,
    batch: Batch,
    key: PRNGKeyArray,
    optimiser: optax.GradientTransformation,
    config: LearnerConfig,
) -> tuple[Trained, Any, Metrics]:
    """`num_epochs` passes over the steps in shuffled minibatches."""
    number = batch.mask.size
    minibatches = num_minibatches(config, acting.env.horizon)

    def minibatch_step(carry: tuple[Trained, Any], index: Array) -> tuple[tuple[Trained, Any], Metrics]:
        trained, opt = carry
        minibatch = jax.tree.map(lambda leaf: leaf[index], batch)
        grads, metrics = jax.grad(loss, has_aux=True)(trained, acting, minibatch, config)
        updates, opt = optimiser.update(grads, opt)
        moved = jax.tree.map(jnp.add, trained, updates)
        return (moved._replace(policy=project_log_std(moved.policy, config.ppo)), opt), metrics

    def epoch(carry: tuple[Trained, Any], key_epoch: PRNGKeyArray) -> tuple[tuple[Trained, Any], Metrics]:
        size = number // minibatches
        order = shuffled(key_epoch, number)[: minibatches * size]
        return jax.lax.scan(minibatch_step, carry, order.reshape(minibatches, size))

    keys = jax.random.split(key, config.ppo.num_epochs)
    (trained, opt), metrics = jax.lax.scan(epoch, (trained, opt), keys)
    return trained, opt, {name: values[-1].mean() for name, values in metrics.items()}
