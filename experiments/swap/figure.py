"""Draw the swap table as one picture: rows × tests, blue at 1, the truth."""

from collections.abc import Sequence
from pathlib import Path

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from aircl_jax.figures.style import DPI, STYLE
from experiments.swap.grid_cells import REWARDS
from experiments.swap.robot_tests import TESTS
from experiments.swap.scores import Cells, Score, finished_worlds, grid_score, robot_score, rows_of

GRID_TESTS = (
    ("S0", "self_return", "self_violation"),
    ("S2", "constraint_transfer_return", "constraint_transfer_violation"),
    ("S3", "reward_transfer_return", ""),
    ("S4", "transfer_return", "transfer_violation"),
)
MANY = 0.01  # violations beyond this are printed in red
DARKEST = 1.8  # of the colours: text stays readable on 1


def draw(cells: Cells, order: Sequence[str], path: Path) -> None:
    """Draw one panel of the grids and one of each robot, and write the file."""
    panels = [(name, *panel) for name, panel in _panels(cells, order).items()]
    with mpl.rc_context(STYLE):
        heights = [len(rows) + 1.6 for _, rows, _, _ in panels]
        figure = Figure(figsize=(7.2, 0.6 + 0.3 * sum(heights)), layout="constrained")
        axes = figure.subplots(len(panels), 1, squeeze=False, gridspec_kw={"height_ratios": heights}).ravel()
        for axis, (title, rows, tests, scores) in zip(axes, panels, strict=True):
            _panel(axis, title, rows, tests, scores)
        figure.suptitle("Score by the truth: 1 the oracle, 0 the uniform policy; violations below", fontsize=8)
        figure.savefig(path, dpi=DPI)


def _panels(cells: Cells, order: Sequence[str]) -> dict[str, tuple[list[str], list[str], list[list[Score | None]]]]:
    panels = {}
    rows = rows_of(cells, "gridworld", order)
    if rows:
        kinds = {reward: finished_worlds(cells, reward, rows) for reward in REWARDS}
        kinds = {reward: worlds for reward, worlds in kinds.items() if worlds}
        tests = [f"{reward}\n{name}" for reward in kinds for name, _, _ in GRID_TESTS]
        scores = [
            [grid_score(cells, worlds, measure, row, beside) for worlds in kinds.values() for _, measure, beside in GRID_TESTS]
            for row in rows
        ]
        panels["grids"] = (rows, tests, scores)
    for env, of_env in TESTS.items():
        rows = [row for row in rows_of(cells, env, order) if row != "uniform"]
        if rows:
            scores = [[robot_score(cells, env, test.name, row) for test in of_env] for row in rows]
            panels[env] = (rows, [test.name.replace(" ", "\n") for test in of_env], scores)
    telling = {env: panel for env, panel in panels.items() if set(panel[0]) - {"oracle"}}  # by itself it is 1 everywhere
    return telling or panels


def _panel(axis: Axes, title: str, rows: Sequence[str], tests: Sequence[str], scores: Sequence[Sequence[Score | None]]) -> None:
    values = np.array([[np.nan if score is None else score.mean for score in row] for row in scores])
    axis.imshow(np.clip(values, 0.0, 1.0), cmap="Blues", vmin=0.0, vmax=DARKEST, aspect="auto")
    axis.set_xticks(range(len(tests)), tests)
    axis.set_yticks(range(len(rows)), rows)
    axis.tick_params(length=0)
    axis.xaxis.tick_top()
    axis.set_title(title, loc="left", fontsize=8)
    for (row, column), value in np.ndenumerate(values):
        score = scores[row][column]
        if score is None:
            axis.text(column, row, "–", ha="center", va="center", color="0.6")
            continue
        axis.text(column, row - 0.12, f"{value:.2f}", ha="center", va="center", fontsize=7)
        if np.isfinite(score.violation):
            beside = f"×{score.violation:.2f}" if tests[column] == "S1" else f"{100 * score.violation:.1f} %"
            colour = "firebrick" if score.violation > MANY and tests[column] != "S1" else "0.3"
            axis.text(column, row + 0.27, beside, ha="center", va="center", fontsize=5, color=colour)
    axis.spines[:].set_visible(False)
