"""Train a policy inside another loop by the learner of docs/learner.md: roll out, then learn from what it is then paid."""

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import optax
from jaxtyping import Array, Bool, Float, PRNGKeyArray

from aircl_jax.algorithm.learners.lagrangian import next_multiplier
from aircl_jax.algorithm.learners.scale_free import Spread, falls, normalised, practise
from aircl_jax.algorithm.learners.scale_free_update import Trained, make_batch, update
from aircl_jax.model.networks import BoundNetworks
from aircl_jax.settings.learner_config import LearnerConfig
from aircl_jax.types import Metrics, Params, Trajectory
from envs import Env


class Practice(NamedTuple):
    """A policy with both critics, and what its training carries from one iteration to the next."""

    trained: Trained
    opt: Any
    multiplier: Float[Array, ""]  # λ
    spread: Spread
    ends: tuple[Any, Float[Array, "N O"]]  # where the last rollouts ended


class Learning(NamedTuple):
    """What does not change in training: the learner's settings and its optimiser."""

    config: LearnerConfig
    optimiser: optax.GradientTransformation


def begin(learning: Learning, params: Params, cost_value: Any, world: Env, key: PRNGKeyArray) -> Practice:
    """Begin with these policy and critics."""
    trained, zero = Trained(params.policy, params.value, cost_value), jnp.zeros(())
    return Practice(
        trained,
        learning.optimiser.init(trained),
        jnp.asarray(learning.config.multiplier_init, jnp.float32),
        Spread(zero, zero),
        jax.vmap(world.reset)(jax.random.split(key, learning.config.num_trajectories)),
    )


def roll_out(
    learning: Learning, nets: BoundNetworks, practice: Practice, world: Env, started: Bool[Array, ""], key: PRNGKeyArray
) -> tuple[Trajectory, Practice]:
    """Roll out the policy in its world, [N, T, …]; the practice has the new ends."""
    trajectories, ends = practise(acting(nets, practice), practice.ends, started, key, world, learning.config)
    return trajectories, practice._replace(ends=ends)


def learn(
    learning: Learning,
    nets: BoundNetworks,
    practice: Practice,
    trajectories: Trajectory,
    reward: Float[Array, "N T"],
    cost: Float[Array, "N T"],
    bound: Float[Array, ""],
    key: PRNGKeyArray,
) -> tuple[Practice, Metrics]:
    """Update by reward and cost: max_π E Σ r̃ subject to E Σ c ≤ d where `bound` is 1, and without the cost where it is 0.

    A step after which the world starts anew is paid `worth_of_strays` besides.
    """
    config = learning.config
    paid, spread = normalised(reward, trajectories.mask, practice.spread, config)
    paid = paid + worth_of_strays(trajectories, config)
    weight = bound * practice.multiplier
    ends, cost_value = practice.ends[1], practice.trained.cost_value
    batch = make_batch(acting(nets, practice), cost_value, trajectories, ends, paid, cost, weight, config)
    trained, opt, metrics = update(
        acting(nets, practice), practice.trained, practice.opt, batch, key, learning.optimiser, config
    )
    spent = (cost * trajectories.mask).sum(axis=1).mean()
    moved = risen_or_fallen(practice.multiplier, spent, trajectories.mask, config)
    multiplier = jnp.where(bound > 0, moved, practice.multiplier)
    return Practice(trained, opt, multiplier, spread, practice.ends), metrics


def risen_or_fallen(
    multiplier: Float[Array, ""], spent: Float[Array, ""], mask: Float[Array, "N T"], config: LearnerConfig
) -> Float[Array, ""]:
    """Ascend log λ by what a rollout spends, or let λ fall while rollouts start anew more than `most_strays` times.

    A body that cannot stand for what it is charged would learn nothing else.
    """
    fallen = multiplier * jnp.exp(-config.multiplier_rate)
    often = falls(mask).sum(axis=1).mean() > config.most_strays
    return jnp.where(often, fallen, next_multiplier(multiplier, spent, config))


def worth_of_strays(trajectories: Trajectory, config: LearnerConfig) -> Float[Array, "N T"]:
    """Charge each step after which the world starts anew `stray_cost`, in standard deviations of the reward.

    With `strays_bootstrap` γ V of where it led counts too, so that straying is no way out of a state that is worth little.
    """
    strayed, cost = falls(trajectories.mask), config.reward_spread * config.stray_cost
    if not config.strays_bootstrap:
        return -cost * strayed
    led_to = jnp.concatenate([trajectories.value[:, 1:], jnp.zeros_like(trajectories.value[:, :1])], axis=1)
    return (config.ppo.discount * led_to - cost) * strayed


def acting(nets: BoundNetworks, practice: Practice) -> BoundNetworks:
    """The networks with this policy and its V_r."""
    return nets.with_params(policy=practice.trained.policy, value=practice.trained.value)
