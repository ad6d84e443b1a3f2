"""Figures of a grid: reward, constraint and occupancy as maps, sampled paths, and δ̄ by the order of two zones."""

from collections.abc import Iterator, Sequence
from typing import Any

import matplotlib as mpl
import numpy as np
from jaxtyping import Bool, Float, Int
from matplotlib.axes import Axes
from matplotlib.collections import PolyCollection
from matplotlib.colors import Normalize, TwoSlopeNorm
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle

from aircl_jax import evidence
from aircl_jax.api import Result
from aircl_jax.evidence import Evidence, GridEvidence
from aircl_jax.plots_style import BLACK, BLUE, GREY, ORANGE, Drawing, over_seeds
from aircl_jax.types import Trajectory
from envs.base import Layout
from envs.gridworld import MOVES

UNSEEN = 1e-3  # occupancy below which a cell says nothing about f: neither the expert nor π goes there
NUM_PATHS = 60
EMPTY = {"+0.0", "-0.0", "0.0"}  # numbers that are not worth a cell's space
LARGEST_WRITTEN = 8  # grids up to this size have their numbers written into the cells


def draw(result: Result, found: Evidence) -> Iterator[Drawing]:
    layout = result.plan.env.layout
    assert layout is not None
    maps = evidence.gather_grid(result)
    if evidence.learns_reward(result.plan.method):
        yield reward_maps(result, layout, maps)
    if result.plan.method.feasibility != "none":
        yield feasibility_maps(result, layout, maps, found)
        if len(layout.zones) == 2:
            yield order_of_zones(result, layout, found)
    yield occupancy_maps(result, layout, maps)
    yield paths(result, layout, found)


def reward_maps(result: Result, layout: Layout, maps: GridEvidence) -> Drawing:
    """True r(c, a) beside the mean over seeds of f(c, a), both centred on the visited cells."""
    table = result.plan.env.tabular
    assert table is not None
    true = np.asarray(table.reward)[: layout.size**2]
    seen = (maps.expert_occupancy + maps.occupancy.mean(axis=0)) / 2
    visited = seen > UNSEEN
    panels = [
        ("true reward $r(c, a)$", _centred(true, seen)),
        ("learned reward $f(c, a)$", np.mean([_centred(f, seen) for f in maps.reward], axis=0)),
    ]
    figure = Figure(figsize=(5.4, 2.6), layout="constrained")
    for axis, (title, values) in zip(figure.subplots(1, 2), panels, strict=True):
        bound = np.abs(values[visited]).max()
        norm = TwoSlopeNorm(0.0, -bound, bound)
        cells = _action_map(axis, layout, values, norm, "PuOr_r")
        _hide(axis, layout, ~visited)
        draw_layout(axis, layout)
        axis.set_title(title)
        figure.colorbar(cells, ax=axis, shrink=0.78, label="reward per step, centred")
    correlation = np.corrcoef(panels[0][1][visited].ravel(), panels[1][1][visited].ravel())[0, 1]
    caption = (
        f"True reward beside the learned one, {over_seeds(result)}, the mean over seeds; each cell's four triangles are "
        "its moves up, right, down and left. f is identified up to a constant and potential shaping: both maps are "
        "centred, the shaping stays. Hatched: cells that neither the expert nor the policy visits. "
        f"Correlation over the others: {correlation:.2f}."
    )
    return Drawing("reward", figure, caption)


