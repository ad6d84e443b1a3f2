"""Measure how the pendulum's noise limits its return: balance it by an LQR at several places before the wall.

`python -m experiments.pendulum_lqr noise=0.001` prints return against clean episodes, a yardstick for the trained expert.
"""

import sys
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float
from scipy.linalg import solve_discrete_are

from aircl_jax.messages import say
from envs import Env, make_env
from envs.robots.tasks import RobotState
from envs.settings import at_least
from experiments.cli.command import run_command

PLACES = (-0.014, -0.012, -0.010, -0.008, -0.006, -0.004, -0.002, 0.0)  # m; the wall is at −0.015
PLACE_COST, ACTION_COST = 1e4, 1.0  # per m² of x², and per action². The other coordinates cost 1 per unit²


@dataclass(frozen=True)
class Settings:
    noise: float = 0.001  # σ of the transition noise, m, rad, m/s, rad/s
    std: float = 0.05  # σ of the action's noise, equal to the shipped expert's
    episodes: int = 500

    def __post_init__(self) -> None:
        at_least("episodes", self.episodes, 1)
        if not self.std >= 0:
            raise ValueError(f"std={self.std} is not a number of at least 0")


def main(argv: Sequence[str] | None = None) -> int:
    return run_command(print_frontier, argv, Settings(), __doc__)


def print_frontier(settings: Settings, _: Sequence[str]) -> None:
    """Print return against clean episodes, one line per place."""
    env = make_env("pendulum", noise=settings.noise)
    gain = regulator(make_env("pendulum", noise=0.0))
    say("place, m | return | clean episodes, % | return of the clean | violating steps")
    for place in PLACES:
        rewards, costs = balance(env, gain, place, settings)
        clean = costs == 0
        of_clean = rewards[clean].mean() if clean.any() else np.nan
        say(f"{place:8.3f} | {rewards.mean():6.1f} | {100 * clean.mean():17.1f} | {of_clean:19.1f} | {costs.mean():15.2f}")


def regulator(env: Env) -> Float[np.ndarray, "A O"]:
    """Compute K of a = −K (s − s*), the infinite-horizon LQR of the control step linearised upright."""
    rest = jnp.zeros(env.obs_size)

    def moved(obs: Float[Array, " O"], action: Float[Array, " A"]) -> Array:
        half = env.obs_size // 2
        return env.step(jax.random.key(0), RobotState(obs[:half], obs[half:]), action)[1].obs

    a, b = (np.asarray(jax.jacfwd(moved, argnums)(rest, jnp.zeros(1)), np.float64) for argnums in (0, 1))
    action_cost = np.array([[ACTION_COST]])
    cost_to_go = solve_discrete_are(a, b, np.diag([PLACE_COST, 1.0, 1.0, 1.0]), action_cost)
    return np.linalg.solve(action_cost + b.T @ cost_to_go @ b, b.T @ cost_to_go @ a)


def balance(
    env: Env, gain: Float[np.ndarray, "A O"], place: float, settings: Settings
) -> tuple[Float[np.ndarray, " N"], Float[np.ndarray, " N"]]:
    """Balance at a place; return each episode's return and its number of violating steps."""
    target = jnp.zeros(env.obs_size).at[0].set(place)

    def episode(key: Array) -> tuple[Array, Array]:
        key_reset, key_steps = jax.random.split(key)

        def one_step(carry: tuple[Any, Array], key: Array) -> tuple[tuple[Any, Array], tuple[Array, Array]]:
            state, obs = carry
            key_action, key_env = jax.random.split(key)
            action = -jnp.asarray(gain) @ (obs - target) + settings.std * jax.random.normal(key_action, (1,))
            state, step = env.step(key_env, state, action)
            return (state, step.obs), (step.reward, step.cost)

        return jax.lax.scan(one_step, env.reset(key_reset), jax.random.split(key_steps, env.horizon))[1]

    rewards, costs = jax.jit(jax.vmap(episode))(jax.random.split(jax.random.key(0), settings.episodes))
    return np.asarray(rewards.sum(axis=1)), np.asarray(costs.sum(axis=1))


if __name__ == "__main__":
    sys.exit(main())
