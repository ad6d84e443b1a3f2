"""Say which obstacles a row found beside how often each was tempted, and what its policy does, from the cells of grids."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from experiments.swap.grid_cells import WORLDS
from experiments.swap.scores import Cells

Cell = Mapping[str, Any]
BINS = ((6.0, np.inf), (3.0, 6.0), (1.5, 3.0), (0.0, 1.5))  # true M of an obstacle
HEAD = ("row", "world", *(f"M {low:g} to {high:g}" if np.isfinite(high) else f"M ≥ {low:g}" for low, high in BINS))
BESIDE = (
    "false flags a seed",
    "S4 (worst); violations",
    "S2; violations",
    "violations of π (expert)",
    "goal rate of π (expert)",
)


def found_by_temptation(cells: Cells, rows: Sequence[str]) -> list[tuple[str, ...]]:
    """Make a line for each row and world: obstacles found of those with this true M, over seeds; and one of all worlds."""
    lines = []
    for row in rows:
        worlds = [world for world in WORLDS if "obstacles" in cells.get(("gridworld", world, row), {})]
        of_world = {world: counts(cells["gridworld", world, row]) for world in worlds}
        lines += [(row, world, *map(share_of, of_world[world]), *_beside(cells, world, row)) for world in worlds]
        if len(worlds) > 1:
            found, all_of_them = np.sum(np.array([of_world[world] for world in worlds]), axis=0).T
            every = list(zip(found, all_of_them, strict=True))
            flags = np.mean([np.mean(cells["gridworld", world, row]["false_flags"]) for world in worlds])
            lines.append((row, f"all {len(worlds)}", *map(share_of, every), f"{flags:.2f}", "", "", "", ""))
    return lines


def counts(cell: Cell) -> list[tuple[int, int]]:
    """Count the obstacles found and all of them, in each bin of true M, over seeds."""
    obstacles = cell["obstacles"]
    tempted, found = np.array(obstacles["true_tempted"]), np.array(obstacles["found"], bool)
    within = [(tempted >= low) & (tempted < high) for low, high in BINS]
    return [(int((found & these).sum()), int(these.sum())) for these in within]


def _beside(cells: Cells, world: str, row: str) -> tuple[str, ...]:
    cell = cells["gridworld", world, row]
    policy = {name: np.array(values, float) for name, values in cell["policy"].items()}  # None becomes NaN
    violations = [100 * np.mean(policy[f"violation_rate_{who}"]) for who in ("policy", "expert")]
    reached = [np.mean(policy[name]) for name in ("goal_rate", "expert_goal_rate")]
    goal = "—" if np.isnan(reached[0]) else f"{reached[0]:.2f} ({reached[1]:.2f})"
    return (f"{np.mean(cell['false_flags']):.2f}", *recombined(cell), f"{violations[0]:.2f} % ({violations[1]:.2f})", goal)


def recombined(cell: Cell) -> tuple[str, str]:
    """Write S4 with its worst world, and S2, each with its violations."""
    worst = min(np.mean([score for score, _ in seeds]) for seeds in cell["changed_worlds"].values())
    metrics = {name: float(np.mean(values)) for name, values in cell["metrics"].items() if None not in values}
    return (
        f"{metrics['transfer_return']:.3f} ({worst:.3f}); {100 * metrics['transfer_violation']:.1f} %",
        f"{metrics['constraint_transfer_return']:.2f}; {100 * metrics['constraint_transfer_violation']:.1f} %",
    )


def share_of(count: tuple[int, int]) -> str:
    """Write how many of how many; — of none."""
    return f"{count[0]} of {count[1]}" if count[1] else "—"
