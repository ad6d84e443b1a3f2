"""Measure controllers in a world: violations, return, how often a shield replaces an action, and what it costs."""

import time
from collections.abc import Callable
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from aircl_jax.transfer.shield import Decision
from envs import Env

EPISODE_SEED = 2_147_483_642  # of the key of all episodes: no run's seed
REPEATS, CALLS = 7, 300  # the median of so many times the mean of so many calls

Decide = Callable[[Array, Array], Decision]


class Measures(NamedTuple):
    """Of fresh episodes [E, T]: shares of steps and of episodes, and returns."""

    violating_steps: float
    violating_episodes: float
    mean_return: float
    std_return: float
    replaced: float
    helpless: float  # share of steps at which no action was found that passes

    @classmethod
    def of(cls, reward: Array, cost: Array, mask: Array, replaced: Array, feasible: Array) -> "Measures":
        steps = float(mask.sum())
        returns = np.asarray((reward * mask).sum(axis=1))
        return cls(
            violating_steps=float((cost * mask).sum()) / steps,
            violating_episodes=float(((cost * mask).max(axis=1) > 0).mean()),
            mean_return=float(returns.mean()),
            std_return=float(returns.std()),
            replaced=float((replaced * mask).sum()) / steps,
            helpless=float((~feasible * mask).sum()) / steps,
        )


def unshielded(controller: Callable[[Array, Array], Array]) -> Decide:
    return lambda obs, key: Decision(controller(obs, key), jnp.zeros((), bool), jnp.ones((), bool))


def measured(env: Env, decide: Decide, episodes: int) -> Measures:
    """Roll out fresh episodes; every controller has the same keys of the world and of its own draws."""

    def episode(key: Array) -> tuple[Array, ...]:
        key_reset, key_steps = jax.random.split(key)

        def one_step(carry: tuple[Any, Float[Array, " O"], Array], key: Array) -> tuple[Any, tuple[Array, ...]]:
            state, obs, alive = carry
            key_action, key_env = jax.random.split(key)
            decision = decide(obs, key_action)
            state, step = env.step(key_env, state, decision.action)
            kept = (step.reward, step.cost, alive * step.counts, decision.replaced, decision.feasible)
            return (state, step.obs, alive * (1.0 - step.terminated)), kept

        return jax.lax.scan(one_step, (*env.reset(key_reset), jnp.ones(())), jax.random.split(key_steps, env.horizon))[1]

    return Measures.of(*jax.jit(jax.vmap(episode))(jax.random.split(jax.random.key(EPISODE_SEED), episodes)))


def microseconds(decide: Decide, obs: Float[Array, " O"]) -> float:
    """Time one step, called alone from Python as on a robot."""
    compiled, key = jax.jit(lambda obs, key: decide(obs, key).action), jax.random.key(0)
    compiled(obs, key).block_until_ready()
    means = []
    for _ in range(REPEATS):
        started = time.perf_counter()
        for _ in range(CALLS):
            compiled(obs, key).block_until_ready()
        means.append((time.perf_counter() - started) / CALLS)
    return 1e6 * float(np.median(means))
