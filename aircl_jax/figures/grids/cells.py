"""Draw maps of a grid: true and learned reward, constraint and occupancy, cell by cell."""

from collections.abc import Iterator, Sequence
from typing import Any, NamedTuple

import matplotlib as mpl
import numpy as np
from jaxtyping import Bool, Float
from matplotlib.axes import Axes
from matplotlib.collections import PolyCollection
from matplotlib.colors import Normalize, TwoSlopeNorm
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle

from aircl_jax.analysis import episodes
from aircl_jax.analysis.episodes import Evidence, GridEvidence
from aircl_jax.figures.style import BLACK, Drawing, final, over_seeds
from aircl_jax.runs.result import Result
from aircl_jax.types import Trajectory
from envs import Grid, Tabular

UNSEEN = 1e-3  # occupancy of expert and of π below which f and δ of a cell are not compared
DIVERGING = "PuOr_r"
WALL = "#4d4d4d"
EMPTY = {"+0.0", "−0.0", "0.0"}  # numbers that are not written into a cell
LARGEST_WRITTEN = 8  # numbers are written into the cells of grids up to this size


class Map(NamedTuple):
    """One number per cell, and how it is shown; `doubtful` marks cells without data for their number."""

    title: str
    values: Float[np.ndarray, " C"]
    label: str
    form: str = "{:.2f}"
    norm: Normalize = Normalize(0, 1)
    colours: str = "cividis"
    doubtful: Bool[np.ndarray, "..."] = np.zeros((), bool)


def draw(result: Result, layout: Grid, table: Tabular, evidence: Evidence) -> Iterator[Drawing]:
    """Draw the maps of reward, constraint and occupancy that the method has."""
    maps = episodes.gather_grid(result, table)
    if result.spec.method.learns_reward:
        yield reward_maps(result, layout, table, maps)
    if result.spec.method.learns_feasibility:
        yield feasibility_maps(result, layout, table, maps, evidence)
    yield occupancy_maps(result, layout, maps)


def reward_maps(result: Result, layout: Grid, table: Tabular, maps: GridEvidence) -> Drawing:
    """Draw the true r(c, a) beside the mean over seeds of f(c, a), both centred on the visited cells."""
    true = np.asarray(table.reward)[: layout.size**2]
    seen = (maps.expert_occupancy + maps.occupancy.mean(axis=0)) / 2
    visited = seen > UNSEEN
    panels = [
        ("true reward $r(c, a)$", _centred(true, seen)),
        ("learned reward $f(c, a)$", np.mean([_centred(f, seen) for f in maps.reward], axis=0)),
    ]
    figure = Figure(figsize=(5.4, 2.3), layout="compressed")
    for axis, (title, values) in zip(figure.subplots(1, 2), panels, strict=True):
        bound = np.abs(values[visited]).max()
        _action_map(axis, layout, values, TwoSlopeNorm(0.0, -bound, bound), title)
        _hide(axis, layout, ~visited)
    correlation = np.corrcoef(panels[0][1][visited].ravel(), panels[1][1][visited].ravel())[0, 1]
    caption = (
        f"True reward beside the learned one, {over_seeds(result)}, the mean over seeds; each cell's four triangles are "
        "its moves up, right, down and left. f is identified up to a constant and potential shaping; centring both maps "
        "removes the constant alone. Hatched: cells that neither the expert nor the policy visits. "
        f"Correlation of the two maps over all moves from the others: {correlation:.2f}; of f and the true reward over the "
        f"feasible steps that a seed's own policy takes (reward_correlation): {final(result, 'reward_correlation')}."
    )
    return Drawing("reward", figure, caption)