def feasibility_maps(result: Result, layout: Layout, maps: GridEvidence, found: Evidence) -> Drawing:
    """Per cell where the constraint is one of cells and δ has a per-step factor; else of trajectories through the cell."""
    table = result.plan.env.tabular
    assert table is not None
    per_cell = len(table.cost) == layout.size**2
    through = _through(result.reference, layout)
    delta = found.delta_reference.mean(axis=0)
    clean = ~evidence.infeasible(result.reference)
    stepwise = "step" in result.plan.method.feasibility and per_cell
    panels = []
    if per_cell:
        panels.append(("true constraint", 1.0 - np.asarray(table.cost), "1: allowed, 0: forbidden", "{:.0f}"))
    else:
        panels.append(("true constraint", _mean_through(clean, through), "feasible share through $c$", "{:.2f}"))
    if stepwise:
        panels.append((r"learned $\delta_1(c)$", maps.step_delta.mean(axis=(0, 2)), r"$\delta_1$, mean of seeds", "{:.2f}"))
    else:
        panels.append(("learned", _mean_through(delta, through), r"mean $\bar\delta(\tau)$ through $c$", "{:.2f}"))
    figure = Figure(figsize=(5.4, 2.6), layout="constrained")
    for axis, (title, values, label, form) in zip(figure.subplots(1, 2), panels, strict=True):
        cells = _cell_map(axis, layout, values, Normalize(0, 1), "cividis", form)
        draw_layout(axis, layout)
        axis.set_title(title)
        figure.colorbar(cells, ax=axis, shrink=0.78, label=label)
    unseen = (maps.expert_occupancy < UNSEEN) & (maps.occupancy.mean(axis=0) < UNSEEN) & (np.asarray(panels[0][1]) > 0)
    if stepwise:
        _cross(figure.axes[1], layout, unseen)
    told = "δ₁ of each cell" if stepwise else "the mean δ̄ of the reference set's trajectories through each cell"
    over = " and actions" if stepwise and result.networks.feasibility_sees_action else ""
    crossed = " Crossed: allowed cells where neither the expert nor the policy goes." if stepwise and unseen.any() else ""
    caption = f"The true constraint beside what was learned, {told}: {over_seeds(result)}, the mean over seeds{over}.{crossed}"
    return Drawing("feasibility", figure, caption)


def occupancy_maps(result: Result, layout: Layout, maps: GridEvidence) -> Drawing:
    """Share of the timesteps in each cell: the expert's, the policy's, and the difference."""
    policy = maps.occupancy.mean(axis=0)
    expert, difference = 100 * maps.expert_occupancy, 100 * (policy - maps.expert_occupancy)
    top, bound = max(expert.max(), 100 * policy.max()), max(np.abs(difference).max(), 0.5)
    panels: list[tuple[str, Any, Normalize, str, str]] = [
        ("expert", expert, Normalize(0, top), "Blues", "{:.1f}"),
        (r"policy $\pi$", 100 * policy, Normalize(0, top), "Blues", "{:.1f}"),
        ("policy − expert", difference, TwoSlopeNorm(0, -bound, bound), "PuOr_r", "{:+.1f}"),
    ]
    figure = Figure(figsize=(7.2, 2.4), layout="constrained")
    for axis, (title, values, norm, colours, form) in zip(figure.subplots(1, 3), panels, strict=True):
        cells = _cell_map(axis, layout, values, norm, colours, form)
        draw_layout(axis, layout)
        axis.set_title(title)
        figure.colorbar(cells, ax=axis, shrink=0.78, label="timesteps (%)")
    exact = "the demonstrations'" if result.plan.own is not None else "the exact expert's"
    distance = 0.5 * np.abs(maps.occupancy - maps.expert_occupancy).sum(axis=1)
    caption = (
        f"Share of the timesteps spent in each cell: {exact} beside the policy's, exactly, {over_seeds(result)}, the "
        f"mean over seeds. Total variation between them: {distance.mean():.3f} (largest {distance.max():.3f})."
    )
    return Drawing("occupancy", figure, caption)


def paths(result: Result, layout: Layout, found: Evidence) -> Drawing:
    """Trajectories of D_E, π and q of the first seed; those that violate are drawn last and in another colour."""
    first = [_first_seed(result.expert), _first_seed(found.policy)]
    titles = ["demonstrations $D_E$", r"policy $\pi$"]
    if result.plan.method.sampled_from != "policy":
        first.append(_first_seed(found.sampled))
        titles.append("samples of $q$")
    figure = Figure(figsize=(2.3 * len(first) + 0.2, 2.6), layout="constrained")
    shares = []
    for axis, title, trajectories in zip(figure.subplots(1, len(first)), titles, first, strict=True):
        violating = evidence.infeasible(trajectories)
        shares.append(f"{title.split()[-1].strip('$')} {100 * violating.mean():.1f} %")
        _draw_paths(axis, layout, _cells(trajectories, layout)[:NUM_PATHS], violating[:NUM_PATHS])
        draw_layout(axis, layout, filled=True)
        axis.set_title(title)
    for colour, label in ((BLUE, "feasible"), (ORANGE, "infeasible")):
        figure.axes[0].plot([], [], color=colour, label=label)
    figure.legend(loc="outside lower center", ncols=2, frameon=False)
    caption = (
        f"{min(NUM_PATHS, *(len(one.mask) for one in first))} trajectories each, {result.summary['method']} on "
        f"{result.summary['env']}, seed {result.summary['seeds'][0]}, shifted within the cells to be told apart. "
        f"Infeasible: {', '.join(shares)}.".replace(r"\pi", "π").replace("D_E", "D_E")
    )
    return Drawing("paths", figure, caption)


