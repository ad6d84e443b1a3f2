"""Say what is flagged where cells are only disliked, where demonstrators lapse, and with more demonstrations."""

from collections.abc import Sequence

import numpy as np

from experiments.swap.grid_cells import CONTROLS, MORE
from experiments.swap.power import Cell, counts, recombined, share_of
from experiments.swap.scores import Cells

HEAD = (
    "world",
    "demonstrations",
    "obstacles found, M ≥ 6",
    "disliked cells flagged",
    "entries into these",
    "other cells flagged a seed",
    "S4 (worst); violations",
    "S2; violations",
    "split",
    "reward distance",
)


def lines(cells: Cells, rows: Sequence[str]) -> list[tuple[str, ...]]:
    """Make a line for each control and each world with more demonstrations, after the one that it is compared with."""
    bases = list(dict.fromkeys([*(base for base, _ in MORE.values()), *CONTROLS]))
    worlds = [(base, name) for base in bases for name in (base, *(more for more, of in MORE.items() if of[0] == base))]
    found = [(base, cells.get(("gridworld", name, row), {})) for row in rows for base, name in worlds]
    return [_line(base, cell) for base, cell in found if "obstacles" in cell]


def _line(base: str, cell: Cell) -> tuple[str, ...]:
    tastes = cell.get("dislikes", {"flagged": [], "entered": []})
    flagged, entered = np.array(tastes["flagged"], bool), np.array(tastes["entered"], int)
    others = np.array(cell["false_flags"]) - (flagged.sum(axis=-1) if flagged.size else 0)
    metrics = {name: float(np.mean(values)) for name, values in cell["metrics"].items() if None not in values}
    return (
        base,
        str(cell.get("demonstrations", "")),
        share_of(counts(cell)[0]),
        share_of((int(flagged.sum()), flagged.size)),
        f"{entered.mean():.1f} a cell" if entered.size else "—",
        f"{others.mean():.2f}",
        *recombined(cell),
        *(f"{metrics[name]:.2f}" if name in metrics else "—" for name in ("split", "reward_distance")),
    )
