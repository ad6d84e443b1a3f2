"""Draw a world of codes: recovered reward and feasibility by pair of codes, and the activities ranked by reward."""

from collections.abc import Iterator, Sequence
from typing import Any

import matplotlib as mpl
import numpy as np
from jaxtyping import Bool, Float
from matplotlib.axes import Axes
from matplotlib.colors import ListedColormap
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle

from aircl_jax.analysis.recovered import LEAST_SEEN, Recovered, avoided, beginning, changes, expected, rank_agreement
from aircl_jax.figures.style import BLACK, BLUE, GREY, ORANGE, Drawing, literal
from envs import Codes

PALE = "#f2f2f2"
SMALL = 5.5  # font size of the names beside a map of codes, in points


def draw(recovered: Recovered, codes: Codes, title: str) -> Iterator[Drawing]:
    """Draw reward and feasibility of every pair of codes, and the activities in order of reward, where they were learned.

    Activities are ranked where one begins often enough, and changes are drawn where the recordings hold any.
    """
    if np.isfinite(recovered.reward).all():
        begun = changes(recovered.seen).sum(axis=0)
        if begun.max() >= LEAST_SEEN:
            yield ranked_activities(recovered, codes, title)
        if begun.any():
            yield reward_map(recovered, codes, title)
    if np.isfinite(recovered.delta).all():
        yield feasibility_map(recovered, codes, title)


def ranked_activities(recovered: Recovered, codes: Codes, title: str) -> Drawing:
    """Draw a row for each activity that begins often enough: every seed a dot, the mean a bar."""
    begun = changes(recovered.seen).sum(axis=0)
    shown = np.flatnonzero(begun >= LEAST_SEEN)
    values = beginning(recovered)[:, shown]
    order = np.argsort(values.mean(axis=0))
    figure = Figure(figsize=(3.8, 0.4 + 0.17 * len(shown)), layout="constrained")
    axis = figure.subplots()
    height = np.arange(len(shown))
    axis.grid(axis="y", lw=0.3, color=GREY, zorder=1)
    axis.plot(values[:, order].T, np.repeat(height[:, None], len(values), 1), "o", color=BLUE, ms=2, alpha=0.35, zorder=2)
    axis.plot(values.mean(axis=0)[order], height, "o", color=BLACK, ms=3.2, zorder=3)
    axis.set_yticks(height, [f"{literal(codes.names[shown[i]])} ({begun[shown[i]]})" for i in order], fontsize=6)
    axis.set_xlabel("reward of beginning it")
    axis.set_ylim(-0.7, len(shown) - 0.3)
    return Drawing(
        "activities",
        figure,
        f"Activities by the recovered reward of beginning them, {title}: mean over seeds black, seeds blue, 0 the average "
        f"step; in brackets how often each begins in the recordings.{_agreement(values)}",
    )


def reward_map(recovered: Recovered, codes: Codes, title: str) -> Drawing:
    """Draw f of the pairs that the recordings hold; there are no data for the others."""
    mean = np.where(recovered.seen > 0, recovered.reward.mean(axis=0), np.nan)
    changed = mean[changes(recovered.seen) > 0]
    colours = mpl.colormaps["YlGnBu"].with_extremes(bad=PALE)
    style = {"cmap": colours, "vmin": float(changed.min()), "vmax": float(changed.max())}
    figure, _ = code_map(mean, codes.names, "reward (0: the average step)", style, extend="max")
    ranked = recovered.reward[:, changes(recovered.seen) >= LEAST_SEEN]
    return Drawing(
        "reward_by_change",
        figure,
        f"Recovered reward of every change that the recordings hold (grey: none), mean over seeds, {title}; "
        f"the colours span the changes, and continuing an activity lies beyond them.{_agreement(ranked)}",
    )


def feasibility_map(recovered: Recovered, codes: Codes, title: str) -> Drawing:
    """Draw δ₁ of every pair: hatched where cameras or coding rule it out, boxed where avoided though chance would show it."""
    style = {"cmap": mpl.colormaps["viridis"], "vmin": 0.0, "vmax": 1.0}
    figure, axis = code_map(recovered.delta.mean(axis=0), codes.names, "feasibility", style)
    _hatch(axis, codes.impossible)
    for source, target in avoided(recovered, codes):
        axis.add_patch(Rectangle((target - 0.5, source - 0.5), 1, 1, fill=False, ec=ORANGE, lw=1))
    testable = expected(recovered.seen, codes.impossible) >= LEAST_SEEN
    return Drawing(
        "feasibility_by_change",
        figure,
        f"Recovered feasibility of every change, mean over seeds, {title}. Hatched: impossible for the cameras or the coding. "
        f"Boxed: infeasible although chance would have shown it {LEAST_SEEN} times or more."
        f"{_agreement(recovered.delta[:, testable])}",
    )


def code_map(
    values: Float[np.ndarray, "C C"], names: Sequence[str], label: str, style: dict[str, Any], extend: str = "neither"
) -> tuple[Figure, Axes]:
    """Draw a map from code to code with the names beside it and a colour bar."""
    figure = Figure(figsize=(5.6, 4.3), layout="constrained")
    axis = figure.subplots()
    image = axis.imshow(values, interpolation="nearest", **style)
    figure.colorbar(image, label=label, shrink=0.85, extend=extend)
    axis.set_xticks(range(len(names)), [str(code) for code in range(len(names))], fontsize=SMALL)
    axis.set_yticks(range(len(names)), [f"{literal(name)}  {code}" for code, name in enumerate(names)], fontsize=SMALL)
    axis.set(xlabel="to", ylabel="from")
    for side in ("top", "right"):
        axis.spines[side].set_visible(True)
    return figure, axis


def _hatch(axis: Axes, where: Bool[np.ndarray, "C C"]) -> None:
    size = len(where) + 1
    edges = np.arange(size) - 0.5
    marked = np.ma.masked_where(~where, np.ones(where.shape))
    axis.pcolor(edges, edges, marked, hatch="//////", cmap=ListedColormap(["#ffffff"]), ec="#bbbbbb", lw=0)


def _agreement(values: Float[np.ndarray, "S K"]) -> str:
    ranks = rank_agreement(values)
    if not len(ranks) or not np.isfinite(ranks).all():
        return ""
    return f" Rank correlation between seeds {ranks.mean():.2f} (least {ranks.min():.2f})."
