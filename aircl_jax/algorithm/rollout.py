"""Roll out episodes of the policy by `lax.scan` (Algorithm 1, line 4)."""

from typing import Any

import jax
import jax.numpy as jnp
from jaxtyping import Array, PRNGKeyArray

from aircl_jax.algorithm.hoisting import hoisted_scan
from aircl_jax.model.networks import BoundNetworks
from aircl_jax.types import Trajectory
from envs import Box, Env


def rollout(nets: BoundNetworks, key: PRNGKeyArray, world: Env | None = None) -> Trajectory:
    """Draw τ ~ π_ω: reset, then T steps. `mask` ends with the step that terminates; `bootstrap` is V(s_T) at a time limit.

    The policy acts in `world`, or in the environment of its networks where `world` is None.
    """
    key_reset, key_steps = jax.random.split(key)
    start = (nets.env if world is None else world).reset(key_reset)
    return rollout_from(nets, key_steps, start, world)[0]


def rollout_from(
    nets: BoundNetworks, key: PRNGKeyArray, start: tuple[Any, Array], world: Env | None = None
) -> tuple[Trajectory, tuple[Any, Array]]:
    """Take T steps from `start`, an environment's state and its observation; return the trajectory and those at its end."""
    env = nets.env if world is None else world
    assumes_no_reward = nets.method.assumes_no_reward and not env.has_reward

    def one_step(carry: tuple, inputs: tuple[Array, Array]) -> tuple[tuple, Trajectory]:
        env_state, obs, alive = carry
        t, key_step = inputs
        key_action, key_env = jax.random.split(key_step)
        drawn: Any = nets.policy(obs, t).sample_and_log_prob(seed=key_action)
        action, log_prob = drawn
        value = nets.value(obs, t)
        env_state, step = env.step(key_env, env_state, action)
        reward = jnp.zeros(()) if assumes_no_reward else step.reward
        carry = (env_state, step.obs, alive * (1.0 - step.terminated))
        return carry, Trajectory(
            obs, action, log_prob, value, reward, step.cost, mask=alive * step.counts, bootstrap=jnp.zeros(())
        )

    scan = hoisted_scan if isinstance(env.action_space, Box) else jax.lax.scan  # hundreds of short episodes gain nothing
    steps = (jnp.arange(env.horizon), jax.random.split(key, env.horizon))
    (last_state, last_obs, alive), trajectory = scan(one_step, (*start, jnp.ones(())), steps)
    bootstrap = jnp.zeros(()) if env.finite_horizon else alive * nets.value(last_obs, jnp.asarray(env.horizon))
    return trajectory._replace(bootstrap=bootstrap), (last_state, last_obs)


def rollouts(nets: BoundNetworks, key: PRNGKeyArray, number: int, world: Env | None = None) -> Trajectory:
    """Roll out `number` independent episodes, [N, T, …]."""
    return jax.vmap(lambda key: rollout(nets, key, world))(jax.random.split(key, number))
