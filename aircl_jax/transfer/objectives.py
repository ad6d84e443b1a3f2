"""What a fresh policy is paid by and bound by: the world's own reward and cost, learned ones, or functions of a step."""

from collections.abc import Callable
from functools import partial
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax.tree_util import Partial
from jaxtyping import Array, Float

from aircl_jax.algorithm.learners.scale_free import Objective
from aircl_jax.model.feasibility import FORBIDDEN_BELOW, log_step_feasibility
from aircl_jax.model.networks import Networks
from aircl_jax.runs.result import Result
from aircl_jax.types import Trajectory

Part = Callable[[Trajectory], Float[Array, " T"]]  # a `Partial`: the pay, or the cost, of each step of one trajectory
OfStep = Callable[[Array, Array], Array]  # (obs, action) -> a number


def objective(reward: Part, cost: Part) -> Objective:
    """Join a reward and a cost."""
    return Partial(_both, reward, cost)


def world_reward() -> Part:
    """Pay the world's own reward."""
    return Partial(_world_reward)


def world_cost() -> Part:
    """Charge the world's own cost."""
    return Partial(_world_cost)


def no_cost() -> Part:
    """Charge nothing."""
    return Partial(_no_cost)


def of_step(function: OfStep) -> Part:
    """Turn a function of (obs, action) into one of a trajectory's steps."""
    return Partial(partial(_of_step, function))


def learned_reward(result: Result, number: int) -> Part:
    """Pay f_θ(s_t, a_t); fresh seed i has that of learned seed i, and again from the first where there are fewer."""
    if not result.networks.method.learns_reward:
        raise ValueError(f"method={result.spec.method_name} learns no reward to swap; choose reward=NAME or a function")
    return Partial(partial(_learned_reward, result.networks), *_cycled(result, number))


def learned_cost(result: Result, number: int) -> Part:
    """Charge 1 where δ₁(s_t, a_t) < ½, with the seeds as in `learned_reward`."""
    if not result.networks.method.tests_steps:
        raise ValueError(f"method={result.spec.method_name} has no δ₁ to swap; choose constraint=NAME or a function")
    return Partial(partial(_learned_cost, result.networks), *_cycled(result, number))


def random_reward(networks: Networks, stats: Any, keys: Array) -> Part:
    """Pay an f_θ that has learned nothing, drawn anew for each seed."""
    params = jax.vmap(networks.init)(keys)
    every = jax.tree.map(lambda leaf: jnp.broadcast_to(leaf, (len(keys), *leaf.shape)), stats)
    return Partial(partial(_learned_reward, networks), params, every)


def _cycled(result: Result, number: int) -> tuple[Any, Any]:
    index = np.arange(number) % len(result.summary["seeds"])
    return jax.tree.map(lambda leaf: leaf[index], (result.states.params, result.states.obs_stats))


def _both(reward: Part, cost: Part, trajectory: Trajectory) -> tuple[Float[Array, " T"], Float[Array, " T"]]:
    return reward(trajectory), cost(trajectory)


def _world_reward(trajectory: Trajectory) -> Float[Array, " T"]:
    return trajectory.reward


def _world_cost(trajectory: Trajectory) -> Float[Array, " T"]:
    return trajectory.cost


def _no_cost(trajectory: Trajectory) -> Float[Array, " T"]:
    return jnp.zeros_like(trajectory.mask)


def _of_step(function: OfStep, trajectory: Trajectory) -> Float[Array, " T"]:
    return jax.vmap(function)(trajectory.obs, trajectory.action).astype(jnp.float32)


def _learned_reward(networks: Networks, params: Any, stats: Any, trajectory: Trajectory) -> Float[Array, " T"]:
    return networks.bind(params, stats).f(trajectory)


def _learned_cost(networks: Networks, params: Any, stats: Any, trajectory: Trajectory) -> Float[Array, " T"]:
    scores = networks.bind(params, stats).feasibility_scores(trajectory)
    log_delta = log_step_feasibility(networks.method, networks.config.coefficients, scores)
    return (log_delta < jnp.log(FORBIDDEN_BELOW)).astype(jnp.float32)