def order_of_zones(result: Result, layout: Layout, found: Evidence) -> Drawing:
    """Mean δ̄ of the reference set's trajectories by which of two zones they visit, and in which order."""
    one, two = layout.zones
    classes = visits(_visited_cells(result.reference, layout), layout)
    names = [("neither", "neither"), ("first", f"{one} only"), ("second", f"{two} only"), ("back", f"{two}, then {one}")]
    names = [(key, label) for key, label in [*names, ("order", f"{one}, then {two}")] if classes[key].any()]
    figure = Figure(figsize=(3.4, 2.3), layout="constrained")
    axis = figure.subplots()
    for place, (key, _) in enumerate(names):
        chosen, colour = classes[key], ORANGE if key == "order" else BLUE
        means = found.delta_reference[:, chosen].mean(axis=1)
        offset = np.linspace(-0.18, 0.18, len(means)) if len(means) > 1 else np.zeros(1)
        axis.bar(place, means.mean(), width=0.62, color=colour, alpha=0.35)
        axis.plot(place + offset, means, "o", color=colour, ms=2.5)
        axis.text(place, 1.04, f"{means.mean():.2f}", ha="center", color=colour)
    axis.set_xticks(range(len(names)), [f"{label}\n({classes[key].sum()})" for key, label in names])
    axis.set(ylim=(0, 1.12), ylabel=r"mean feasibility $\bar\delta(\tau)$", xlabel="zones visited (trajectories)")
    caption = (
        f"Mean δ̄ of the reference set's trajectories by the zones that they visit; only {one}, then {two} is forbidden "
        f"(orange). {over_seeds(result)}: bars are means, dots seeds."
    )
    return Drawing("order_of_zones", figure, caption)


def visits(cells: Int[np.ndarray, "N T"], layout: Layout) -> dict[str, Bool[np.ndarray, " N"]]:
    """Which trajectories visit neither zone, the first or the second alone, and both in either order."""
    first, second = (np.isin(cells, [_index(cell, layout) for cell in zone]) for zone in layout.zones.values())
    in_order = (second & (np.cumsum(first, axis=1) > 0)).any(axis=1)
    seen_first, seen_second = first.any(axis=1), second.any(axis=1)
    return {
        "neither": ~seen_first & ~seen_second,
        "first": seen_first & ~seen_second,
        "second": ~seen_first & seen_second,
        "back": seen_first & seen_second & ~in_order,
        "order": in_order,
    }


def draw_layout(axis: Axes, layout: Layout, filled: bool = False) -> None:
    """Start, goal and the zones of the constraint, over whatever fills the cells."""
    for name, cells in layout.zones.items():
        for row, column in cells:
            box: dict[str, Any] = {"fc": "#d9d9d9", "zorder": 0} if filled else {"fill": False, "zorder": 4}
            axis.add_patch(Rectangle((column - 0.5, row - 0.5), 1, 1, ec=BLACK, lw=1.2, **box))
            if len(name) == 1:
                _corner(axis, row, column, name)
    for name, (row, column) in (("S", layout.start), ("G", layout.goal)):
        _corner(axis, row, column, name)
    half = layout.size - 0.5
    axis.set(xlim=(-0.5, half), ylim=(half, -0.5), aspect="equal")
    axis.set_xticks(range(layout.size))
    axis.set_yticks(range(layout.size))
    axis.tick_params(length=0)
    axis.spines[:].set_visible(True)


def _corner(axis: Axes, row: int, column: int, name: str) -> None:
    patch = {"boxstyle": "circle,pad=0.12", "fc": "white", "ec": BLACK, "lw": 0.5}
    axis.text(column - 0.28, row - 0.27, name, ha="center", va="center", fontsize=5.5, bbox=patch, zorder=6)


def _cell_map(axis: Axes, layout: Layout, values: Float[np.ndarray, " C"], norm: Normalize, colours: str, form: str) -> Any:
    square = np.asarray(values).reshape(layout.size, layout.size)
    image = axis.imshow(square, cmap=mpl.colormaps[colours].with_extremes(bad="white"), norm=norm)
    if layout.size <= LARGEST_WRITTEN:
        for (row, column), value in np.ndenumerate(square):
            text = form.format(value)
            if np.isfinite(value) and text not in EMPTY:
                red, green, blue, _ = image.cmap(norm(value))
                ink = "white" if 0.3 * red + 0.59 * green + 0.11 * blue < 0.5 else BLACK
                axis.text(column, row + 0.08, text, ha="center", va="center", fontsize=5.5, color=ink)
    return image


