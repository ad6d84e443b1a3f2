"""Train the policy by behaviour cloning, the floor that every inverse method should clear (Bain and Sammut 1995)."""

from typing import Any, cast

import jax
import optax
from jaxtyping import Array, PRNGKeyArray

from aircl_jax.algorithm.learners.ppo import epoch_order, make_optimiser
from aircl_jax.algorithm.masks import masked_mean
from aircl_jax.algorithm.sampler import take
from aircl_jax.model.distributions import project_log_std
from aircl_jax.model.networks import BoundNetworks
from aircl_jax.settings.train_config import PPOConfig
from aircl_jax.types import Metrics, Params, Trajectory


def update(
    nets: BoundNetworks,
    opt_state: Any,
    expert: Trajectory,
    key: PRNGKeyArray,
    config: PPOConfig,
) -> tuple[Params, Any, Metrics]:
    """Run `num_epochs` passes of Adam on −mean log π_ω(a_t|s_t) over D_E in PPO's minibatches; the critic stays unchanged."""
    optimiser = make_optimiser(config)
    number, horizon = expert.mask.shape

    def loss(trainable: tuple, minibatch: Trajectory) -> Array:
        policy, value = trainable
        log_prob = jax.vmap(nets.with_params(policy=policy, value=value).log_pi)(minibatch)
        return -masked_mean(log_prob, minibatch.mask)

    def minibatch_step(carry: tuple, index: Array) -> tuple[tuple, Array]:
        trainable, opt_state = carry
        value, grads = jax.value_and_grad(loss)(trainable, take(expert, index))
        updates, opt_state = optimiser.update(grads, opt_state)
        policy, critic = cast(Any, optax.apply_updates(trainable, updates))
        return ((project_log_std(policy, config), critic), opt_state), value

    def epoch(carry: tuple, key_epoch: PRNGKeyArray) -> tuple[tuple, Array]:
        return jax.lax.scan(minibatch_step, carry, epoch_order(key_epoch, number, horizon, config.minibatch_size))

    params = nets.params
    start = ((params.policy, params.value), opt_state)
    ((policy, value), opt_state), losses = jax.lax.scan(epoch, start, jax.random.split(key, config.num_epochs))
    return params._replace(policy=policy, value=value), opt_state, {"policy_loss": losses[-1].mean()}
