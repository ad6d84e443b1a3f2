"""The worlds that π and its twin practise in, and their rollouts, both at once."""

from operator import itemgetter
from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, PRNGKeyArray

from aircl_jax.algorithm.learners import practice as practising
from aircl_jax.algorithm.learners.practice import Learning, Practice
from aircl_jax.model.networks import BoundNetworks, Networks
from aircl_jax.settings.train_config import TrainConfig
from aircl_jax.types import TrainState, Trajectory
from envs import Box, Env
from envs.robots.practice_worlds import bounded, clipped_world, restarting


class Rolled(NamedTuple):
    """What π and its twin did, with where both rollouts ended; the twin's counts once the constraint has begun."""

    policy: Trajectory
    practice: Practice
    tempted: Trajectory
    twin: Practice


def rolled_out(nets: Networks, learning: Learning, state: TrainState, key: PRNGKeyArray, key_twin: PRNGKeyArray) -> Rolled:
    """Roll out π, whose motors stop at the limits, and its twin, whose motors do not."""
    contrast, before = state.adversary_opt, nets.bind(state.params, state.obs_stats)
    free = practice_world(nets.env, contrast.reach, nets.config)

    def of(practice: Practice, lower: Array, upper: Array, key: PRNGKeyArray) -> tuple[Trajectory, Practice]:
        world = clipped_world(free, lower, upper)
        return practising.roll_out(learning, before, practice, world, state.step > 0, key)

    none = jnp.full(nets.env.action_space.feature_size, jnp.inf)
    stops = (-none, none) if nets.feasibility_sees_state else motor_limits(before)
    pair = (state.ppo_opt, *stops, key), (contrast.twin, -none, none, key_twin)
    both = jax.vmap(of)(*jax.tree.map(lambda ours, twins: jnp.stack([ours, twins]), *pair))
    return Rolled(*jax.tree.map(itemgetter(0), both), *jax.tree.map(itemgetter(1), both))


def practice_world(env: Env, reach: tuple[Array, Array], config: TrainConfig) -> Env:
    """Start anew where a coordinate leaves the demonstrations' range by `margin` of its widths."""
    low, high = reach
    width = config.moments.margin * (high - low)
    return restarting(bounded(env, low - width, high + width), 0.0)


def reached(expert: Trajectory) -> tuple[Float[Array, " O"], Float[Array, " O"]]:
    """Least and greatest of each coordinate in the demonstrations."""
    seen = expert.mask[..., None] > 0
    return jnp.where(seen, expert.obs, jnp.inf).min((0, 1)), jnp.where(seen, expert.obs, -jnp.inf).max((0, 1))


def motor_limits(nets: BoundNetworks) -> tuple[Float[Array, " A"], Float[Array, " A"]]:
    """The lower and the upper limit at which the policy's motors stop, in the unit of each action."""
    own, space = nets.params.policy["params"], box_of(nets.env)
    return space.from_half_widths(own["lower"]), space.from_half_widths(own["upper"])


def box_of(env: Env, instead: str = "aircl_corrected") -> Box:
    """The box of a world's actions. Raises ValueError, which says what to choose `instead`, where the row cannot run."""
    space = env.action_space
    if not isinstance(space, Box) or not space.is_bounded or env.finite_horizon:
        raise ValueError(f"env={env.name} is no world of a bounded box of actions that goes on; choose {instead}")
    return space
