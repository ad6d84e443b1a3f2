"""PPO-Lagrangian that does not see the unit of its reward: the learner of oracles and swaps (docs/learner.md).

Against `lagrangian`, by which the shipped experts were trained: the reward is divided by its own spread, each network is
clipped by itself, a part of the rollouts goes on from where earlier ones ended, and both critics bootstrap at the end.
"""

from collections.abc import Callable
from dataclasses import replace
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jax.tree_util import Partial
from jaxtyping import Array, Bool, Float, Int, PRNGKeyArray

from aircl_jax.algorithm.learners.lagrangian import Moments, next_multiplier, observe, stats_of
from aircl_jax.algorithm.learners.scale_free_update import Trained, make_batch, make_optimiser, update
from aircl_jax.algorithm.masks import masked_mean
from aircl_jax.algorithm.rollout import rollout_from
from aircl_jax.methods import Method
from aircl_jax.model.networks import BoundNetworks, Networks, make_networks
from aircl_jax.settings.learner_config import LearnerConfig
from aircl_jax.settings.train_config import TrainConfig
from aircl_jax.types import Metrics, Params, Thresholds, Trajectory
from envs import Env
from envs.robots.practice_worlds import ending, restarting, weakened

_NETWORKS = Method(reward="true", discriminator_of="none", feasibility="none", terms=())

Objective = Callable[[Trajectory], tuple[Float[Array, " T"], Float[Array, " T"]]]  # what each step is paid, and its cost
Motors = tuple[Float[Array, "*S A"], Float[Array, "*S A"]]  # the least and the greatest that motors do


class Task(NamedTuple):
    """What one seed's policy is paid by and bound by."""

    objective: Objective  # a `jax.tree_util.Partial`: what it holds may differ from seed to seed
    constrained: Float[Array, ""]  # 1, or 0: the cost does not count after `release`
    motors: Motors | None = None  # where motors stop in practice while the cost counts


class Spread(NamedTuple):
    """ρ²: the reward's variance within an iteration, averaged over all iterations so far."""

    number: Float[Array, ""]
    mean_square: Float[Array, ""]


class LearnerState(NamedTuple):
    """All that training carries from one iteration to the next, of one seed."""

    trained: Trained
    opt: Any
    multiplier: Float[Array, ""]  # λ
    moments: Moments
    spread: Spread
    ends: tuple[Any, Float[Array, "N O"]]  # where the last rollouts ended
    key: PRNGKeyArray
    step: Int[Array, ""]


class Learner(NamedTuple):
    """`init(key) -> state`, `step(state, task) -> (state, metrics)`: pure, for one seed."""

    init: Callable[[PRNGKeyArray], LearnerState]
    step: Callable[[LearnerState, Task], tuple[LearnerState, Metrics]]
    nets: Networks


def true_objective(trajectory: Trajectory) -> tuple[Float[Array, " T"], Float[Array, " T"]]:
    """Pay the world's own reward and cost."""
    return trajectory.reward, trajectory.cost


TRUE = Partial(true_objective)


def true_motors(env: Env, *lead: int) -> Motors | None:
    """Where motors stop by the world's own limit of its actions; None where it has none. `lead` are the axes before."""
    if env.limit is None or env.limit.bounds != "actions":
        return None
    end = jnp.full((*lead, env.action_space.feature_size), float(env.limit.value))
    return -end, end


