"""Worlds that an expert practises in: weaker motors, restarts in place of an end, clipped actions."""

from dataclasses import replace
from functools import partial
from typing import Any

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, PRNGKeyArray

from envs import Env, Step


def weakened(env: Env, lower: Float[Array, "*A"], upper: Float[Array, "*A"]) -> Env:
    """Give the world motors that stop at these limits. Asking for more has cost 1."""

    def step(key: PRNGKeyArray, state: Any, action: Array) -> tuple[Any, Step]:
        state, result = env.step(key, state, jnp.clip(action, lower, upper))
        asked = ((action < lower) | (action > upper)).any().astype(result.cost.dtype)
        return state, result._replace(cost=jnp.maximum(result.cost, asked))

    return replace(env, step=step)


def restarting(env: Env, fall_cost: float) -> Env:
    """Replace the world's end by a reset. Terminating has cost `fall_cost`; the next step resets and does not count."""

    def reset(key: PRNGKeyArray) -> tuple[Any, Float[Array, " O"]]:
        state, obs = env.reset(key)
        return (state, jnp.zeros(())), obs

    def step(key: PRNGKeyArray, state: Any, action: Array) -> tuple[Any, Step]:
        inner, fallen = state
        moved, result = env.step(key, inner, action)
        risen, obs = env.reset(key)
        again = Step(obs, *[jnp.zeros(())] * 3, counts=0.0)  # no step of the task
        pick = partial(jnp.where, fallen > 0)
        ended = pick(0.0, result.terminated)
        lasting = result._replace(cost=jnp.maximum(result.cost, fall_cost * result.terminated), terminated=jnp.zeros(()))
        shown = jax.tree.map(pick, again, lasting)
        return (jax.tree.map(pick, risen, moved), ended), shown

    return replace(env, reset=reset, step=step, fallen=None)


def ending(env: Env) -> Env:
    """End the world where its body has fallen, whatever its own option says; where nothing can fall it stays as it is."""
    fallen = env.fallen
    if fallen is None:
        return env

    def step(key: PRNGKeyArray, state: Any, action: Array) -> tuple[Any, Step]:
        state, result = env.step(key, state, action)
        return state, result._replace(terminated=jnp.maximum(result.terminated, fallen(state).astype(jnp.float32)))

    return replace(env, step=step)


def bounded(env: Env, low: Float[Array, " O"], high: Float[Array, " O"]) -> Env:
    """End the world where a coordinate of the observation leaves [low, high]."""

    def step(key: PRNGKeyArray, state: Any, action: Array) -> tuple[Any, Step]:
        state, result = env.step(key, state, action)
        outside = ((result.obs < low) | (result.obs > high)).any().astype(result.terminated.dtype)
        return state, result._replace(terminated=jnp.maximum(result.terminated, outside))

    return replace(env, step=step)


def clipped_world(env: Env, lower: Float[Array, "*A"] | float, upper: Float[Array, "*A"] | float) -> Env:
    """Clip every action to [lower, upper] first."""
    return replace(env, step=lambda key, state, action: env.step(key, state, jnp.clip(action, lower, upper)))
