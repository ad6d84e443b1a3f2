"""Draw Figure 4: maps of causal links, of the differences |ΔV| of generated trajectories, and the means by seed."""

from collections.abc import Mapping, Sequence

import numpy as np
from jaxtyping import Float
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.colors import PowerNorm, SymLogNorm
from matplotlib.figure import Figure

from aircl_jax.figures.style import BLACK, BLUE, GREEN, GREY, ORANGE

COLUMNS = 5
TICKS = 5  # codes between two labels of a map
STRONGEST_SHOWN = 0.15  # |V| and |ΔV| at which the colours end; pairs of a code with itself lie far beyond


def link_maps(own: Float[np.ndarray, "C C"], apart: Mapping[str, Float[np.ndarray, "C C"]]) -> Figure:
    """Draw V of the recordings, then |ΔV| of each method and yardstick on one scale with its mean above."""
    rows = -(-(len(apart) + 1) // COLUMNS)
    figure = Figure(figsize=(7.2, 1.55 * rows + 0.5), layout="compressed")
    axes = figure.subplots(rows, COLUMNS, sharex=True, sharey=True, squeeze=False).ravel()
    for axis in axes[len(apart) + 1 :]:
        axis.remove()
    used = list(axes[: len(apart) + 1])
    bound = STRONGEST_SHOWN
    signed = used[0].imshow(own, cmap="RdBu_r", norm=SymLogNorm(bound / 10, vmin=-bound, vmax=bound), interpolation="nearest")
    used[0].set_title("recordings, V\n", fontsize=6.5)
    scale = PowerNorm(0.5, vmin=0, vmax=bound)
    image = ScalarMappable(scale, "Blues")
    for axis, (name, values) in zip(used[1:], apart.items(), strict=True):
        axis.imshow(values, cmap="Blues", norm=scale, interpolation="nearest")
        axis.set_title(f"{name}\nmean |ΔV| {values.mean():.4f}", fontsize=6.5)
    for axis in used:
        axis.set_xticks(range(0, len(own), TICKS))
        axis.set_yticks(range(0, len(own), TICKS))
        axis.tick_params(labelbottom=True)
        for side in ("top", "right"):
            axis.spines[side].set_visible(True)
    ticks = [0.0, 0.01, 0.05, 0.1, bound]
    figure.colorbar(image, ax=used, label="|ΔV|", shrink=0.6, aspect=30, pad=0.01, extend="max", ticks=ticks)
    ticks = [-bound, -0.05, -0.01, 0.0, 0.01, 0.05, bound]
    bar = figure.colorbar(
        signed, ax=used, label="V", shrink=0.6, aspect=30, pad=0.01, extend="both", location="left", ticks=ticks
    )
    bar.ax.set_yticks(ticks, [f"{tick:g}" for tick in ticks])
    bar.ax.minorticks_off()
    for first in used[::COLUMNS]:
        first.set_ylabel("from code")
    figure.supxlabel("to code", fontsize=7)
    return figure


def differences(methods: Mapping[str, Sequence[float]], yardsticks: Mapping[str, Sequence[float]]) -> Figure:
    """Draw mean |ΔV| of every method, a dot for each seed, the yardsticks, and lines at 1 and 1.25 noise floors."""
    names = [*methods, *yardsticks]
    values = [np.asarray(seeds, float) for seeds in (*methods.values(), *yardsticks.values())]
    figure = Figure(figsize=(4.4, 0.55 + 0.2 * len(names)), layout="constrained")
    axis = figure.subplots()
    for height, (name, seeds) in enumerate(zip(names, values, strict=True)):
        colour = GREY if name in yardsticks else BLUE
        _row(axis, height, seeds, colour)
    floor = float(np.mean(yardsticks["noise floor"])) if "noise floor" in yardsticks else None
    if floor is not None:
        axis.axvline(floor, color=GREEN, lw=1, zorder=0)
        axis.axvline(1.25 * floor, color=GREEN, lw=1, ls=(0, (3, 2)), zorder=0)
        axis.annotate(
            "noise floor, × 1.25", (1.25 * floor, 1.0), xycoords=("data", "axes fraction"), fontsize=6, color=GREEN, va="bottom"
        )
    axis.axhline(len(methods) - 0.5, color=GREY, lw=0.5, ls=":")
    axis.set_yticks(range(len(names)), names)
    axis.set_ylim(len(names) - 0.4, -0.6)
    axis.set_xlim(0, None)
    axis.set_xlabel("mean |ΔV| to the recordings' windows (seeds, their mean)")
    return figure


def held_out(scores: Mapping[str, Sequence[float]]) -> Figure:
    """Draw mean log P of the next code on held-out recordings: a dot for each fold, joined to the Markov chain's."""
    names = list(scores)
    values = np.array([scores[name] for name in names])
    figure = Figure(figsize=(4.4, 0.6 + 0.25 * len(names)), layout="constrained")
    axis = figure.subplots()
    height = np.arange(len(names))
    axis.plot(values, height, color=GREY, lw=0.5, alpha=0.6, zorder=1)
    for row, folds in enumerate(values):
        _row(axis, row, folds, ORANGE if names[row] == "Markov chain" else BLUE)
    axis.set_yticks(height, names)
    axis.set_ylim(len(names) - 0.5, -0.5)
    axis.set_xlabel("mean log-probability of the next code (nats; folds joined)")
    return figure


def _row(axis: Axes, height: int, values: Float[np.ndarray, " S"], colour: str) -> None:
    axis.plot(values, np.full(len(values), height), "o", color=colour, ms=2.5, alpha=0.5, zorder=2)
    axis.plot(values.mean(), height, "|", color=BLACK, ms=9, mew=1.4, zorder=3)
