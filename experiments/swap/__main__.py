"""The swap test: freeze what was learned, recombine it, train anew: `python -m experiments.swap`.

Settings, as NAME=VALUE: worlds (swimmer, pendulum, walker; comma lists, or all), rows (oracle, uniform, random, names of
methods, and "NAME as it is" for a learned policy without further training; comma lists, or all), seeds (of every row but the
oracle), oracle_seeds, iterations (0: the learner's own), out and runs (folders), train (false: only write from the cells
that are there). A finished cell is skipped; what was cut continues.
"""

import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from experiments.cli.command import run_command
from experiments.cli.words import listed

RESULTS = "results/swap"
WORLDS = ("swimmer", "pendulum", "walker")
ROWS = (
    "oracle",
    "uniform",
    "random",
    "airl_centred",
    "aircl_corrected",
    "aircl_corrected as it is",
    "bc as it is",
)


@dataclass(frozen=True)
class Settings:
    worlds: str = "swimmer"
    rows: str = "all"
    seeds: int = 3
    oracle_seeds: int = 10
    iterations: int = 0
    out: str = RESULTS
    runs: str = "runs/swap"
    train: bool = True


def main(argv: Sequence[str] | None = None) -> int:
    return run_command(swap, argv, Settings(), __doc__, then="the same command goes on with the cell that was cut")


def swap(settings: Settings, words: Sequence[str]) -> None:
    """Make the cells that are missing."""
    from experiments.swap import robot_cells
    from experiments.swap.robot_tests import TESTS

    worlds, rows = listed("worlds", settings.worlds, WORLDS), listed("rows", settings.rows, ROWS)
    study = robot_cells.Study(
        Path(settings.out), Path(settings.runs), settings.oracle_seeds, settings.seeds, settings.iterations
    )
    for world in worlds:
        for row in rows:
            for test in TESTS[world]:
                if robot_cells.applies(row, test):
                    robot_cells.cell(study, world, row, test)


if __name__ == "__main__":
    sys.exit(main())
