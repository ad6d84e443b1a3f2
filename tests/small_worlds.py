"""Three worlds of one's own whose demonstrators keep something where it is: what a velocity alone cannot say."""

from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from envs import Box, Env, Step

DEMONSTRATIONS = 50
NOISE = 0.3  # standard deviation of a demonstrated action


class Small(NamedTuple):
    """A world, and what its demonstrator does at states [N, X], before its noise, with the least and greatest that it does."""

    env: Env
    acts: Callable[[np.ndarray], np.ndarray]
    ends: tuple[tuple[float, float], ...]


def sledge() -> Small:
    """Fast forward, at most half a push of it, and in the middle of the way: state (side, its velocity, speed)."""

    def moved(state, push, key):
        side, drift, speed = state
        drift, speed = 0.9 * drift + 0.1 * push[1], 0.9 * speed + 0.1 * push[0]
        return jnp.stack([side + 0.1 * drift, drift, speed])

    def acts(state):
        return np.stack([np.full(len(state), 0.6), -2.0 * state[:, 0] - 2.0 * state[:, 1]], axis=1)

    world = _world("sledge", 100, [0.3, 0.0, 0.0], moved, lambda state: state[2] - state[0] ** 2, (0.5, 9.0))
    return Small(world, acts, ((-1.0, 0.5), (-1.0, 1.0)))


def goal() -> Small:
    """To a place and stay there, with at most half a push: state (x, y, both velocities)."""

    def moved(state, push, key):
        velocity = 0.9 * state[2:] + 0.02 * push
        return jnp.concatenate([state[:2] + velocity, velocity])

    def acts(state):
        return 4.0 * (1.0 - state[:, :2]) - 8.0 * state[:, 2:]

    world = _world("goal", 60, [0.05, 0.05, 0.0, 0.0], moved, lambda state: -jnp.linalg.norm(state[:2] - 1.0), (0.5, 0.5))
    return Small(world, acts, ((-0.5, 0.5), (-0.5, 0.5)))


def cruise() -> Small:
    """At a velocity of .4 and turning at −.2, with at most .6 of a twist: state (velocity, turning)."""

    def moved(state, push, key):
        return 0.9 * state + 0.1 * push + 0.02 * jax.random.normal(key, (2,))

    def acts(state):
        return np.array([0.4, -0.2]) + 3.0 * (np.array([0.4, -0.2]) - state)

    wanted = jnp.array([0.4, -0.2])
    world = _world("cruise", 150, [0.2, 0.2], moved, lambda state: -((state - wanted) ** 2).sum(), (9.0, 0.6))
    return Small(world, acts, ((-1.0, 1.0), (-0.6, 0.6)))


SMALL = {"sledge": sledge, "goal": goal, "cruise": cruise}


def demonstrate(small: Small, path: Path) -> None:
    """Write the demonstrations, the same each time."""
    env, draws = small.env, np.random.default_rng(1)
    step, keys = jax.jit(jax.vmap(env.step)), jax.random.split(jax.random.key(1), (env.horizon + 1, DEMONSTRATIONS))
    state, obs = jax.vmap(env.reset)(keys[-1])
    rows = []
    for key in keys[: env.horizon]:
        action = small.acts(np.asarray(state))
        action = np.clip(action + draws.normal(0.0, NOISE, action.shape), *np.transpose(small.ends)).astype(np.float32)
        state, result = step(key, state, action)
        rows.append((obs, action, result.reward, result.cost))
        obs = result.obs
    seen, done, reward, cost = (np.stack(values, axis=1) for values in zip(*rows, strict=True))
    np.savez(path, obs=seen, action=done, reward=reward, cost=cost)


def _world(name, horizon, spread, moved, reward, ends) -> Env:
    spread, ends = jnp.array(spread), jnp.array(ends)

    def reset(key):
        state = spread * jax.random.normal(key, spread.shape)
        return state, state

    def step(key, state, action):
        push = jnp.clip(action, -1.0, 1.0)
        new = moved(state, push, key)
        cost = (jnp.abs(push) > ends).any().astype(jnp.float32)
        return new, Step(obs=new, reward=reward(new), cost=cost, terminated=jnp.zeros(()))

    return Env(name, horizon, len(spread), Box(2), reset, step, constraint_input="action")