def _action_map(axis: Axes, layout: Layout, values: Float[np.ndarray, "C A"], norm: Normalize, colours: str) -> Any:
    """Each cell in four triangles, up, right, down and left."""
    row, column = np.divmod(np.arange(layout.size**2), layout.size)
    middle = np.stack([column, row], axis=1)
    corners = np.array([[-0.5, -0.5], [0.5, -0.5], [0.5, 0.5], [-0.5, 0.5], [-0.5, -0.5]])
    triangles = [[point, point + corners[a], point + corners[a + 1]] for point in middle for a in range(4)]
    cells = PolyCollection(triangles, array=values.ravel(), norm=norm, cmap=colours, edgecolor="white", lw=0.3)
    axis.add_collection(cells)
    return cells


def _hide(axis: Axes, layout: Layout, hidden: Bool[np.ndarray, " C"]) -> None:
    for cell in np.flatnonzero(hidden):
        row, column = divmod(int(cell), layout.size)
        box = Rectangle((column - 0.5, row - 0.5), 1, 1, fc="#f2f2f2", ec="#bbbbbb", lw=0, hatch="////", zorder=3)
        axis.add_patch(box)


def _cross(axis: Axes, layout: Layout, crossed: Bool[np.ndarray, " C"]) -> None:
    """A thin diagonal through cells."""
    for cell in np.flatnonzero(crossed):
        row, column = divmod(int(cell), layout.size)
        axis.plot([column - 0.5, column + 0.5], [row + 0.5, row - 0.5], color="white", lw=0.7, zorder=3)


def _draw_paths(axis: Axes, layout: Layout, cells: Int[np.ndarray, "N T"], violating: Bool[np.ndarray, " N"]) -> None:
    shift = np.random.default_rng(0).uniform(-0.3, 0.3, (len(cells), 2))
    for index in np.argsort(violating, kind="stable"):
        row, column = np.divmod(cells[index], layout.size)
        colour, width = (ORANGE, 0.9) if violating[index] else (BLUE, 0.6)
        axis.plot(column + shift[index, 1], row + shift[index, 0], color=colour, lw=width, alpha=0.6, zorder=2)
    axis.hlines(np.arange(layout.size) - 0.5, -0.5, layout.size - 0.5, color=GREY, lw=0.3, zorder=1)
    axis.vlines(np.arange(layout.size) - 0.5, -0.5, layout.size - 0.5, color=GREY, lw=0.3, zorder=1)


def _cells(trajectories: Trajectory, layout: Layout) -> Int[np.ndarray, "N T1"]:
    """The cells seen, and the one that the last action meant: what an episode's last step leads to is not observed."""
    seen = _visited_cells(trajectories, layout)
    row, column = np.divmod(seen[:, -1], layout.size)
    moved = np.clip(np.stack([row, column], 1) + MOVES[np.asarray(trajectories.action)[:, -1]], 0, layout.size - 1)
    at_goal = seen[:, -1] == _index(layout.goal, layout)
    last = np.where(at_goal, seen[:, -1], moved @ np.array([layout.size, 1]))
    return np.concatenate([seen, last[:, None]], axis=1)


def _visited_cells(trajectories: Trajectory, layout: Layout) -> Int[np.ndarray, "N T"]:
    return np.asarray(trajectories.obs).argmax(axis=-1)


def _through(trajectories: Trajectory, layout: Layout) -> Bool[np.ndarray, "N C"]:
    return np.asarray(trajectories.obs).max(axis=1) > 0


def _mean_through(values: np.ndarray, through: Bool[np.ndarray, "N C"]) -> Float[np.ndarray, " C"]:
    """Mean over the trajectories that pass each cell; NaN where none does."""
    number = through.sum(axis=0)
    return np.where(number > 0, values @ through / np.maximum(number, 1), np.nan)


def _centred(reward: Float[np.ndarray, "C A"], occupancy: Float[np.ndarray, " C"]) -> Float[np.ndarray, "C A"]:
    return reward - (occupancy @ reward).mean() / occupancy.sum()


def _first_seed(trajectories: Trajectory) -> Trajectory:
    return Trajectory(*(np.asarray(leaf)[0] for leaf in trajectories))  # pyright: ignore[reportArgumentType]


def _index(cell: Sequence[int], layout: Layout) -> int:
    return cell[0] * layout.size + cell[1]
