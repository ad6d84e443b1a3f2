"""Draw Figures 2(b), 2(f), 7 and 8: places, long transitions and activity on the ground."""

from collections.abc import Sequence
from typing import NamedTuple

import matplotlib as mpl
import numpy as np
from jaxtyping import Float, Int, Shaped
from matplotlib.axes import Axes
from matplotlib.colors import ListedColormap, LogNorm
from matplotlib.figure import Figure
from matplotlib.patches import Patch
from scipy.spatial import KDTree

from aircl_jax.figures.animals.transitions import mark_simulated
from aircl_jax.figures.style import LARGER, literal

REACH = 1.5  # cells by which a place is drawn beyond the rows that name it
PLACE_COLOURS = (
    *("#4e79a7", "#bab0ac", "#b07aa1", "#59a14f", "#76b7b2"),
    *("#e15759", "#f28e2b", "#9c755f", "#edc948", "#d37295"),
)


class Rows(NamedTuple):
    """Located rows of one camera: positions on the ground and places."""

    position: Float[np.ndarray, "K 2"]
    place: Int[np.ndarray, " K"]


class Arrows(NamedTuple):
    """All cases of one transition at one camera."""

    title: str
    site: str
    start: Float[np.ndarray, "M 2"]
    end: Float[np.ndarray, "M 2"]


class Ground(NamedTuple):
    """The located rows of each camera, and the unit of the positions."""

    cameras: dict[str, Rows]
    unit: str


def regions(rows: Rows, cell: float, num_places: int) -> tuple[Int[np.ndarray, "H W"], tuple[float, float, float, float]]:
    """Find the place that most rows of a square cell name, and the extent (left, right, bottom, top) of the grid.

    Cells without rows take the place of the nearest cell with some, at most REACH cells away; −1 beyond.
    """
    low = np.floor(rows.position.min(axis=0) / cell).astype(int)
    index = np.floor(rows.position / cell).astype(int) - low
    width, height = (index.max(axis=0) + 1).tolist()
    votes = np.zeros((height, width, num_places), dtype=np.int64)
    np.add.at(votes, (index[:, 1], index[:, 0], rows.place), 1)
    occupied = np.argwhere(votes.any(axis=2))
    far, nearest = KDTree(occupied).query(np.argwhere(np.ones((height, width))))
    winner = votes.argmax(axis=2)[tuple(occupied[nearest].T)]
    left, bottom = (low * cell).tolist()
    grid = np.where(far <= REACH, winner, -1).reshape(height, width)
    return grid, (left, left + width * cell, bottom, bottom + height * cell)


def place_map(ground: Ground, places: Sequence[str], cell: float, *, points: bool, simulated: bool) -> Figure:
    """Draw Figures 2(b) and 8: places as regions of the ground, one panel for each camera; with rows as points if asked."""
    with mpl.rc_context(LARGER):
        figure, axes = _ground_axes(ground, height=3.4)
        for axis, rows in zip(axes, ground.cameras.values(), strict=True):
            draw_regions(axis, rows, len(places), cell, alpha=0.35 if points else 0.9)
            if points:
                axis.scatter(*rows.position.T, s=0.4, c=[_colour(place) for place in rows.place.tolist()], lw=0)
        _place_legend(figure, places, list(ground.cameras.values()))
        mark_simulated(figure, simulated)
    return figure


def draw_regions(axis: Axes, rows: Rows, num_places: int, cell: float, alpha: float) -> None:
    """Draw the cells of the ground in the colour of their place."""
    winner, extent = regions(rows, cell, num_places)
    axis.imshow(
        np.ma.masked_less(winner, 0),
        cmap=ListedColormap([_colour(place) for place in range(num_places)]),
        vmin=-0.5,
        vmax=num_places - 0.5,
        extent=extent,
        origin="lower",
        interpolation="nearest",
        alpha=alpha,
    )


def transition_map(
    ground: Ground, places: Sequence[str], transitions: Sequence[Arrows], cell: float, simulated: bool
) -> Figure:
    """Draw Figure 2(f): every case of a long transition as an arrow over the places, one panel for each transition."""
    arrow = {"arrowstyle": "-|>", "color": "black", "lw": 0.8, "shrinkA": 0, "shrinkB": 0}
    with mpl.rc_context(LARGER):
        figure = Figure(figsize=(4.6 * len(transitions), 3.3), layout="constrained")
        axes = figure.subplots(1, len(transitions), squeeze=False)[0]
        for axis, cases in zip(axes, transitions, strict=True):
            draw_regions(axis, ground.cameras[cases.site], len(places), cell, alpha=0.45)
            for start, end in zip(cases.start.tolist(), cases.end.tolist(), strict=True):
                axis.annotate("", xy=end, xytext=start, arrowprops=arrow)
            axis.plot(*cases.start.T, "o", ms=2.5, color="black")
            axis.set_title(literal(cases.title), fontsize=8)
            _label_ground(axis, ground.unit)
        _place_legend(figure, places, [ground.cameras[cases.site] for cases in transitions])
        mark_simulated(figure, simulated)
    return figure


def activity_map(ground: Ground, simulated: bool) -> Figure:
    """Draw Figure 7: rows (animal-seconds) on the ground in log scale, one panel for each camera."""
    with mpl.rc_context(LARGER):
        figure, axes = _ground_axes(ground, height=3.0)
        for axis, rows in zip(axes, ground.cameras.values(), strict=True):
            image = axis.hexbin(*rows.position.T, gridsize=55, mincnt=1, cmap="inferno", norm=LogNorm(), lw=0)
            figure.colorbar(image, ax=axis, label="rows (animal-seconds)", shrink=0.7)
        mark_simulated(figure, simulated)
    return figure


def _ground_axes(ground: Ground, height: float) -> tuple[Figure, Shaped[np.ndarray, " P"]]:
    figure = Figure(figsize=(4.6 * len(ground.cameras), height), layout="constrained")
    axes = figure.subplots(1, len(ground.cameras), squeeze=False)[0]
    for axis, site in zip(axes, ground.cameras, strict=True):
        axis.set_title(f"camera {literal(site)}" if site else "all recordings")
        _label_ground(axis, ground.unit)
    return figure, axes


def _label_ground(axis: Axes, unit: str) -> None:
    axis.set_aspect("equal")
    axis.set_xlabel(f"along the ground\n({literal(unit)})")
    axis.set_ylabel("across")


def _colour(place: int) -> str:
    return PLACE_COLOURS[place % len(PLACE_COLOURS)]


def _place_legend(figure: Figure, places: Sequence[str], shown_rows: Sequence[Rows]) -> None:
    shown = np.unique(np.concatenate([rows.place for rows in shown_rows])).tolist()
    handles = [Patch(color=_colour(place), label=literal(places[int(place)])) for place in shown]
    figure.legend(handles=handles, loc="outside lower center", ncols=5, frameon=False)
