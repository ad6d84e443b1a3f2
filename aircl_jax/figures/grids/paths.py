"""Draw trajectories on a grid: paths of the expert, the policy and the sampler, and δ̄ by the order of two zones."""

from collections.abc import Iterator, Sequence

import numpy as np
from jaxtyping import Bool, Int
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from aircl_jax.analysis import episodes
from aircl_jax.analysis.episodes import Evidence
from aircl_jax.figures.grids.cells import draw_layout
from aircl_jax.figures.style import BLUE, GREY, ORANGE, Drawing, over_seeds
from aircl_jax.runs.result import Result
from aircl_jax.types import Trajectory
from envs import Grid
from envs.grid_tables import marked, successors

NUM_PATHS = 60


def draw(result: Result, layout: Grid, evidence: Evidence) -> Iterator[Drawing]:
    """Draw the paths, and δ̄ by the order of two zones where the grid has two."""
    if len(layout.zones) == 2 and result.spec.method.learns_feasibility:
        yield order_of_zones(result, layout, evidence)
    yield paths(result, layout, evidence)


def paths(result: Result, layout: Grid, evidence: Evidence) -> Drawing:
    """Draw the first seed's trajectories of D_E, π and q; violating ones come last and in another colour."""
    first = [first_seed(result.expert), first_seed(evidence.policy)]
    titles = ["demonstrations $D_E$", r"policy $\pi$"]
    if result.spec.method.draws:
        first.append(first_seed(evidence.sampled))
        titles.append("samples of $q$")
    figure = Figure(figsize=(2.3 * len(first) + 0.2, 2.6), layout="compressed")
    shares = []
    for axis, title, trajectories in zip(figure.subplots(1, len(first)), titles, first, strict=True):
        violating = episodes.infeasible(trajectories)
        shares.append(f"{title.split()[-1].strip('$')} {100 * violating.mean():.1f} %")
        draw_paths(axis, layout, cells_of(trajectories, layout)[:NUM_PATHS], violating[:NUM_PATHS])
        draw_layout(axis, layout, filled=True)
        axis.set_title(title)
    for colour, label in ((BLUE, "feasible"), (ORANGE, "infeasible")):
        figure.axes[0].plot([], [], color=colour, label=label)
    figure.legend(loc="outside lower center", ncols=2, frameon=False)
    caption = (
        f"{min(NUM_PATHS, *(len(trajectories.mask) for trajectories in first))} trajectories each, "
        f"{result.summary['method']} on {result.summary['env']}, seed {result.summary['seeds'][0]}, shifted within the "
        "cells to show each one. "
        f"Infeasible: {', '.join(shares)}.".replace(r"\pi", "π")
    )
    return Drawing("paths", figure, caption)


def order_of_zones(result: Result, layout: Grid, evidence: Evidence) -> Drawing:
    """Draw the mean δ̄ of the reference set's trajectories by which of two zones they visit, and in which order."""
    before, after = layout.zones
    classes = visits(_visited_cells(result.reference), layout)
    names = [
        ("neither", "neither"),
        ("first", f"{before} only"),
        ("second", f"{after} only"),
        ("back", f"{after}, then {before}"),
        ("order", f"{before}, then {after}"),
    ]
    names = [(key, label) for key, label in names if classes[key].any()]
    figure = Figure(figsize=(3.4, 2.3), layout="constrained")
    axis = figure.subplots()
    for place, (key, _) in enumerate(names):
        chosen, colour = classes[key], ORANGE if key == "order" else BLUE
        means = evidence.delta_reference[:, chosen].mean(axis=1)
        offset = np.linspace(-0.18, 0.18, len(means)) if len(means) > 1 else np.zeros(1)
        axis.bar(place, means.mean(), width=0.62, color=colour, alpha=0.35)
        axis.plot(place + offset, means, "o", color=colour, ms=2.5)
        axis.text(place, 1.04, f"{means.mean():.2f}", ha="center", color=colour)
    axis.set_xticks(range(len(names)), [f"{label}\n({classes[key].sum()})" for key, label in names])
    axis.set(ylim=(0, 1.12), ylabel=r"mean feasibility $\bar\delta(\tau)$", xlabel="zones visited (trajectories)")
    caption = (
        f"Mean δ̄ of the reference set's trajectories by the zones that they visit; only {before}, then {after} is forbidden "
        f"(orange). {over_seeds(result)}: bars are means, dots seeds."
    )
    return Drawing("order_of_zones", figure, caption)


def visits(cells: Int[np.ndarray, "N T"], layout: Grid) -> dict[str, Bool[np.ndarray, " N"]]:
    """Mark the trajectories that visit neither zone, the first or the second alone, and both in either order."""
    first, second = (np.isin(cells, [_index(cell, layout) for cell in zone]) for zone in layout.zones.values())
    in_order = _any(second & (np.cumsum(first, axis=1) > 0))
    seen_first, seen_second = _any(first), _any(second)
    return {
        "neither": ~seen_first & ~seen_second,
        "first": seen_first & ~seen_second,
        "second": ~seen_first & seen_second,
        "back": seen_first & seen_second & ~in_order,
        "order": in_order,
    }


def _any(steps: Bool[np.ndarray, "N T"]) -> Bool[np.ndarray, " N"]:
    return np.asarray(steps.any(axis=1))


def draw_paths(axis: Axes, layout: Grid, cells: Int[np.ndarray, "N T"], violating: Bool[np.ndarray, " N"]) -> None:
    shift = np.random.default_rng(0).uniform(-0.3, 0.3, (len(cells), 2))
    for index in np.argsort(violating, kind="stable"):
        row, column = np.divmod(cells[index], layout.size)
        colour, width = (ORANGE, 0.9) if violating[index] else (BLUE, 0.6)
        axis.plot(column + shift[index, 1], row + shift[index, 0], color=colour, lw=width, alpha=0.6, zorder=2)
    axis.hlines(np.arange(layout.size) - 0.5, -0.5, layout.size - 0.5, color=GREY, lw=0.3, zorder=1)
    axis.vlines(np.arange(layout.size) - 0.5, -0.5, layout.size - 0.5, color=GREY, lw=0.3, zorder=1)


def cells_of(trajectories: Trajectory, layout: Grid) -> Int[np.ndarray, "N T1"]:
    """List the cells observed, and the cell that the last action aims at, since no observation follows the last step."""
    seen = _visited_cells(trajectories)
    target = successors(layout.size, marked(layout.absorbing, layout.size), marked(layout.walls, layout.size))
    last = target[seen[:, -1], np.asarray(trajectories.action)[:, -1]]
    return np.concatenate([seen, last[:, None]], axis=1)


def _visited_cells(trajectories: Trajectory) -> Int[np.ndarray, "N T"]:
    return np.asarray(trajectories.obs).argmax(axis=-1)


def first_seed(trajectories: Trajectory) -> Trajectory:
    return Trajectory(*(np.asarray(leaf)[0] for leaf in trajectories))  # pyright: ignore[reportArgumentType]


def _index(cell: Sequence[int], layout: Grid) -> int:
    return cell[0] * layout.size + cell[1]
