"""Update the policy by proximal policy optimisation on whole trajectories (Algorithm 1, line 7)."""

from typing import Any, NamedTuple, cast

import jax
import jax.numpy as jnp
import optax
from jaxtyping import Array, Float, Int, PRNGKeyArray

from aircl_jax.algorithm.learners.shuffling import shuffled
from aircl_jax.algorithm.masks import masked_mean
from aircl_jax.model.distributions import project_log_std
from aircl_jax.model.networks import BoundNetworks
from aircl_jax.settings.train_config import PPOConfig
from aircl_jax.types import Metrics, Params, Trajectory


def gae(
    reward: Float[Array, " T"],
    value: Float[Array, " T"],
    bootstrap: Float[Array, ""],
    mask: Float[Array, " T"],
    discount: float,
    gae_lambda: float,
) -> Float[Array, " T"]:
    """Â_t = Σ_l (γλ)^l δ_{t+l} of one trajectory, zero past termination (Schulman et al. 2016, Eq. 16).

    δ_t = r_t + γ V_{t+1} − V_t, with V_{t+1} = 0 after the step that terminates and V_T = bootstrap at the horizon.
    """
    value_next = jnp.append(value[1:] * mask[1:], bootstrap)
    delta = reward + discount * value_next - value

    def backward(advantage_next: Float[Array, ""], inputs: tuple[Array, Array]) -> tuple[Array, Array]:
        delta_t, mask_t = inputs
        advantage = mask_t * (delta_t + discount * gae_lambda * advantage_next)
        return advantage, advantage

    return jax.lax.scan(backward, jnp.zeros(()), (delta, mask), reverse=True)[1]


def clipped_surrogate(
    log_prob: Float[Array, "*B"], log_prob_old: Float[Array, "*B"], advantage: Float[Array, "*B"], clip_eps: float
) -> Float[Array, "*B"]:
    """min(ρ Â, clip(ρ, 1 − ε, 1 + ε) Â), ρ = π / π_old, of each step (Schulman et al. 2017, Eq. 7)."""
    ratio = jnp.exp(log_prob - log_prob_old)
    return jnp.minimum(ratio * advantage, jnp.clip(ratio, 1.0 - clip_eps, 1.0 + clip_eps) * advantage)


def make_optimiser(config: PPOConfig) -> optax.GradientTransformation:
    """Make Adam on (policy, value); each gradient is clipped by its own norm, so that the critic cannot mute the policy."""
    clip = optax.clip_by_global_norm(config.max_grad_norm)
    clip_each = optax.partition({"policy": clip, "value": clip}, ("policy", "value"))
    return optax.chain(clip_each, optax.adam(config.learning_rate, eps=1e-5))


def epoch_order(key: PRNGKeyArray, number: int, horizon: int, minibatch_size: int) -> Int[Array, "M B"]:
    """Shuffle one pass over `number` trajectories: M minibatches of B whole ones, about `minibatch_size` transitions."""
    num_minibatches = min(number, max(1, number * horizon // minibatch_size))
    size = number // num_minibatches
    return shuffled(key, number)[: num_minibatches * size].reshape(num_minibatches, size)


class Batch(NamedTuple):
    """Trajectories with their normalised advantages and value targets, over which a PPO epoch runs."""

    trajectory: Trajectory
    advantage: Float[Array, "N T"]
    target: Float[Array, "N T"]


def loss(nets: BoundNetworks, batch: Batch, config: PPOConfig) -> tuple[Array, Metrics]:
    """−surrogate + value_coef · ½ (V − target)², means over unmasked steps."""
    trajectory = batch.trajectory
    log_prob = jax.vmap(nets.log_pi)(trajectory)
    value = jax.vmap(nets.values)(trajectory)
    surrogate = clipped_surrogate(log_prob, trajectory.log_prob, batch.advantage, config.clip_eps)
    policy_loss = -masked_mean(surrogate, trajectory.mask)
    value_loss = 0.5 * masked_mean((value - batch.target) ** 2, trajectory.mask)
    moved = jnp.abs(jnp.exp(log_prob - trajectory.log_prob) - 1.0) > config.clip_eps
    metrics = {
        "policy_loss": policy_loss,
        "value_loss": value_loss,
        "approx_kl": masked_mean(trajectory.log_prob - log_prob, trajectory.mask),
        "clip_share": masked_mean(moved.astype(jnp.float32), trajectory.mask),
    }
    return policy_loss + config.value_coef * value_loss, metrics


def update(
    nets: BoundNetworks,
    opt_state: Any,
    policy: Trajectory,
    reward: Float[Array, "N T"],
    bonus: Float[Array, " N"],
    key: PRNGKeyArray,
    config: PPOConfig,
) -> tuple[Params, Any, Metrics]:
    """Run `num_epochs` passes over D_P in minibatches of whole trajectories (line 7).

    `reward` drives the critic and the advantage. `bonus` is added to the advantage of every step of its trajectory, before
    the advantages are normalised over the batch.
    """
    advantage = jax.vmap(gae, (0, 0, 0, 0, None, None))(
        reward, policy.value, policy.bootstrap, policy.mask, config.discount, config.gae_lambda
    )
    target = advantage + policy.value
    rewarded = advantage + bonus[:, None]
    centre = masked_mean(rewarded, policy.mask)
    spread = jnp.sqrt(masked_mean((rewarded - centre) ** 2, policy.mask))
    batch = Batch(policy, (rewarded - centre) / (spread + 1e-8), target)

    optimiser = make_optimiser(config)
    number, horizon = policy.mask.shape

    def trainable_loss(trainable: tuple, minibatch: Batch) -> tuple[Array, Metrics]:
        policy, value = trainable
        return loss(nets.with_params(policy=policy, value=value), minibatch, config)

    def minibatch_step(carry: tuple, index: Array) -> tuple[tuple, Metrics]:
        params, opt_state = carry
        minibatch = jax.tree.map(lambda leaf: leaf[index], batch)
        grads, metrics = jax.grad(trainable_loss, has_aux=True)((params.policy, params.value), minibatch)
        updates, opt_state = optimiser.update(grads, opt_state)
        new_policy, new_value = cast(Any, optax.apply_updates((params.policy, params.value), updates))
        params = params._replace(policy=project_log_std(new_policy, config), value=new_value)
        return (params, opt_state), metrics

    def epoch(carry: tuple, key_epoch: PRNGKeyArray) -> tuple[tuple, Metrics]:
        return jax.lax.scan(minibatch_step, carry, epoch_order(key_epoch, number, horizon, config.minibatch_size))

    keys = jax.random.split(key, config.num_epochs)
    (params, opt_state), metrics = jax.lax.scan(epoch, (nets.params, opt_state), keys)
    return params, opt_state, {name: value[-1].mean() for name, value in metrics.items()}
