"""Draw a sweep over one setting: each metric against its value, every seed a dot."""

from collections.abc import Mapping
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from aircl_jax.figures.style import BLUE, GREEN, ORANGE, PURPLE, Drawing

SHOWN = {  # metric: label, colour, least upper end of its axis
    "violation_rate": ("violations of $q$", ORANGE, 0.02),
    "violation_rate_policy": (r"violations of $\pi$", ORANGE, 0.02),
    "goal_rate": ("reaches the goal", BLUE, 1.0),
    "feasibility_auroc": (r"AUROC of $\bar\delta$", GREEN, 1.0),
    "feasibility_gap": (r"gap of $\bar\delta$", GREEN, 1.0),
    "reward_correlation": ("corr. of $f$, $r$", PURPLE, 1.0),
}


def draw(name: str, title: str, cell: Mapping[str, Any]) -> Drawing:
    """Draw small multiples over even places, each labelled with its value. Use within `matplotlib.rc_context(STYLE)`."""
    shown = [metric for metric in SHOWN if metric in cell["metrics"]]
    figure = Figure(figsize=(7.2, 1.9), layout="constrained")
    values, places = cell["values"], np.arange(len(cell["values"]))
    for axis, metric in zip(figure.subplots(1, len(shown)), shown, strict=True):
        label, colour, top = SHOWN[metric]
        seeds = np.array(cell["metrics"][metric], float)
        axis.plot(places[:, None] + np.linspace(-0.15, 0.15, seeds.shape[1]), seeds, "o", color=colour, ms=1.6, alpha=0.5)
        axis.plot(places, np.nanmean(seeds, axis=1), color=colour, lw=1.2)
        low = min(0.0, 1.1 * float(np.nanmin(seeds)))
        axis.set(ylim=(low, max(top, 1.1 * float(np.nanmax(seeds)))), title=label)
        axis.set_xticks(places, [f"{value:g}" for value in values], rotation=60)
    figure.supxlabel(title, fontsize=7)
    caption = (
        f"{cell['method']} on the grid at {len(values)} values of `{cell['setting']}`, {cell['seeds']} seeds each: "
        "lines are means, dots seeds; the values stand at even distances."
    )
    return Drawing(name, figure, caption)
