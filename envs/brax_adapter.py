"""Any Brax or MuJoCo Playground environment with a cost predicate, as an `Env`.

    from brax import envs
    env = adapt(envs.get_environment("hopper"), lambda state, action: jnp.abs(action).max() > 0.5, horizon=500)

Brax's and Playground's states carry different fields, but both have `obs`, `reward` and `done`, and actions in [−1, 1].
"""

from collections.abc import Callable
from typing import Any, Literal

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, PRNGKeyArray

from envs.base import Box, Env, Step


def adapt(
    world: Any,
    violated: Callable[[Any, Float[Array, " A"]], Bool[Array, ""]],
    horizon: int,
    terminate: bool = False,
    constraint_input: Literal["state", "action", "state_action"] = "state_action",
) -> Env:
    """`violated(state after the step, clipped action)` is the cost. Raises ValueError on dictionary observations."""
    box = Box(world.action_size)
    shape = jax.eval_shape(world.reset, jax.random.key(0)).obs
    if not hasattr(shape, "size"):
        raise ValueError(f"observations of {type(world).__name__} are {type(shape).__name__}; choose an env with one vector")

    def reset(key: PRNGKeyArray) -> tuple[Any, Float[Array, " O"]]:
        state = world.reset(key)
        return state, state.obs

    def step(key: PRNGKeyArray, state: Any, action: Float[Array, " A"]) -> tuple[Any, Step]:
        """One step; the key is for worlds with noise of their own making, and Brax's keep theirs in the state."""
        action = box.clip(action)
        after = world.step(state, action)
        sound = jnp.isfinite(after.obs).all() & jnp.isfinite(after.reward)
        after = jax.tree.map(lambda new, old: jnp.where(sound, new, old), after, state)
        fallen = after.done > 0 if terminate else jnp.zeros((), bool)
        return after, Step(
            obs=after.obs,
            reward=jnp.where(sound, after.reward, 0.0),
            cost=(sound & violated(after, action)).astype(jnp.float32),
            terminated=(~sound | fallen).astype(jnp.float32),
        )

    return Env(
        name=type(world).__name__.lower(),
        horizon=horizon,
        obs_size=shape.size,
        action_space=box,
        reset=reset,
        step=step,
        constraint_input=constraint_input,
    )
