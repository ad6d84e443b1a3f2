"""Scores of the swap tests from the cells that are there: 1 is the truth, 0 the uniform policy."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from experiments.shared.kept_files import read_kept
from experiments.shared.paired_tests import interval
from experiments.swap.grid_cells import WORLDS
from experiments.swap.robot_cells import ORACLE, UNIFORM

Cells = Mapping[tuple[str, str, str], Mapping[str, Any]]  # by environment, world or test, and row


class Score(NamedTuple):
    """Mean over seeds with its 95 % bootstrap interval, and violations: a share, or a multiple of the truth's for S1."""

    mean: float
    low: float
    high: float
    violation: float
    seeds: int


def load(out: Path) -> dict[tuple[str, str, str], Mapping[str, Any]]:
    """Read every finished cell below a folder."""
    cells = [read_kept(path, "env", "row") for path in sorted(out.glob("*/*/*.json"))]
    return {(cell["env"], cell.get("world") or cell["test"], cell["row"]): cell for cell in cells}


def rows_of(cells: Cells, env: str, order: Sequence[str]) -> list[str]:
    """List the rows that have a cell of this environment, in the order given; others, as of a run of one's own, follow."""
    present = {row for name, _, row in cells if name == env}
    return [*(row for row in order if row in present), *sorted(present.difference(order))]


def finished_worlds(cells: Cells, reward: str, rows: Sequence[str]) -> list[str]:
    """List the grids of this reward on which every one of the rows has its cell."""
    worlds = [world for world in WORLDS if world.endswith(f", {reward}")]
    return [world for world in worlds if all(("gridworld", world, row) in cells for row in rows)]


def robot_score(cells: Cells, env: str, test: str, row: str) -> Score | None:
    """Average `robot_values` over seeds; None where a cell is missing."""
    values = robot_values(cells, env, test, row)
    if values is None:
        return None
    violation = float(np.mean(cells[env, test, row]["metrics"]["violation_rate"]))
    if test == "S1":
        violation /= float(np.mean(cells[env, test, ORACLE]["metrics"]["violation_rate"]))
    return _score(values, violation)


def robot_values(cells: Cells, env: str, test: str, row: str) -> list[float] | None:
    """(J − J_u) / (J* − J_u) of each seed; of f alone the lift (J − J_c) / (J_free − J_c). None where a cell is missing.

    J*, J_u, J_c and J_free are means over the seeds of the oracle and of the uniform policy.
    """
    cell, best = cells.get((env, test, row)), cells.get((env, test, ORACLE))
    floor = cells.get((env, "S0", ORACLE)) if test == "S1" else cells.get((env, test, UNIFORM))
    if cell is None or best is None or floor is None:
        return None
    low, high = (float(np.mean(one["metrics"]["return"])) for one in (floor, best))
    return [(value - low) / (high - low) for value in cell["metrics"]["return"]]


def grid_score(cells: Cells, worlds: Sequence[str], measure: str, row: str, violation: str = "") -> Score | None:
    """Average a measure over these worlds, seed by seed; None where a cell is missing or the row has no such measure."""
    found = [cells.get(("gridworld", world, row)) for world in worlds]
    present = [cell for cell in found if cell is not None]
    if len(present) < len(worlds) or not present:
        return None
    values = [cell["metrics"][measure] for cell in present]
    if any(value is None for world in values for value in world):
        return None
    beside = [np.mean(cell["metrics"][violation]) for cell in present] if violation else [np.nan]
    return _score(np.mean(np.array(values, float), axis=0).tolist(), float(np.mean(beside)))


def worst_world(cells: Cells, worlds: Sequence[str], row: str) -> float | None:
    """Find the least mean over seeds of any changed world."""
    found = [cells.get(("gridworld", world, row)) for world in worlds]
    if any(cell is None for cell in found) or not found:
        return None
    means = [np.mean([score for score, _ in seeds]) for cell in found if cell for seeds in cell["changed_worlds"].values()]
    return float(min(means))


def _score(values: Sequence[float], violation: float) -> Score:
    ends = interval(values) or (float("nan"), float("nan"))
    return Score(float(np.mean(values)), *ends, violation, len(values))