def feasibility_maps(result: Result, layout: Grid, table: Tabular, maps: GridEvidence, evidence: Evidence) -> Drawing:
    """Draw δ₁ of each cell beside the true constraint.

    Where δ₁ or the constraint has no value by cell, average both over the reference trajectories through the cell.
    """
    doubtful = np.zeros(layout.size**2, bool)
    if result.spec.method.tests_steps and len(table.cost) == layout.size**2:
        allowed, words = 1.0 - np.asarray(table.cost), "δ₁ of each cell"
        doubtful = (maps.expert_occupancy < UNSEEN) & (maps.occupancy.mean(axis=0) < UNSEEN) & (allowed > 0)
        true = Map("true constraint", allowed, "1: allowed, 0: forbidden", "{:.0f}")
        learned = Map(r"learned $\delta_1(c)$", maps.step_delta.mean(axis=(0, 2)), r"$\delta_1$", doubtful=doubtful)
    else:
        words = "by the reference set's trajectories through each cell: their feasible share and their mean δ̄"
        clean, delta = ~episodes.infeasible(result.reference), evidence.delta_reference.mean(axis=0)
        true = Map("true constraint", _mean_through(clean, result.reference), "feasible share through $c$")
        learned = Map(r"learned", _mean_through(delta, result.reference), r"mean $\bar\delta(\tau)$ through $c$")
    figure = Figure(figsize=(5.4, 2.3), layout="compressed")
    for axis, panel in zip(figure.subplots(1, 2), (true, learned), strict=True):
        _cell_map(axis, layout, panel)
    beside = " In brackets: allowed cells where neither the expert nor the policy goes." if doubtful.any() else ""
    caption = (
        f"The true constraint beside what was learned, {words}: {over_seeds(result)}, the mean over seeds.{beside} "
        f"AUROC {final(result, 'feasibility_auroc')}, gap {final(result, 'feasibility_gap')}."
    )
    return Drawing("feasibility", figure, caption)


def occupancy_maps(result: Result, layout: Grid, maps: GridEvidence) -> Drawing:
    """Draw the share of the timesteps in each cell: the expert's, the policy's, and the difference."""
    expert, policy = 100 * maps.expert_occupancy, 100 * maps.occupancy.mean(axis=0)
    shared, unit = Normalize(0, max(expert.max(), policy.max())), "timesteps (%)"
    bound = max(np.abs(policy - expert).max(), 0.5)
    panels = (
        Map("expert", expert, unit, "{:.1f}", shared, "Blues"),
        Map(r"policy $\pi$", policy, unit, "{:.1f}", shared, "Blues"),
        Map("policy − expert", policy - expert, unit, "{:+.1f}", TwoSlopeNorm(0, -bound, bound), DIVERGING),
    )
    figure = Figure(figsize=(7.2, 2.1), layout="compressed")
    for axis, panel in zip(figure.subplots(1, 3), panels, strict=True):
        _cell_map(axis, layout, panel)
    exact = "the demonstrations'" if result.spec.own is not None else "the exact expert's"
    distance = 0.5 * np.abs(maps.occupancy - maps.expert_occupancy).sum(axis=1)
    caption = (
        f"Share of the timesteps in each cell: {exact} beside the exact one of the policy, {over_seeds(result)}, the "
        f"mean over seeds. Total variation between the two: {distance.mean():.3f}, of the farthest seed "
        f"{distance.max():.3f}."
    )
    return Drawing("occupancy", figure, caption)


def draw_layout(axis: Axes, layout: Grid, filled: bool = False) -> None:
    """Mark start, goal or sites, disliked cells (dotted), walls (dark) and the zones of the constraint on a map."""
    for name, cells in layout.zones.items():
        for row, column in cells:
            corner = (column - 0.5, row - 0.5)
            if filled:
                axis.add_patch(Rectangle(corner, 1, 1, fc="#d9d9d9", lw=0, zorder=0))
            axis.add_patch(Rectangle(corner, 1, 1, fill=False, ec=BLACK, lw=1.2, zorder=4))
            if len(name) == 1:
                _corner(axis, row, column, name)
    for row, column in layout.walls:
        axis.add_patch(Rectangle((column - 0.5, row - 0.5), 1, 1, fc=WALL, lw=0, zorder=5))
    for row, column in layout.tastes:
        axis.add_patch(Rectangle((column - 0.45, row - 0.45), 0.9, 0.9, fill=False, ec=BLACK, lw=0.8, ls=":", zorder=4))
    sites = [(f"{value:g}", cell) for cell, value in layout.sites.items()]
    for name, cell in (("S", layout.start), ("G", layout.goal), *sites):
        if cell is not None:
            _corner(axis, *cell, name)
    half = layout.size - 0.5
    axis.set(xlim=(-0.5, half), ylim=(half, -0.5), aspect="equal")
    axis.set_xticks(range(layout.size))
    axis.set_yticks(range(layout.size))
    axis.tick_params(length=0)
    axis.spines[:].set_visible(True)


