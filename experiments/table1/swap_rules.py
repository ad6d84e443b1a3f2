"""Judge a claim from the kept cells of the swap test: what fresh policies earn and violate on what a row has learned."""

from collections.abc import Iterator, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from experiments.shared.paired_tests import interval
from experiments.swap.grid_cells import REWARDS
from experiments.swap.robot_tests import TESTS
from experiments.swap.scores import Cells, finished_worlds, robot_values
from experiments.table1.cells import Study
from experiments.table1.claim_rules import Finding, Verdict, of_enough_seeds

GRID = "gridworld"
EARNED = {  # of a grid, by test
    "S0": "self_return",
    "S1": "lift",
    "S2": "constraint_transfer_return",
    "S3": "reward_transfer_return",
    "S4": "transfer_return",
}
VIOLATED = {"S0": "self_violation", "S2": "constraint_transfer_violation", "S4": "transfer_violation"}
RULE = (
    "Holds: the bootstrap interval of the mean over seeds keeps the limit. Does not hold: the mean does not keep it. Cannot be "
    "told: the mean keeps it and the interval does not. 1 is what the same learner earns on the truth, a mean over its seeds "
    "that is taken as known; S1 is the lift. A test of several bodies is averaged over them seed by seed, one on grids over "
    "layouts. Violations are shares of timesteps on robots, on grids shares of episodes less those of the truth's plan."
)


Line = tuple[str, list[float] | None]  # what it is of, and a value a seed: none where undefined, None where cells are missing


class Transfer(NamedTuple):
    """Rule that fresh policies on what a row has learned earn at least a share of what the truth's earn, in each world."""

    row: str
    test: str  # a name of one test, or the beginning of several
    least: Mapping[str, float]
    tempted: float = 0.0  # on grids, of layouts and seeds whose obstacles all have at least this true M

    def findings(self, study: Study) -> list[Finding]:
        lines = []
        for env, least in self.least.items():
            for where, values in self._values(study.swap, env):
                what = f"{where}: share of what the truth earns ≥ {least:.2f}"
                lines.append(_finding(env, what, values, least, most=False))
        return lines

    def _values(self, cells: Cells, env: str) -> Iterator[Line]:
        if env == GRID:
            yield from _of_grids(cells, self.row, self.test, EARNED, self.tempted)
            return
        found = [robot_values(cells, env, test, self.row) for test in names_of(env, self.test)]
        present = [values for values in found if values is not None]
        yield self.test, _average(present) if len(present) == len(found) else None


class Violation(NamedTuple):
    """Rule that fresh policies on what a row has learned violate no more than a limit, in each world and test."""

    row: str
    tests: tuple[str, ...]
    most: Mapping[str, float]
    tempted: float = 0.0

    def findings(self, study: Study) -> list[Finding]:
        lines = []
        for env, most in self.most.items():
            for where, values in self._values(study.swap, env):
                what = f"{where}: violations ≤ {100 * most:g} %"
                lines.append(_finding(env, what, values, most, most=True))
        return lines

    def _values(self, cells: Cells, env: str) -> Iterator[Line]:
        for test in self.tests:
            if env == GRID and test in VIOLATED:
                yield from _of_grids(cells, self.row, test, VIOLATED, self.tempted)
            for name in names_of(env, test) if env != GRID else ():
                cell = cells.get((env, name, self.row))
                yield name, None if cell is None else list(cell["metrics"]["violation_rate"])


def names_of(env: str, test: str) -> list[str]:
    """List the tests of a robot that have this name or begin with it."""
    return [one.name for one in TESTS[env] if one.name == test or one.name.startswith(f"{test} ")]


def _of_grids(cells: Cells, row: str, test: str, measures: Mapping[str, str], tempted: float) -> Iterator[Line]:
    """Yield a line for each reward: its words, and each seed's mean over the layouts on which the measure is defined."""
    for reward in REWARDS:
        by_seed: dict[int, list[float]] = {}
        worlds = finished_worlds(cells, reward, [row])
        counted = 0  # layouts
        for world in worlds:
            cell = cells[GRID, world, row]
            metric = cell["metrics"][measures[test]]
            places = [place for place in range(len(metric)) if _least_tempted(cell, place) >= tempted]
            if None in metric or not places:
                continue
            counted += 1
            for place in places:
                by_seed.setdefault(cell["seeds"][place], []).append(metric[place])
        values = [float(np.mean(seed)) for seed in by_seed.values()] if worlds else None
        yield f"{test}, reward={reward}, {counted} layouts", values


def _least_tempted(cell: Mapping[str, Any], place: int) -> float:
    """Return the least true M of a seed's obstacles."""
    return min(cell["obstacles"]["true_tempted"][place])


def _average(found: Sequence[Sequence[float]]) -> list[float]:
    return np.mean(np.array(found), axis=0).tolist()


def _finding(env: str, what: str, values: Sequence[float] | None, limit: float, most: bool) -> Finding:
    if not values:
        return Finding(env, what, "—", "cannot be told", "cells missing: swap test" if values is None else "undefined")
    mean, bounds = float(np.mean(values)), interval(values)
    scale, digits = (100, " %") if most else (1, "")
    spread = f" [{scale * bounds[0]:.3f}, {scale * bounds[1]:.3f}]" if bounds else ""
    measured = f"{scale * mean:.3f}{spread}{digits}, {len(values)} seeds"
    keeps = [value <= limit if most else value >= limit for value in (mean, *(bounds or (mean, mean)))]
    verdict: tuple[Verdict, str] = "holds", ""
    if not keeps[0]:
        verdict = "does not hold", ""
    elif not all(keeps):
        verdict = "cannot be told", "the interval reaches beyond"
    return of_enough_seeds(Finding(env, what, measured, *verdict), len(values))
