"""Test the contrast row against every other row, in each column of the grids: which differences the seeds can show."""

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from experiments.shared.paired_tests import SIGNIFICANCE, holm, paired_p, unpaired_p
from experiments.swap.grid_cells import CONTRAST, ORACLE, REWARDS
from experiments.swap.scores import Cells, finished_worlds

COLUMNS = {
    "S0": "self_return",
    "S2": "constraint_transfer_return",
    "S3": "reward_transfer_return",
    "S4": "transfer_return",
}
HEAD = ("reward", "row", "layouts", "seeds", *COLUMNS)


class Difference(NamedTuple):
    """Ours less another row's, of the mean over layouts of one column."""

    reward: str
    row: str
    column: str
    layouts: tuple[str, ...]
    seeds: int  # of the other row
    paired: bool  # by seed, hence by demonstrations
    mean: float
    p: float


def lines(cells: Cells, rows: Sequence[str]) -> list[tuple[str, ...]]:
    """Make a line for each reward and other row, with Holm's correction within a column; none where ours is not there."""
    others = [row for row in rows if not row.startswith(CONTRAST)]
    made = []
    for reward in REWARDS:
        found, adjusted = [], {}
        for column in COLUMNS:
            of_column = [one for row in others if (one := _difference(cells, reward, row, column))]
            found += of_column
            adjusted |= dict(zip([one[:3] for one in of_column], holm([one.p for one in of_column]), strict=True))
        for row in others:
            of_row = {one.column: one for one in found if one.row == row}
            if of_row:
                first = next(iter(of_row.values()))
                shown = [
                    _shown(of_row[column], adjusted[reward, row, column]) if column in of_row else "—" for column in COLUMNS
                ]
                seeds = f"the same {first.seeds}" if first.paired and row != ORACLE else str(first.seeds)
                made.append((reward, row, ", ".join(first.layouts), seeds, *shown))
    return made


def _difference(cells: Cells, reward: str, row: str, column: str) -> Difference | None:
    worlds = finished_worlds(cells, reward, [CONTRAST, row])
    ours, other = (_by_seed(cells, worlds, name, COLUMNS[column]) for name in (CONTRAST, row))
    if not ours or not other:
        return None
    paired = row == ORACLE or ours.keys() == other.keys()  # the oracle is the same for all
    values = np.array(list(ours.values())), np.array([other.get(seed, next(iter(other.values()))) for seed in ours])
    p = paired_p(values[0] - values[1]) if paired else unpaired_p(list(ours.values()), list(other.values()))
    mean = float(values[0].mean() - np.mean(list(other.values())))
    layouts = tuple(world.partition(",")[0] for world in worlds)
    return Difference(reward, row, column, layouts, len(other), paired, mean, p)


def _by_seed(cells: Cells, worlds: Sequence[str], row: str, measure: str) -> dict[int, float]:
    """Average a row's measure over worlds, seed by seed; empty where it is undefined or the cells have not the same seeds."""
    found: list[Mapping[str, Any]] = [cells["gridworld", world, row] for world in worlds]
    if not found or any(cell["seeds"] != found[0]["seeds"] for cell in found):
        return {}
    values = [cell["metrics"][measure] for cell in found]
    if any(value is None for world in values for value in world):
        return {}
    return dict(zip(found[0]["seeds"], np.mean(np.array(values, float), axis=0).tolist(), strict=True))


def _shown(one: Difference, p: float) -> str:
    """Write the difference, bold where the seeds show it, with its p after Holm's correction."""
    mean = f"{one.mean:+.3f}"
    return f"{f'**{mean}**' if p < SIGNIFICANCE else mean} (p {p:.3f})"