def _corner(axis: Axes, row: int, column: int, name: str) -> None:
    patch = {"boxstyle": "circle,pad=0.12", "fc": "white", "ec": BLACK, "lw": 0.5}
    axis.text(column - 0.28, row - 0.27, name, ha="center", va="center", fontsize=5.5, bbox=patch, zorder=6)


def _cell_map(axis: Axes, layout: Grid, panel: Map) -> None:
    """Draw each cell's colour, and its number where there is room; doubtful ones in brackets."""
    shape = (layout.size, layout.size)
    colours = mpl.colormaps[panel.colours].with_extremes(bad="white")
    image = axis.imshow(panel.values.reshape(shape), cmap=colours, norm=panel.norm)
    if layout.size <= LARGEST_WRITTEN:
        doubtful = np.broadcast_to(panel.doubtful, layout.size**2).reshape(shape)
        for (row, column), value in np.ndenumerate(panel.values.reshape(shape)):
            text = panel.form.format(value).replace("-", "−")
            if np.isfinite(value) and text not in EMPTY:
                text, ink = f"({text})" if doubtful[row, column] else text, _ink(colours(panel.norm(value)))
                axis.text(column, row + 0.08, text, ha="center", va="center", fontsize=5.5, color=ink)
    draw_layout(axis, layout)
    axis.set_title(panel.title)
    _scale(axis, image, panel.label)


def _ink(colour: Sequence[float]) -> str:
    """Choose the ink on a colour: white where its luma is below one half, else black."""
    return "white" if np.dot(colour[:3], (0.30, 0.59, 0.11)) < 0.5 else BLACK


def _scale(axis: Axes, mappable: Any, label: str) -> None:
    axis.get_figure().colorbar(mappable, ax=axis, shrink=0.9, label=label)  # pyright: ignore[reportOptionalMemberAccess]


def _action_map(axis: Axes, layout: Grid, values: Float[np.ndarray, "C A"], norm: Normalize, title: str) -> None:
    """Draw each cell as four triangles: up, right, down and left."""
    row, column = np.divmod(np.arange(layout.size**2), layout.size)
    middle = np.stack([column, row], axis=1)
    corners = np.array([[-0.5, -0.5], [0.5, -0.5], [0.5, 0.5], [-0.5, 0.5], [-0.5, -0.5]])
    triangles = [[point, point + corners[a], point + corners[a + 1]] for point in middle for a in range(4)]
    cells = PolyCollection(triangles, array=values.ravel(), norm=norm, cmap=DIVERGING, edgecolor="white", lw=0.3)
    axis.add_collection(cells)
    draw_layout(axis, layout)
    axis.set_title(title)
    _scale(axis, cells, "reward per step, centred")


def _hide(axis: Axes, layout: Grid, hidden: Bool[np.ndarray, " C"]) -> None:
    for cell in np.flatnonzero(hidden):
        row, column = divmod(int(cell), layout.size)
        box = Rectangle((column - 0.5, row - 0.5), 1, 1, fc="#f2f2f2", ec="#bbbbbb", lw=0, hatch="////", zorder=3)
        axis.add_patch(box)


def _mean_through(values: np.ndarray, trajectories: Trajectory) -> Float[np.ndarray, " C"]:
    """Average over the trajectories that pass each cell; NaN where none does."""
    through = np.asarray(trajectories.obs).max(axis=1) > 0
    number = through.sum(axis=0)
    return np.where(number > 0, values.astype(float) @ through / np.maximum(number, 1), np.nan)


def _centred(reward: Float[np.ndarray, "C A"], occupancy: Float[np.ndarray, " C"]) -> Float[np.ndarray, "C A"]:
    return reward - (occupancy @ reward).mean() / occupancy.sum()
