"""Draw and write the figures of a run: choose those of its world, and δ̄ on the reference set."""

from collections.abc import Callable, Iterator
from functools import cache, partial
from pathlib import Path

import matplotlib as mpl
import numpy as np
from matplotlib.figure import Figure

from aircl_jax.analysis import episodes
from aircl_jax.analysis.coordinate_contributions import contributions, is_additive
from aircl_jax.analysis.recovered import recover
from aircl_jax.defects import Attempts
from aircl_jax.figures import curves
from aircl_jax.figures.animals import behaviour
from aircl_jax.figures.grids import cells, codes, maze, paths
from aircl_jax.figures.robots import coordinate_curves, step_histograms
from aircl_jax.figures.style import BLUE, DPI, ORANGE, STYLE, Drawing, final, over_seeds
from aircl_jax.runs.result import Result
from envs import Codes, Grid, Maze, Tabular

BINS = 25


def draw(result: Result) -> Iterator[Drawing]:
    """Draw every figure that applies to this run, with its caption. Use within `matplotlib.rc_context(STYLE)`."""
    for part in _parts(result):
        yield from part()


def _parts(result: Result) -> list[Callable[[], Iterator[Drawing]]]:
    """List the parts that are drawn one by one, in their order; where one fails the others can still be drawn."""
    evidence = cache(lambda: episodes.gather(result))
    return [
        lambda: iter([curves.learning_curves(result)]),
        lambda: _of_the_world(result, evidence()),
        lambda: _of_the_reference(result, evidence),
        lambda: iter([curves.losses(result)]),
    ]


def _of_the_world(result: Result, evidence: episodes.Evidence) -> Iterator[Drawing]:
    table = result.spec.env.tabular
    if table is not None:
        yield from _of_a_table(result, table, evidence)
        return
    if result.spec.method.is_fitted:
        yield from behaviour.of_a_run(result)
        return
    yield from step_histograms.draw(result, evidence)
    if is_additive(result):
        yield coordinate_curves.by_coordinate(result, contributions(result, evidence.policy))


def _of_the_reference(result: Result, evidence: Callable[[], episodes.Evidence]) -> Iterator[Drawing]:
    if result.spec.method.learns_feasibility and _has_both_labels(result):
        yield reference_histogram(result, evidence())


def _of_a_table(result: Result, table: Tabular, evidence: episodes.Evidence) -> Iterator[Drawing]:
    """Draw a finite world by its view. Cloning learns no reward, so it has no figure of codes or of a maze."""
    learned = not result.spec.method.clones
    match result.spec.env.view:
        case Grid() as grid:
            yield from cells.draw(result, grid, table, evidence)
            yield from paths.draw(result, grid, evidence)
        case Codes() as world if learned:
            yield from codes.draw(recover(result, table), world, over_seeds(result))
        case Maze() as world if learned:
            yield from maze.draw(recover(result, table), world, over_seeds(result))
        case _:
            pass


def figures_of(result: Result) -> dict[str, Drawing]:
    """Draw every figure by its name, for a notebook."""
    with mpl.rc_context(STYLE):
        return {drawing.name: drawing for drawing in draw(result)}


def write_figures(
    result: Result, directory: Path, attempt: Attempts | None = None, stop: Callable[[], None] = lambda: None
) -> list[tuple[Path, str]]:
    """Draw into the directory; return the files with their captions. `stop` is called between the parts.

    With `attempt`, a part that fails costs no other.
    """
    directory.mkdir(exist_ok=True)
    written: list[tuple[Path, str]] = []
    with mpl.rc_context(STYLE):
        for part in _parts(result):
            stop()
            write = partial(_write_part, part, directory, written)
            attempt("a figure", write, None) if attempt else write()
    return written


def _write_part(part: Callable[[], Iterator[Drawing]], directory: Path, written: list[tuple[Path, str]]) -> None:
    for drawing in part():
        path = directory / f"{drawing.name}.png"
        drawing.figure.savefig(path, dpi=DPI)
        written.append((path, drawing.caption))


def reference_histogram(result: Result, evidence: episodes.Evidence) -> Drawing:
    """Draw δ̄ of the reference set's clean and violating trajectories, each label's shares summing to 1 over all seeds."""
    violating = episodes.infeasible(result.reference)
    figure = Figure(figsize=(3.4, 2.3), layout="constrained")
    axis = figure.subplots()
    edges = np.linspace(0, 1, BINS + 1).tolist()
    for label, chosen, colour in (("clean", ~violating, BLUE), ("violating", violating, ORANGE)):
        delta = evidence.delta_reference[:, chosen].ravel()
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
    """Say whether the reference set holds clean and violating trajectories; an unknown cost counts as neither."""
    return bool(0 < episodes.infeasible(result.reference).mean() < 1)
