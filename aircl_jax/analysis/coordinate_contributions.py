"""Compute what each coordinate adds to an additive δ₁: which coordinates the constraint depends on, and where its limit is."""

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from aircl_jax.model.modules import AdditiveNet
from aircl_jax.model.networks import Networks
from aircl_jax.runs.result import Result
from aircl_jax.types import TrainState, Trajectory
from envs import Box

POINTS = 121  # points of each curve
SHARE = 0.001  # share of the steps left out at either end of the span that is shown


class Contributions(NamedTuple):
    """Curves of every seed over the span of demonstrations and policy, and the demonstrated steps."""

    names: tuple[str, ...]  # of the I coordinates and actions in the input of δ₁
    grid: Float[np.ndarray, "K I"]
    curves: Float[np.ndarray, "S K I"]  # g_i(x_i) − mean_E g_i
    seen: Float[np.ndarray, "N I"]  # the demonstrated steps


def is_additive(result: Result) -> bool:
    """Say whether δ₁ is a sum over coordinates, so that each coordinate has a curve of its own."""
    return isinstance(result.networks.step_net, AdditiveNet) and result.spec.method.tests_steps


def contributions(result: Result, policy: Trajectory) -> Contributions:
    """Compute g_i(x_i) − mean_E g_i for each input of δ₁, over the span of D_E and of π's episodes [S, N, T, …]."""
    nets, env = result.networks, result.spec.env
    space = env.action_space
    unmasked = np.asarray(result.expert.mask[0]) > 0
    obs, action = np.asarray(result.expert.obs[0])[unmasked], np.asarray(result.expert.action[0])[unmasked]
    seen, names, low, high = obs[:, :0], (), np.empty(0), np.empty(0)
    if nets.feasibility_sees_state:
        seen, names = obs, env.coordinate_names
        low, high = np.quantile(
            np.concatenate([obs, np.asarray(policy.obs).reshape(-1, obs.shape[1])]), [SHARE, 1 - SHARE], axis=0
        )
    if nets.feasibility_sees_action and isinstance(space, Box):
        seen = np.concatenate([seen, np.clip(action, space.low, space.high)], axis=1)
        names += env.motor_names
        low, high = (np.append(end, [bound] * space.size) for end, bound in ((low, space.low), (high, space.high)))
    grid = np.linspace(low, high, POINTS)  # [K, I]
    curves = np.array(jax.vmap(lambda state: curves_of(nets, state, jnp.asarray(grid)))(result.states))
    for seed, index in np.ndindex(len(curves), len(names)):
        curves[seed, :, index] -= np.interp(seen[:, index], grid[:, index], curves[seed, :, index]).mean()
    return Contributions(names, grid, curves, seen)


def curves_of(nets: Networks, state: TrainState, points: Float[Array, "K I"]) -> Float[Array, "K I"]:
    """Compute the logit with coordinate i at each of its points and the others at D_E's mean, less the logit at the mean."""
    bound, number = nets.bind(state.params, state.obs_stats), nets.env.obs_size * nets.feasibility_sees_state
    obs, action = points[:, :number], points[:, number:]
    if nets.feasibility_sees_state:
        obs = jax.vmap(bound.normalise)(obs)
    if isinstance(nets.env.action_space, Box):
        action = nets.env.action_space.in_half_widths(action)
    features = jnp.concatenate([obs, action], axis=1)

    def logit(feature: Float[Array, " I"]) -> Float[Array, ""]:
        params: Any = state.params.feasibility["step"]
        return nets.step_net.apply(params, feature)[0]

    alone = features[:, :, None] * jnp.eye(features.shape[1])  # [K, I, I]
    return jax.vmap(jax.vmap(logit))(alone) - logit(jnp.zeros(features.shape[1]))
