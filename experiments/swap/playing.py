"""Play episodes of any function of observation, time and key."""

from collections.abc import Callable

import jax
import jax.numpy as jnp
from jaxtyping import Array, PRNGKeyArray

from aircl_jax.transfer.swap import EPISODE_SEED, EPISODES
from aircl_jax.types import Trajectory
from envs import Box, Env

Actor = Callable[[Array, Array, PRNGKeyArray], Array]  # (obs, t, key) -> action


def played(world: Env, act: Actor, number: int, episodes: int = EPISODES, seed: int = EPISODE_SEED) -> Trajectory:
    """Draw `number` batches of so many episodes, [B, N, T, …]."""

    def episode(key: Array) -> Trajectory:
        key_reset, key_steps = jax.random.split(key)

        def step(carry: tuple, inputs: tuple[Array, Array]) -> tuple[tuple, Trajectory]:
            (state, obs, alive), (t, key) = carry, inputs
            key_action, key_world = jax.random.split(key)
            action = act(obs, t, key_action)
            state, outcome = world.step(key_world, state, action)
            zero = jnp.zeros(())
            taken = Trajectory(obs, action, zero, zero, outcome.reward, outcome.cost, alive, zero)
            return (state, outcome.obs, alive * (1.0 - outcome.terminated)), taken

        keys = jax.random.split(key_steps, world.horizon)
        steps = (jnp.arange(world.horizon), keys)
        return jax.lax.scan(step, (*world.reset(key_reset), jnp.ones(())), steps)[1]

    keys = jax.random.split(jax.random.key(seed), (number, episodes))
    drawn = jax.jit(jax.vmap(jax.vmap(episode)))(keys)
    return drawn._replace(bootstrap=drawn.bootstrap[..., 0])


def uniform(world: Env) -> Actor:
    """Act uniformly in the box."""
    space = world.action_space
    if not isinstance(space, Box):
        raise TypeError(f"{world.name} has no box of actions")

    def act(obs: Array, t: Array, key: PRNGKeyArray) -> Array:
        return jax.random.uniform(key, space.shape, minval=space.low, maxval=space.high)

    return act
