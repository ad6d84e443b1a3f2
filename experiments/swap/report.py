"""Write swap.md, swap.json and swap.png beside the folder of cells."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from aircl_jax.reports import markdown
from experiments.shared.kept_files import keep
from experiments.swap import against, controls, power, robot_controls
from experiments.swap.figure import draw
from experiments.swap.grid_cells import PLANNED, REWARDS
from experiments.swap.robot_tests import TESTS
from experiments.swap.scores import Cells, Score, finished_worlds, grid_score, load, robot_score, rows_of, worst_world

ORDER = (
    "oracle",
    "aircl_contrast",
    "aircl_contrast planned",
    "aircl_corrected",
    "airl_centred",
    "gacl",
    "icrl",
    "random",
    "uniform",
    "bc",
    "aircl_contrast as it is",
    "aircl_corrected as it is",
    "bc as it is",
)
MEASURES = (  # of a grid: title, measure, violations beside it
    ("S0 self", "self_return", "self_violation"),
    ("S2 other rewards + δ", "constraint_transfer_return", "constraint_transfer_violation"),
    ("S3 f + other obstacles", "reward_transfer_return", ""),
    ("S4 changed worlds", "transfer_return", "transfer_violation"),
)
ALONE = (  # of f alone and of δ alone: no scores, so without violations beside them
    ("S1 violations of f alone ÷ r alone", "lift_violation"),
    ("split", "split"),
    ("reward distance", "reward_distance"),
    ("cells found", "constraint_recall"),
    ("of the flagged, true", "constraint_precision"),
)
ABOUT = """What was learned is frozen, recombined, and a policy is made anew from scratch: planned exactly on grids, trained on
robots, without demonstrations, discriminator or clone. 1 is what the same learner earns on the true reward and constraint, 0
what the uniform policy earns. A reward and a constraint are separately right where a row is near 1 in every column without
more violations than the truth. Brackets hold 95 % bootstrap intervals over seeds, — a test that was not run."""
GRIDS = """Means over the layouts on which every row is finished, three seeds (`random`: ten draws;
`aircl_contrast`: ten fresh seeds). Violations, after the
score, are shares of episodes less those of the truth's plan. Of rows that learn no f (`bc`, `gacl`, `icrl`)
the policy acts as it is. Changed worlds are
three other starts, wind .2, slip .2, two walls, twice the horizon, and three of these together."""
APART = "Here 1 is right for `S1` and `split` (below 1, f holds the constraint), 0 for the distance (.71 is unrelated)."
POWER = """True M is how often the demonstrators, from where they were, would have entered the obstacle had it alone been
ordinary to them: below about 2 nothing can be known of it. Obstacles found, of all with that M, are counted over seeds."""
AGAINST = """`aircl_contrast` less the other row, of the means over the layouts that both have; in bold where p < 5 % after
Holm's correction over the rows of a column, as in table1.md. Rows with the same ten seeds, and the oracle, are compared pair by
pair (Wilcoxon); rows with seeds of their own by exchanging seeds between both: of three, no p is below 2/286 = .007."""
CONTROLLED = f"""`{PLANNED}` on the default layout, ten fresh seeds: more demonstrations, cells that are only disliked (by 3
temperatures a step, in place of the obstacles), and demonstrators that lapse (a share of their actions is uniformly random,
into obstacles too). The other contrast row learns the same."""
ROBOTS = """Violations, after the score, are shares of timesteps. `S1` is the lift: 0 is the return under the constraint, 1 that
of r alone; its violations are a multiple of those of r alone. Fresh policies have seeds 9000 and on (the
walker's 9800), those without a constraint 9300 and on; a learned seed serves one fresh seed."""


LIMITED = """Demonstrations of experts by the learner of the swap tests, on the true reward. A limit is listed with its mean
over the seeds that draw it, whose number is in brackets. Without a constraint none is right."""


def write(out: Path, command: str) -> list[Path]:
    """Write the three files from the cells that are there; none where there is no cell."""
    cells = load(out)
    if not cells:
        return []
    words, numbers, picture = (out.with_suffix(suffix) for suffix in (".md", ".json", ".png"))
    words.write_text(markdown_of(cells, command, picture.name), encoding="utf-8")
    keep(numbers, as_json(cells, command))
    draw(cells, ORDER, picture)
    return [words, numbers, picture]


def markdown_of(cells: Cells, command: str, picture: str) -> str:
    """Write the report."""
    parts = ["# The swap test", f"`{command}`", ABOUT, f"![Every row and test]({picture})"]
    rows = rows_of(cells, "gridworld", ORDER)
    if rows:
        parts += ["## Grids", GRIDS]
        for reward in REWARDS:
            worlds = finished_worlds(cells, reward, rows)
            parts += [f"### reward={reward}: {_layouts(worlds)}", _grid_table(cells, worlds, rows)]
        parts += ["### Apart", APART]
        for reward in REWARDS:
            worlds = finished_worlds(cells, reward, rows)
            parts += [f"reward={reward}: {_layouts(worlds)}", _apart_table(cells, worlds, rows)]
        found = power.found_by_temptation(cells, rows)
        if found:
            parts += ["### Who found what", POWER, markdown.table((*power.HEAD, *power.BESIDE), found)]
        tested = against.lines(cells, rows)
        if tested:
            parts += ["### Against every other row", AGAINST, markdown.table(against.HEAD, tested)]
        controlled = controls.lines(cells, [PLANNED])
        if controlled:
            parts += ["### Controls", CONTROLLED, markdown.table(controls.HEAD, controlled)]
    for env, tests in TESTS.items():
        rows = [row for row in rows_of(cells, env, ORDER) if row != "uniform"]
        if rows:
            legend = markdown.bullets(f"{test.name}: {test.about}" for test in tests)
            head = ("row", *(test.name for test in tests))
            body = [
                (row, *(_shown(robot_score(cells, env, test.name, row), multiple=test.name == "S1") for test in tests))
                for row in rows
            ]
            parts += [f"## {env}", ROBOTS, legend, markdown.table(head, body), "Returns of every seed of the oracle:"]
            parts.append(markdown.table(("test", "returns", "violations"), _oracle_rows(cells, env)))
        if controlled := robot_controls.lines(cells, env, rows):
            parts += ["### Controls", LIMITED, markdown.table(robot_controls.HEAD, controlled)]
    commits = sorted({cell["commit"] for cell in cells.values()})
    return markdown.paragraphs(*parts, f"Cells were made at {', '.join(commits)}.")


def as_json(cells: Cells, command: str) -> dict:
    """Collect the metrics of every cell."""
    tree: dict = {}
    for (env, world, row), cell in cells.items():
        tree.setdefault(env, {}).setdefault(world, {})[row] = {
            name: cell[name] for name in ("seeds", "metrics", "changed_worlds", "commit") if name in cell
        }
    return {"command": command, "cells": tree}


def _grid_table(cells: Cells, worlds: Sequence[str], rows: Sequence[str]) -> str:
    head = ("row", *(title for title, _, _ in MEASURES), "S4 worst")
    body = []
    for row in rows:
        scores = [_shown(grid_score(cells, worlds, measure, row, beside)) for _, measure, beside in MEASURES]
        worst = worst_world(cells, worlds, row)
        body.append((row, *scores, "—" if worst is None else f"{worst:.2f}"))
    return markdown.table(head, body)


def _apart_table(cells: Cells, worlds: Sequence[str], rows: Sequence[str]) -> str:
    head = ("row", *(title for title, _ in ALONE))
    body = [(row, *(_plain(grid_score(cells, worlds, measure, row)) for _, measure in ALONE)) for row in rows]
    return markdown.table(head, body)


def _layouts(worlds: Sequence[str]) -> str:
    names = [world.partition(",")[0] for world in worlds]
    return f"layout{'s' if len(names) != 1 else ''} {', '.join(names)}" if names else "no layout is finished"


def _oracle_rows(cells: Cells, env: str) -> list[tuple[str, str, str]]:
    rows = []
    for test in TESTS[env]:
        cell = cells.get((env, test.name, "oracle"))
        if cell is not None:
            metrics = cell["metrics"]
            returns = " ".join(f"{value:.0f}" for value in metrics["return"])
            rows.append((test.name, returns, " ".join(f"{100 * value:.2f} %" for value in metrics["violation_rate"])))
    return rows


def _plain(score: Score | None) -> str:
    return "—" if score is None else f"{score.mean:.2f}"


def _shown(score: Score | None, multiple: bool = False) -> str:
    if score is None:
        return "—"
    spread = f" [{score.low:.2f}, {score.high:.2f}]" if np.isfinite(score.low) else ""
    violation = f"×{score.violation:.2f}" if multiple else f"{100 * score.violation:.2f} %"
    beside = f"; {violation}" if np.isfinite(score.violation) else ""
    return f"{score.mean:.2f}{spread}{beside}"
