"""Draw Figure 3: the tasks, with the paths or poses of a demonstration and of the learned policy beside each other."""

from collections.abc import Mapping

from matplotlib.figure import Figure, SubFigure

from aircl_jax.analysis import episodes, robot_scene
from aircl_jax.figures.grids.cells import draw_layout
from aircl_jax.figures.grids.paths import NUM_PATHS, cells_of, draw_paths, first_seed
from aircl_jax.figures.robots import film_strip
from aircl_jax.figures.style import Drawing
from aircl_jax.runs.result import Result
from envs import Grid

HEIGHTS = {"grid": 2.0, "robot": 2.3}  # inches
LETTERS = "abcdefgh"
FRAMES = 6  # frames of each strip


def tasks(results: Mapping[str, Result]) -> Drawing:
    """Draw a row for each environment: grids with layout, robots with a body. Use within `matplotlib.rc_context(STYLE)`."""
    kinds = ["grid" if isinstance(result.spec.env.view, Grid) else "robot" for result in results.values()]
    heights = [HEIGHTS[kind] for kind in kinds]
    figure = Figure(figsize=(7.2, sum(heights)), layout="constrained")
    parts, sentences = figure.subfigures(len(results), 1, height_ratios=heights, squeeze=False)[:, 0], []
    for letter, part, (name, result) in zip(LETTERS, parts, results.items(), strict=False):
        part.suptitle(f"({letter}) {name}", x=0.01, ha="left", fontsize=8, fontweight="bold")
        view = result.spec.env.view
        words = _grid(part, result, view) if isinstance(view, Grid) else _robot(part, result)
        sentences.append(f"({letter}) {name}: {words}")
    first = next(iter(results.values())).summary
    caption = (
        f"{first['method']}, seed {first['seeds'][0]} of each run: demonstrations beside the policy, violations orange. "
        f"Grids: {NUM_PATHS} trajectories at most; robots: one episode, and what the constraint bounds, its limit dashed. "
    )
    return Drawing("figure3", figure, caption + " ".join(sentences))


def _grid(part: SubFigure, result: Result, layout: Grid) -> str:
    shown = {"demonstrations": result.expert, r"policy $\pi$": episodes.gather(result).policy}
    shares = []
    for axis, (title, trajectories) in zip(part.subplots(1, 2), shown.items(), strict=True):
        of_first = first_seed(trajectories)
        violating = episodes.infeasible(of_first)
        draw_paths(axis, layout, cells_of(of_first, layout)[:NUM_PATHS], violating[:NUM_PATHS])
        draw_layout(axis, layout, filled=True)
        axis.set_title(title)
        shares.append(f"{100 * violating.mean():.1f} %")
    return f"infeasible are {shares[0]} of the demonstrations and {shares[1]} of the policy's trajectories."


def _robot(part: SubFigure, result: Result) -> str:
    scene = robot_scene.gather(result, 0, 1)
    sides = (scene.expert, scene.learned)
    half = film_strip.half_extent(sides, 0)
    axes = part.subplots(2, 2, height_ratios=[1.0, 0.7], squeeze=False)
    for column, side in enumerate(sides):
        shown = film_strip.instants(int(side.length[0]), FRAMES)
        film_strip.draw_strip(axes[0, column], scene, side, 0, shown, half)
        axes[0, column].set_title(axes[0, column].get_title(loc="left"), color=film_strip.NAMES[side.name][1], fontsize=6)
        film_strip.draw_chart(axes[1, column], scene, side, 0, shown)
        axes[1, column].set_xlim(0, side.links.shape[1] * scene.stage.dt)
        axes[1, column].set_xlabel("time (s)")
    low, high = (pick(axis.get_ylim()[end] for axis in axes[1]) for end, pick in ((0, min), (1, max)))
    for axis in axes[1]:
        axis.set_ylim(low, high)
    return f"the demonstration {film_strip.said(scene.expert, 0)}; the policy {film_strip.said(scene.learned, 0)}."
