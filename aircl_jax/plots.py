"""The figures of a run: which are drawn for what, δ̄ on the reference set, and writing them."""

from collections.abc import Iterator
from pathlib import Path

import matplotlib as mpl
import numpy as np
from matplotlib.figure import Figure

from aircl_jax import evidence, plots_codes, plots_coordinates, plots_curves, plots_grid, plots_maze, plots_paths, plots_steps
from aircl_jax.api import Result
from aircl_jax.plots_style import BLUE, DPI, ORANGE, STYLE, Drawing, final, over_seeds
from aircl_jax.preferences import recover

BINS = 25


def draw(result: Result) -> Iterator[Drawing]:
    """Every figure that says something of this run, with its caption. Use within `matplotlib.rc_context(STYLE)`."""
    env, found = result.plan.env, evidence.gather(result)
    yield plots_curves.learning_curves(result)
    if env.layout is not None and env.tabular is not None:
        yield from plots_grid.draw(result, env.layout, env.tabular, found)
        yield from plots_paths.draw(result, env.layout, found)
    elif env.tabular is not None and (env.codes or env.maze) and result.plan.method.learner != "cloning":
        recovered = recover(result, env.tabular)
        if env.codes:
            yield from plots_codes.draw(recovered, env.codes, over_seeds(result))
        if env.maze:
            yield from plots_maze.draw(recovered, env.maze, over_seeds(result))
    elif env.tabular is None:
        yield from plots_steps.draw(result, found)
        if plots_coordinates.is_additive(result):
            yield plots_coordinates.by_coordinate(result, found.policy)
    if result.plan.method.feasibility != "none" and _has_both_labels(result):
        yield reference_histogram(result, found)
    yield plots_curves.losses(result)


def figures(result: Result) -> dict[str, Drawing]:
    """Every figure by its name, for a notebook."""
    with mpl.rc_context(STYLE):
        return {drawing.name: drawing for drawing in draw(result)}


def write_figures(result: Result, directory: Path) -> list[tuple[Path, str]]:
    """Draw into the directory; the files with their captions."""
    directory.mkdir(exist_ok=True)
    written = []
    with mpl.rc_context(STYLE):
        for drawing in draw(result):
            path = directory / f"{drawing.name}.png"
            drawing.figure.savefig(path, dpi=DPI)
            written.append((path, drawing.caption))
    return written


def reference_histogram(result: Result, found: evidence.Evidence) -> Drawing:
    """δ̄ of the reference set's clean and violating trajectories, each label's shares summing to 1 over all seeds."""
    violating = evidence.infeasible(result.reference)
    figure = Figure(figsize=(3.4, 2.3), layout="constrained")
    axis = figure.subplots()
    edges = np.linspace(0, 1, BINS + 1).tolist()
    for label, chosen, colour in (("clean", ~violating, BLUE), ("violating", violating, ORANGE)):
        delta = found.delta_reference[:, chosen].ravel()
        share = 100.0 / delta.size
        axis.hist(delta, edges, weights=np.full(delta.size, share), color=colour, alpha=0.35)
        axis.hist(delta, edges, weights=np.full(delta.size, share), color=colour, histtype="step", lw=1.2)
        axis.plot([], [], color=colour, lw=5, alpha=0.6, label=f"{label} ({chosen.sum()})")
    axis.legend(frameon=False, loc="upper center")
    axis.set(xlim=(0, 1), xlabel=r"feasibility $\bar\delta(\tau)$", ylabel="trajectories of that label (%)")
    caption = (
        f"δ̄ of the reference set's {(~violating).sum()} clean and {violating.sum()} violating trajectories, "
        f"{over_seeds(result)} pooled: AUROC {final(result, 'feasibility_auroc')}, gap of the means "
        f"{final(result, 'feasibility_gap')}."
    )
    return Drawing("feasibility_reference", figure, caption)


def _has_both_labels(result: Result) -> bool:
    """Whether the reference set holds clean and violating trajectories; an unknown cost is neither."""
    return bool(0 < evidence.infeasible(result.reference).mean() < 1)