def make_learner(env: Env, config: LearnerConfig) -> Learner:
    """Make the learner's two functions: max_π E Σ (r − β log π) subject to E Σ c ≤ d, with r and c by the task.

    Raises ValueError where the world's task ends at the horizon: both critics bootstrap there, and see no time.
    """
    if env.finite_horizon:
        raise ValueError(f"env={env.name} ends at its horizon; choose a world that goes on, or a table and train.learner=exact")
    nets = make_networks(env, _NETWORKS, TrainConfig(hidden=config.hidden, ppo=config.ppo))
    optimiser = make_optimiser(config, env.horizon)

    def practised(motors: Motors | None, held: Bool[Array, ""]) -> Env:
        world = ending(env) if config.restart else env
        if motors is not None:
            world = weakened(world, jnp.where(held, motors[0], -jnp.inf), jnp.where(held, motors[1], jnp.inf))
        return restarting(world, fall_cost=0.0) if config.restart else world

    def init(key: PRNGKeyArray) -> LearnerState:
        key, key_reward, key_cost, key_world = jax.random.split(key, 4)
        first, second = nets.init(key_reward), nets.init(key_cost)
        trained = Trained(first.policy, first.value, second.value)
        zero, zeros = jnp.zeros(()), jnp.zeros(env.obs_size)
        return LearnerState(
            trained,
            optimiser.init(trained),
            jnp.asarray(config.multiplier_init, jnp.float32),
            Moments(zero, zeros, zeros),
            Spread(zero, zero),
            jax.vmap(practised(None, jnp.ones((), bool)).reset)(jax.random.split(key_world, config.num_trajectories)),
            key,
            zero.astype(jnp.int32),
        )

    def step(state: LearnerState, task: Task) -> tuple[LearnerState, Metrics]:
        key, key_rollout, key_update = jax.random.split(state.key, 3)
        acting = bound(nets, state)
        held = (task.constrained > 0) | (state.step < config.release * config.iterations)
        trajectories, ends = practise(acting, state.ends, state.step > 0, key_rollout, practised(task.motors, held), config)
        reward, cost = jax.vmap(task.objective)(trajectories)
        multiplier = jnp.where(held, state.multiplier, 0.0)
        paid, spread = normalised(reward - config.temperature * trajectories.log_prob, trajectories.mask, state.spread, config)
        batch = make_batch(acting, state.trained.cost_value, trajectories, ends[1], paid, cost, multiplier, config)
        highest = jnp.where(task.constrained > 0, config.ppo.log_std_max, config.released_log_std_max)
        bounded_std = replace(config, ppo=replace(config.ppo, log_std_max=highest))
        trained, opt, metrics = update(acting, state.trained, state.opt, batch, key_update, optimiser, bounded_std)
        violations = (cost * trajectories.mask).sum(axis=1).mean()
        state = LearnerState(
            trained,
            opt,
            next_multiplier(state.multiplier, violations, config),
            observe(state.moments, trajectories),
            spread,
            ends,
            key,
            state.step + 1,
        )
        return state, {
            **metrics,
            "return": (reward * trajectories.mask).sum(axis=1).mean(),
            "cost": violations,
            "multiplier": multiplier,
            "strays": falls(trajectories.mask).sum(axis=1).mean(),
            "std": jnp.exp(trained.policy["params"]["log_std"]).mean(),
        }

    return Learner(init, step, nets)


def bound(nets: Networks, state: LearnerState) -> BoundNetworks:
    """Bind the policy and V_r with the observations' statistics so far."""
    thresholds = Thresholds(jnp.zeros(()), jnp.zeros(()))
    params = Params(state.trained.policy, state.trained.value, reward=None, feasibility=None, thresholds=thresholds)
    return nets.bind(params, stats_of(state.moments))


def practise(
    acting: BoundNetworks,
    ends: tuple[Any, Float[Array, "N O"]],
    started: Bool[Array, ""],
    key: PRNGKeyArray,
    world: Env,
    config: LearnerConfig,
) -> tuple[Trajectory, tuple[Any, Float[Array, "N O"]]]:
    """Roll out N times, [N, T, …], from resets or, with probability `continued`, from where the last rollouts ended."""

    def one(key: PRNGKeyArray, end: tuple[Any, Array]) -> tuple[Trajectory, tuple[Any, Array]]:
        key_reset, key_choice, key_steps = jax.random.split(key, 3)
        goes_on = (jax.random.uniform(key_choice) < config.continued) & started
        start = jax.tree.map(lambda old, new: jnp.where(goes_on, old, new), end, world.reset(key_reset))
        return rollout_from(acting, key_steps, start, world)

    return jax.vmap(one)(jax.random.split(key, config.num_trajectories), ends)


def falls(mask: Float[Array, "N T"]) -> Float[Array, "N T"]:
    """1 at each step after which the body has to get up: the step that follows does not count."""
    following = jnp.concatenate([mask[:, 1:], jnp.ones_like(mask[:, :1])], axis=1)
    return mask * (1.0 - following)


def normalised(
    reward: Float[Array, "N T"], mask: Float[Array, "N T"], spread: Spread, config: LearnerConfig
) -> tuple[Float[Array, "N T"], Spread]:
    """r̃ = spread · ((r − mean r) / ρ + bonus), ρ² the running mean of mean (r − mean r)²: k r and r give the same r̃."""
    centred = reward - masked_mean(reward, mask)
    number = spread.number + 1.0
    mean_square = spread.mean_square + (masked_mean(centred**2, mask) - spread.mean_square) / number
    scaled = config.reward_spread * (centred / jnp.maximum(jnp.sqrt(mean_square), 1e-12) + config.alive_bonus)
    return scaled, Spread(number, mean_square)
