"""Draw Figures 2(c), (d), (e) and (g): distances of behaviour transitions, maps of pairs of codes, the table of codes."""

from collections.abc import Sequence
from pathlib import Path

import matplotlib as mpl
import numpy as np
from jaxtyping import Float, Int
from matplotlib.axes import Axes
from matplotlib.colors import PowerNorm
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle

from aircl_jax.analysis.transition_distances import Histogram, Pairs
from aircl_jax.figures.style import DPI, LARGER, literal

BLUE, ORANGE, GREY = "#2f6fab", "#d1603d", "#8a8a8a"


def save(figure: Figure, path: Path) -> None:
    """Write the figure to a PNG file."""
    figure.savefig(path, dpi=DPI, bbox_inches="tight", pad_inches=0.05)


def distance_histograms(panels: dict[str, tuple[Histogram, str]], unit: str, simulated: bool) -> Figure:
    """Draw Figure 2(c): a column with a note for each way of counting; histogram above, cumulative share below."""
    with mpl.rc_context(LARGER):
        figure = Figure(figsize=(4.2 * len(panels), 4.6), layout="constrained")
        axes = figure.subplots(2, len(panels), sharex=True, sharey="row", squeeze=False, height_ratios=(3, 2))
        for column, (title, (panel, note)) in enumerate(panels.items()):
            _histogram(axes[0, column], panel)
            _cumulative(axes[1, column], panel)
            axes[0, column].set_title(title)
            axes[0, column].text(0.98, 0.97, note, ha="right", va="top", transform=axes[0, column].transAxes)
            axes[1, column].set_xlabel(f"distance between the onsets of two behaviours\n({literal(unit)})")
        axes[0, 0].set_ylabel("transitions")
        axes[1, 0].set_ylabel("cumulative share")
        handles, labels = axes[0, 0].get_legend_handles_labels()
        figure.legend(handles, labels, loc="outside lower center", ncols=4, frameon=False)
        mark_simulated(figure, simulated)
    return figure


def _histogram(axis: Axes, panel: Histogram) -> None:
    edges, middle = panel.edges, (panel.edges[:-1] + panel.edges[1:]) / 2
    axis.bar(middle, panel.counts, width=np.diff(edges) * 0.92, color=BLUE, alpha=0.75, label="transitions")
    spread = np.abs(panel.band - panel.counts)
    axis.errorbar(middle, panel.counts, spread, fmt="none", color="black", lw=0.7, label="95 %, recordings resampled")
    axis.plot(middle, panel.trend, color=ORANGE, lw=1.5, label="smoothed trend")
    axis.plot(middle, panel.shuffled, color=GREY, lw=1.2, ls="--", label="null: ends shuffled")
    axis.fill_between(middle, *panel.shuffled_band, color=GREY, alpha=0.25, lw=0)
    axis.set_yscale("symlog", linthresh=1)
    axis.set_ylim(0, panel.counts.max() * 2)
    axis.set_yticks([0, 1, 10, 100, 1000], ["0", "1", "10", "100", "1000"])


def _cumulative(axis: Axes, panel: Histogram) -> None:
    for counts, colour, line in ((panel.counts, BLUE, "-"), (panel.shuffled, GREY, "--")):
        axis.plot(panel.edges, np.append(0.0, counts.cumsum() / counts.sum()), color=colour, ls=line)
    axis.set_ylim(0, 1.03)
    axis.grid(axis="y", lw=0.3)


def pair_maps(
    pairs: Pairs, names: Sequence[str], marked: Sequence[tuple[int, int]], unit: str, simulated: bool
) -> tuple[Figure, Figure]:
    """Draw Figures 2(d), mean distance, and 2(e), share of each starting code with the long transitions boxed."""
    distance = np.where(pairs.located > 0, pairs.mean_distance, np.nan)
    frequency = np.where(pairs.seen > 0, pairs.frequency, np.nan)
    with mpl.rc_context(LARGER):
        first = _matrix(distance, names, f"mean distance ({literal(unit)})", marked)
        second = _matrix(frequency, names, "share of the transitions out of a code", marked)
        for figure in (first, second):
            mark_simulated(figure, simulated)
    return first, second


def _matrix(values: Float[np.ndarray, "C C"], names: Sequence[str], label: str, marked: Sequence[tuple[int, int]]) -> Figure:
    figure = Figure(figsize=(6.6, 4.6), layout="constrained")
    axis = figure.subplots()
    colours = mpl.colormaps["viridis"].with_extremes(bad="#eeeeee")
    image = axis.imshow(values, cmap=colours, norm=PowerNorm(0.5, vmin=0.0), interpolation="nearest")
    figure.colorbar(image, label=label, shrink=0.9)
    axis.set_xticks(np.arange(len(names)), [str(code) for code in range(len(names))], fontsize=6)
    axis.set_yticks(np.arange(len(names)), [f"{literal(name)}  {code}" for code, name in enumerate(names)], fontsize=6)
    axis.set_xlabel("to code (grey: never seen)")
    axis.set_ylabel("from")
    for source, target in marked:
        axis.add_patch(Rectangle((target - 0.5, source - 0.5), 1, 1, fill=False, ec=ORANGE, lw=2))
    return figure


def code_table(names: Sequence[str], rows: Int[np.ndarray, " C"], simulated: bool) -> Figure:
    """Draw Figure 2(g): the code of each state, with its share of the rows."""
    half = -(-len(names) // 2)
    share = rows / rows.sum()
    cells = [f"{code}  {literal(name)}" for code, name in enumerate(names)]
    with mpl.rc_context(LARGER):
        figure = Figure(figsize=(6.4, 0.24 * half + 0.5), layout="constrained")
        axis = figure.subplots()
        axis.axis("off")
        for column, first in enumerate((0, half)):
            for line, code in enumerate(range(first, min(first + half, len(names)))):
                height = 1 - (line + 0.5) / half
                axis.text(0.5 * column, height, cells[code], va="center")
                axis.text(0.5 * column + 0.44, height, f"{100 * share[code]:.2f} %", va="center", ha="right")
        mark_simulated(figure, simulated)
    return figure


def mark_simulated(figure: Figure, simulated: bool) -> None:
    """Write SIMULATED in the corner of a figure of simulated animals."""
    if simulated:
        figure.text(0.995, 0.995, "SIMULATED", ha="right", va="top", color="crimson", fontsize=9, weight="bold")
