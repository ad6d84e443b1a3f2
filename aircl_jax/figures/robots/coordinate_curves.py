"""Draw the learned constraint of an additive δ₁, one curve for each coordinate."""

import numpy as np
from matplotlib.figure import Figure

from aircl_jax.analysis.coordinate_contributions import Contributions
from aircl_jax.figures.robots.step_histograms import lines_of_coordinate, lines_of_motors
from aircl_jax.figures.style import BLUE, GREEN, GREY, ORANGE, Drawing, over_seeds
from aircl_jax.runs.result import Result

COLUMNS = 5
LEAST = -6.0  # lower end of every axis: a ratio of e^-6


def by_coordinate(result: Result, learned: Contributions) -> Drawing:
    """Draw all seeds' curves, their mean, D_E's histogram and the true limit. Use within `matplotlib.rc_context(STYLE)`."""
    env = result.spec.env
    lines = {name: lines_of_coordinate(env.limit, index) for index, name in enumerate(env.coordinate_names)}
    lines |= dict.fromkeys(env.motor_names, lines_of_motors(env.limit))
    columns = min(COLUMNS, len(learned.names))
    rows = -(-len(learned.names) // columns)
    figure = Figure(figsize=(7.2, 0.5 + 1.3 * rows), layout="constrained")
    axes = figure.subplots(rows, columns, squeeze=False, sharey=True).ravel()
    for axis in axes[len(learned.names) :]:
        axis.remove()
    top = max(1.5, float(learned.curves.max()) + 0.3)
    for index, name in enumerate(learned.names):
        axis, across, curves = axes[index], learned.grid[:, index], learned.curves[:, :, index]
        density, edges = np.histogram(learned.seen[:, index], bins=40, range=(across[0], across[-1] + 1e-9))
        heights = LEAST + 0.4 * (top - LEAST) * density / density.max()
        axis.fill_between(edges[:-1], LEAST, heights, step="post", color=GREY, alpha=0.3, lw=0)
        axis.plot(across, np.maximum(curves, LEAST).T, color=GREEN, lw=0.5, alpha=0.5)
        axis.plot(across, np.maximum(curves.mean(axis=0), LEAST), color=BLUE, lw=1.3)
        for value in lines[name]:
            axis.axvline(value, color=ORANGE, ls=(0, (4, 2)), lw=1.0)
        axis.set(xlabel=name, ylim=(LEAST, top), xlim=(across[0], across[-1]))
    figure.supylabel("log ratio, expert : policy", fontsize=7)
    drawn = any(lines[name] for name in learned.names)
    dashed = " The dashed lines are the true limit, which training does not read." if drawn else ""
    caption = (
        "Contribution of each coordinate to the log density ratio that δ₁ tests. 0 is its average in D_E; values far below 0 "
        f"are where the policy goes and the demonstrations do not. {over_seeds(result)}: the mean (blue), every seed "
        f"(green), the histogram of D_E (grey).{dashed}"
    )
    return Drawing("constraint_by_coordinate", figure, caption)
