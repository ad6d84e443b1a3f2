"""Behaviour cloning, the floor that every inverse method should clear (Bain and Sammut 1995)."""

from typing import Any, cast

import jax
import optax
from jaxtyping import Array

from aircl_jax.config import PPOConfig
from aircl_jax.networks import Networks, project_log_std
from aircl_jax.ppo import make_optimiser, masked_mean
from aircl_jax.types import Metrics, ObsStats, Params, Trajectory


def update(
    nets: Networks, params: Params, opt_state: Any, stats: ObsStats, expert: Trajectory, config: PPOConfig
) -> tuple[Params, Any, Metrics]:
    """`num_epochs` Adam steps on −mean log π_ω(a_t|s_t) over all of D_E; the critic stands still."""
    optimiser = make_optimiser(config)

    def loss(trainable: tuple) -> Array:
        policy, value = trainable
        log_prob = jax.vmap(nets.log_pi, (None, None, 0))(params._replace(policy=policy, value=value), stats, expert)
        return -masked_mean(log_prob, expert.mask)

    def one_step(carry: tuple, _: None) -> tuple[tuple, Array]:
        trainable, opt_state = carry
        value, grads = jax.value_and_grad(loss)(trainable)
        updates, opt_state = optimiser.update(grads, opt_state)
        policy, critic = cast(Any, optax.apply_updates(trainable, updates))
        return ((project_log_std(policy, config), critic), opt_state), value

    start = ((params.policy, params.value), opt_state)
    ((policy, value), opt_state), losses = jax.lax.scan(one_step, start, length=config.num_epochs)
    return params._replace(policy=policy, value=value), opt_state, {"policy_loss": losses[-1]}
