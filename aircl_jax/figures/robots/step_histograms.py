"""Draw histograms for worlds without a table: actions and observations, the demonstrations beside the policy."""

from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Float
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from aircl_jax.analysis.episodes import Evidence
from aircl_jax.figures.style import BLACK, BLUE, GREY, ORANGE, Drawing, over_seeds
from aircl_jax.runs.result import Result
from aircl_jax.types import Trajectory
from envs import Box, Limit

BINS = 40
WIDEST = 5.0  # largest half width of a histogram around the mean of D_E, in standard deviations of D_E
NARROWEST = 1e-3  # width of the histogram of a constant coordinate
COLUMNS = 4


def draw(result: Result, evidence: Evidence) -> Iterator[Drawing]:
    """Draw the histograms of continuous actions and of observations."""
    env = result.spec.env
    space = env.action_space
    expert, policy = _steps(result.expert), _steps(evidence.policy)
    if isinstance(space, Box):
        clipped = [np.clip(actions, space.low, space.high) for actions in (expert.action, policy.action)]
        lines = [lines_of_motors(env.limit)] * space.size
        yield _drawing(result, "actions", clipped, env.motor_names, lines, (space.low, space.high))
    lines = [lines_of_coordinate(env.limit, index) for index in range(env.obs_size)]
    yield _drawing(result, "observations", [expert.obs, policy.obs], env.coordinate_names, lines, None)


def lines_of_coordinate(limit: Limit | None, index: int) -> tuple[float, ...]:
    """Return the constraint's limits on the axis of a coordinate; empty where it bounds something else."""
    return limit.lines if limit is not None and limit.bounds == index else ()


def lines_of_motors(limit: Limit | None) -> tuple[float, ...]:
    """Return the constraint's limits on the axis of every motor; empty where it bounds something else."""
    return limit.lines if limit is not None and limit.bounds == "actions" else ()


class _Steps(NamedTuple):
    obs: Float[np.ndarray, "N O"]
    action: np.ndarray


def _steps(trajectories: Trajectory) -> _Steps:
    """Flatten the unmasked steps of all seeds and trajectories into one axis."""
    unmasked = np.asarray(trajectories.mask) > 0
    return _Steps(np.asarray(trajectories.obs)[unmasked], np.asarray(trajectories.action)[unmasked])


def _drawing(
    result: Result,
    what: str,
    pair: Sequence[Float[np.ndarray, "_ K"]],
    names: Sequence[str],
    lines: Sequence[tuple[float, ...]],
    span: tuple[float, float] | None,
) -> Drawing:
    columns = min(COLUMNS, len(names))
    rows = -(-len(names) // columns)
    figure = Figure(figsize=(max(3.4, 1.8 * columns), 0.5 + 1.35 * rows), layout="constrained")
    axes = figure.subplots(rows, columns, squeeze=False).ravel()
    for axis in axes[len(names) :]:
        axis.remove()
    for index, name in enumerate(names):
        _histogram(axes[index], pair[0][:, index], pair[1][:, index], span)
        for limit in lines[index]:
            axes[index].axvline(limit, color=ORANGE, ls=(0, (4, 2)), lw=1.0)
        axes[index].set_xlabel(name)
    handles = [axes[0].plot([], [], color=colour, lw=1.4, label=label)[0] for colour, label in _LEGEND]
    if any(lines):
        handles += axes[0].plot([], [], color=ORANGE, ls=(0, (4, 2)), lw=1.0, label="limit of the constraint")
    figure.legend(handles=handles, loc="outside upper center", ncols=3, frameon=False, handlelength=1.5, columnspacing=1.2)
    figure.supylabel("density (per unit)", fontsize=7)
    note = "; beyond the dashed lines the constraint is violated" if any(lines) else ""
    caption = (
        f"Histograms of the {what} of all timesteps, D_E beside fresh episodes of the policy: {over_seeds(result)} "
        f"pooled{note}."
    )
    return Drawing(what, figure, caption)


_LEGEND = ((BLACK, "demonstrations $D_E$"), (BLUE, r"policy $\pi$"))


def _histogram(
    axis: Axes, expert: Float[np.ndarray, " N"], policy: Float[np.ndarray, " M"], span: tuple[float, float] | None
) -> None:
    if span is None:
        middle, spread = expert.mean(), max(expert.std(), 1e-3)
        both = np.concatenate([expert, policy])
        span = (max(both.min(), middle - WIDEST * spread), min(both.max(), middle + WIDEST * spread) + NARROWEST)
    edges = np.linspace(*span, BINS + 1).tolist()
    axis.hist(np.clip(expert, *span), edges, density=True, color=GREY, alpha=0.35)
    axis.hist(np.clip(expert, *span), edges, density=True, color=BLACK, histtype="step", lw=0.9)
    axis.hist(np.clip(policy, *span), edges, density=True, color=BLUE, histtype="step", lw=1.1)
    axis.set_yticks([])
    axis.spines["left"].set_visible(False)
