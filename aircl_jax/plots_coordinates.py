"""What an additive δ₁ has learned, a curve for each coordinate: of which of them the constraint speaks, and from where on."""

from collections.abc import Sequence
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float
from matplotlib.figure import Figure

from aircl_jax.api import Result
from aircl_jax.modules import AdditiveNet
from aircl_jax.networks import Networks
from aircl_jax.plots_steps import Limit, constraint_limit
from aircl_jax.plots_style import BLUE, GREEN, GREY, ORANGE, Drawing, over_seeds
from aircl_jax.types import TrainState, Trajectory
from envs import Box

POINTS = 121  # of each curve
SHARE = 0.001  # of the steps left out at either end of the span that is shown
COLUMNS = 5
LEAST = -6.0  # lower end of every axis: e^-6 is never


def is_additive(result: Result) -> bool:
    return isinstance(result.networks.step_net, AdditiveNet) and "step" in result.plan.method.feasibility


def by_coordinate(result: Result, policy: Trajectory) -> Drawing:
    """g_i(x_i) − mean_E g_i of every coordinate and action that δ₁ sees, over the span of D_E and of π's episodes [S, N, T, …].

    Use within `matplotlib.rc_context(STYLE)`.
    """
    limit = constraint_limit(result.plan.env.name, result.plan.env_settings)
    nets, env = result.networks, result.plan.env
    space = env.action_space
    kept = np.asarray(result.expert.mask[0]) > 0
    obs, action = np.asarray(result.expert.obs[0])[kept], np.asarray(result.expert.action[0])[kept]
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
    grid = np.linspace(low, high, POINTS)  # [POINTS, I]
    curves = np.array(jax.vmap(lambda state: curves_of(result.networks, state, jnp.asarray(grid)))(result.states))
    for seed, index in np.ndindex(len(curves), len(names)):
        curves[seed, :, index] -= np.interp(seen[:, index], grid[:, index], curves[seed, :, index]).mean()
    return _drawing(result, names, grid, curves, seen, limit)


def curves_of(nets: Networks, state: TrainState, points: Float[Array, "K I"]) -> Float[Array, "K I"]:
    """The logit with coordinate i at each of its points and the others at D_E's mean, less that of the mean itself."""
    stats, number = state.obs_stats, nets.env.obs_size
    features = points
    if nets.feasibility_sees_state:
        normalised = jax.vmap(lambda obs: nets.normalise(stats, obs))(points[:, :number])
        features = jnp.concatenate([normalised, points[:, number:]], axis=1)

    def logit(feature: Float[Array, " I"]) -> Float[Array, ""]:
        params: Any = state.params.feasibility["step"]
        return nets.step_net.apply(params, feature)[0]

    alone = features[:, :, None] * jnp.eye(features.shape[1])  # [K, I, I]
    return jax.vmap(jax.vmap(logit))(alone) - logit(jnp.zeros(features.shape[1]))


def _drawing(
    result: Result,
    names: Sequence[str],
    grid: Float[np.ndarray, "K I"],
    curves: Float[np.ndarray, "S K I"],
    seen: Float[np.ndarray, "N I"],
    limit: Limit | None,
) -> Drawing:
    columns = min(COLUMNS, len(names))
    rows = -(-len(names) // columns)
    figure = Figure(figsize=(7.2, 0.5 + 1.3 * rows), layout="constrained")
    axes = figure.subplots(rows, columns, squeeze=False, sharey=True).ravel()
    for axis in axes[len(names) :]:
        axis.remove()
    top = max(1.5, float(curves.max()) + 0.3)
    for index, name in enumerate(names):
        axis, across = axes[index], grid[:, index]
        density, edges = np.histogram(seen[:, index], bins=40, range=(across[0], across[-1] + 1e-9))
        heights = LEAST + 0.4 * (top - LEAST) * density / density.max()
        axis.fill_between(edges[:-1], LEAST, heights, step="post", color=GREY, alpha=0.3, lw=0)
        axis.plot(across, np.maximum(curves[:, :, index], LEAST).T, color=GREEN, lw=0.5, alpha=0.5)
        axis.plot(across, np.maximum(curves[:, :, index].mean(axis=0), LEAST), color=BLUE, lw=1.3)
        for value in _limits(limit, index, name in result.plan.env.motor_names):
            axis.axvline(value, color=ORANGE, ls=(0, (4, 2)), lw=1.0)
        axis.set(xlabel=name, ylim=(LEAST, top), xlim=(across[0], across[-1]))
    figure.supylabel("log ratio, expert : policy", fontsize=7)
    said = " The dashed lines are the true limit, which no part of the training has read." if limit else ""
    caption = (
        "What each coordinate adds to the logarithm of the density ratio that δ₁ tests: 0 is what it adds on average in D_E, "
        f"far below 0 is where demonstrations do not go and the policy does. {over_seeds(result)}: the mean (blue), every seed "
        f"(green), the histogram of D_E (grey).{said}"
    )
    return Drawing("constraint_by_coordinate", figure, caption)


def _limits(limit: Limit | None, index: int, is_motor: bool) -> tuple[float, ...]:
    if limit is None:
        return ()
    drawn = is_motor if limit.across == "actions" else index == 0
    return limit.values if drawn else ()
