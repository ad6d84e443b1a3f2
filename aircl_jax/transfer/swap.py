"""Recombine what was learned, and train anew: the test that a reward and a constraint are separately right."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from aircl_jax.algorithm.learners.scale_free import Motors, true_motors
from aircl_jax.algorithm.masks import mean_over_steps
from aircl_jax.model.distributions import categorical
from aircl_jax.runs.result import Result
from aircl_jax.settings.learner_config import LearnerConfig, learner_config
from aircl_jax.transfer import objectives
from aircl_jax.transfer.fresh import Fresh, acting, episodes, train_fresh
from aircl_jax.transfer.grid import grid_options, named_grid, swap_table
from aircl_jax.transfer.judges import learned_motors
from aircl_jax.transfer.objectives import OfStep, Part
from aircl_jax.types import Trajectory
from envs import Box, Env, make_env

EPISODES = 96  # by which each fresh policy is measured
EPISODE_SEED = 2_147_483_644  # of their key: no run's seed
NONE = "none"  # the name of no constraint


@dataclass(frozen=True, eq=False)
class SwapResult:
    """New policies on a recombined (reward, constraint), and what they earn by the truth of the world they act in."""

    world: Env  # its reward and cost are the truth of `metrics`
    made: Fresh | Float[np.ndarray, "S T X A"]  # trained, or planned on tables
    seeds: tuple[int, ...]  # of training; of the learned parts where policies are planned
    metrics: Mapping[str, list[float]]  # per seed: return, violation_rate (of steps), infeasible_share (of episodes)

    def policy(self, obs: Float[Array, " O"], t: int = 0, index: int = 0) -> Any:
        """Return the new π(·|s_t) of the seed at this place, a distrax distribution over actions."""
        if isinstance(self.made, Fresh):
            state, motors = jax.tree.map(lambda leaf: leaf[index], (self.made.states, self.made.motors))
            return acting(self.made, state, motors).policy(obs, jnp.asarray(t))
        return categorical(jnp.asarray(obs) @ jnp.asarray(self.made[index, t], jnp.float32))


def swap(
    result: Result,
    reward: str | OfStep | None = None,
    constraint: str | OfStep | None = None,
    env: Env | None = None,
    *,
    seeds: int = 3,
    first_seed: int = 0,
    config: LearnerConfig | None = None,
) -> SwapResult:
    """Make policies anew on a recombination: no demonstrations, no discriminator, no cloning.

    `reward` and `constraint` are what the run learned (None), known ones under a name (a value of env.reward; of
    env.constraint, or a layout of the grid; `world` for that of `env`; `none` for no constraint), or functions of
    (obs, action): a reward, and a cost between 0 and 1. `env` is the world to act in, by default the run's. Measures are
    by that world's truth.

    On robots `seeds` fresh policies are trained by the learner of docs/learner.md. On grids one policy is planned exactly
    for each learned seed, and the last three arguments say nothing.

    Raises:
        ValueError: in one line, where the run learned no such part, or the world has no such name.
    """
    for setting, named in (("reward", reward), ("constraint", constraint)):
        if env is not None and isinstance(named, str) and named != "world" and (setting, named) != ("constraint", NONE):
            raise ValueError(f"{setting}={named!r} beside an Env, which has its own; choose world or a function")
    world = _world(result, reward, constraint) if env is None else env
    if world.tabular is not None:
        planned, outcomes = swap_table(result, reward, constraint, world.tabular, world.horizon)
        metrics = {
            "return": [outcome.expected_return for outcome in outcomes],
            "violation_rate": [outcome.violating_steps for outcome in outcomes],
            "infeasible_share": [outcome.violating_episodes for outcome in outcomes],
        }
        return SwapResult(world, planned, tuple(result.summary["seeds"]), metrics)
    if not isinstance(world.action_space, Box):
        raise ValueError(f"env={world.name} is neither a table nor a robot; choose a world of one of these kinds")
    paid = _part(reward, objectives.world_reward, lambda: objectives.learned_reward(result, seeds))
    # Where there is no constraint, practice begins under the learned one, if there is one (docs/learner.md).
    bound_by = None if constraint == NONE and result.networks.method.tests_steps else constraint
    cost = (
        objectives.no_cost()
        if bound_by == NONE
        else _part(bound_by, objectives.world_cost, lambda: objectives.learned_cost(result, seeds))
    )
    settings = config or learner_config(world, constrained=constraint != NONE)
    motors = learned_motors(result, seeds) if bound_by is None else None
    if isinstance(bound_by, str) and bound_by != NONE:
        motors = true_motors(world, seeds)
    chosen = range(first_seed, first_seed + seeds)
    return recombine(world, objectives.objective(paid, cost), chosen, settings, constraint != NONE, motors)


def recombine(
    world: Env,
    objective: Callable[[Trajectory], Any],
    seeds: range,
    config: LearnerConfig,
    constrained: bool = True,
    motors: Motors | None = None,
) -> SwapResult:
    """Train fresh policies on an objective and measure them in the world that it was made for.

    `motors` are where theirs stop, if the settings have such motors. Where nothing stops, asking for more has to cost.
    """
    if not config.stops:
        motors = None
    elif motors is None:
        config = replace(config, multiplier_max=LearnerConfig().multiplier_max)
    fresh = train_fresh(world, seeds, config, objective, constrained=constrained, motors=motors)
    drawn = episodes(fresh, world, EPISODES, jax.random.key(EPISODE_SEED))
    return SwapResult(world, fresh, tuple(seeds), measure(drawn))


def measure(drawn: Trajectory) -> dict[str, list[float]]:
    """Measure episodes [S, N, T, …] by the true reward and cost, seed by seed."""
    of_seed = {
        "return": jax.vmap(lambda one: (one.reward * one.mask).sum(axis=-1).mean()),
        "violation_rate": jax.vmap(lambda one: mean_over_steps(one.cost, one.mask).mean()),
        "infeasible_share": jax.vmap(lambda one: ((one.cost * one.mask).sum(axis=-1) > 0).astype(jnp.float32).mean()),
    }
    return {name: np.asarray(of(drawn), float).tolist() for name, of in of_seed.items()}


def _part(choice: Any, world: Callable[[], Part], learned: Callable[[], Part]) -> Any:
    if choice is None:
        return learned()
    return world() if isinstance(choice, str) else objectives.of_step(choice)


def _world(result: Result, reward: Any, constraint: Any) -> Env:
    """The run's world, with the named reward and constraint in place of its own: that of `none` stays, to be judged by."""
    named = {
        name: value
        for name, value in (("reward", reward), ("constraint", constraint))
        if isinstance(value, str) and value != "world" and (name, value) != ("constraint", NONE)
    }
    if not named:
        return result.spec.env
    if not result.spec.named:
        raise ValueError(f"env={result.spec.env.name} was given as an Env; choose env=Env with those wanted")
    settings = {**result.spec.env_settings, **named}
    if grid_options(result.spec) is not None:
        return make_env(result.spec.env.name, **named_grid(settings, named))
    if "constraint" in named:
        settings["limit"] = "default"
    return make_env(result.spec.env.name, **settings)
