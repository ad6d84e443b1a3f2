"""The swap test: freeze what was learned, recombine it, plan or train anew: `python -m experiments.swap`.

Settings, as NAME=VALUE: run_dir (a run to test by itself, with the oracle beside it; its cells go to RUN_swap), or worlds
(gridworld, swimmer, pendulum, walker; comma lists, or all) and rows (oracle, uniform, random, names of methods, and "NAME as it
is" for a learned policy without further training; comma lists, or all; on the swimmer aircl_contrast has its controls too);
seeds (of every row but the oracle; the contrast rows have at least ten), oracle_seeds, iterations (of training; 0: each one's
own), out and runs (folders), train (false: only write from the cells that are there). A finished cell is skipped; what was cut
continues with the next call.
"""

import shlex
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from aircl_jax.messages import say
from envs.settings import at_least
from experiments.cli.command import run_command
from experiments.cli.words import listed
from experiments.swap.robot_tests import TESTS

RESULTS = "results/swap"
WORLDS = ("gridworld", *TESTS)
ROWS = (
    "oracle",
    "uniform",
    "random",
    "bc",
    "gacl",
    "icrl",
    "airl_centred",
    "aircl_corrected",
    "aircl_contrast",
    "aircl_contrast planned",
    "aircl_contrast as it is",
    "aircl_corrected as it is",
    "bc as it is",
)
ROWS_OF_GRIDS = tuple(row for row in ROWS if row != "uniform" and not row.endswith("as it is"))

ONLY_ON_GRIDS = ("aircl_contrast planned",)


@dataclass(frozen=True)
class Settings:
    run_dir: str = ""
    worlds: str = "all"
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
    """Make the cells that are missing, then write the table and the figure."""
    if settings.run_dir:
        _of_a_run(settings, shlex.join(["python", "-m", "experiments.swap", *words]))
        return
    worlds, rows = listed("worlds", settings.worlds, WORLDS), listed("rows", settings.rows, ROWS)
    for name, least in (("seeds", 1), ("oracle_seeds", 1), ("iterations", 0)):
        at_least(name, getattr(settings, name), least)
    fewer = settings.seeds < Settings.seeds or settings.oracle_seeds < Settings.oracle_seeds
    if Path(settings.out).resolve() == Path(RESULTS).resolve() and (settings.iterations or fewer):
        given = " ".join(f"{name}={getattr(settings, name)}" for name in ("seeds", "oracle_seeds", "iterations"))
        raise ValueError(f"{given}: {RESULTS} has whole runs; choose out=DIR")
    if settings.train:
        for world in worlds:
            _grids(settings, rows) if world == "gridworld" else _robot(settings, world, rows)
    from experiments.swap import report

    for path in report.write(Path(settings.out), shlex.join(["python", "-m", "experiments.swap", *words])):
        say(f"wrote {path}")


def _of_a_run(settings: Settings, command: str) -> None:
    """Print a grid run's measures; of a robot's, make the cells of its method, of the oracle and of the uniform policy."""
    from aircl_jax import load
    from aircl_jax.reports.markdown import table
    from aircl_jax.reports.summary import SWAP_MEANINGS, statistics
    from aircl_jax.transfer.grid import of_a_grid
    from experiments.swap import report, robot_cells

    result = load(settings.run_dir)
    env, method = result.spec.env.name, result.spec.method_name
    if measures := of_a_grid(result.spec, result.networks, result.states):
        rows = [(name, *map(_short, statistics(values)["per_seed"]), SWAP_MEANINGS[name]) for name, values in measures.items()]
        say(table(("measure", *(f"seed {seed}" for seed in result.summary["seeds"]), "what"), rows, aligned=True))
        return
    if env not in TESTS or result.spec.env.shipped_demonstrations is None:
        raise ValueError(f"run_dir={settings.run_dir} is neither on a grid nor on a shipped task; choose one that is")
    out = Path(f"{settings.run_dir.rstrip('/')}_swap")
    study = robot_cells.Study(out, out, settings.seeds, settings.seeds, settings.iterations, result)
    for row in ("oracle", "uniform", method, f"{method} as it is"):
        for test in TESTS[env]:
            if robot_cells.applies(row, test):
                robot_cells.cell(study, env, row, test)
    for path in report.write(out, command):
        say(f"wrote {path}")


def _short(value: float | None) -> str:
    return "—" if value is None else f"{value:.3g}"


def _grids(settings: Settings, rows: Sequence[str]) -> None:
    from experiments.swap import grid_cells

    study = grid_cells.GridStudy(Path(settings.out), settings.seeds, settings.iterations)
    for row in rows:
        for world in grid_cells.worlds_of(row) if row in ROWS_OF_GRIDS else ():
            grid_cells.cell(study, world, row)


def _robot(settings: Settings, world: str, rows: Sequence[str]) -> None:
    from experiments.swap import robot_cells, robot_controls

    study = robot_cells.Study(
        Path(settings.out), Path(settings.runs), settings.oracle_seeds, settings.seeds, settings.iterations
    )
    for row in rows:
        for test in TESTS[world]:
            if row not in ONLY_ON_GRIDS and robot_cells.applies(row, test):
                robot_cells.cell(study, world, row, test)
        for name in robot_controls.CONTROLS if row == robot_cells.CONTRAST and world in robot_controls.WORLDS else ():
            robot_controls.cell(study, world, row, name)


if __name__ == "__main__":
    sys.exit(main())
