"""One configuration on bodies and constraints that no setting was chosen on: `python -m experiments.bodies`.

  python -m experiments.bodies worlds=halfcheetah rows=aircl_contrast
  python -m experiments.bodies train=false                              # only writes the page

Settings, as NAME=VALUE: worlds (comma list, or all), rows (comma list, or all), seeds, iterations (0: the row's own), runs
(folder of the runs, which continue where they were cut), out (folder of the cells; the page is beside it), train (false only
writes).
A finished cell is kept as out/WORLD/ROW.json with its commit, and skipped by the next call.
"""

import shlex
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from aircl_jax import train
from aircl_jax.messages import say
from aircl_jax.reports import markdown
from aircl_jax.storage import write_whole
from experiments.cli.command import run_command
from experiments.cli.words import SEEDS, listed, refuse_short_runs
from experiments.shared.commits import current_commit
from experiments.shared.kept_files import keep, read_kept
from experiments.shared.paired_tests import each

RESULTS = "results/bodies"
FIRST_SEED = 130  # of all rows; no setting was chosen on these worlds, and earlier versions were run on 110 to 129
ROWS = ("aircl_contrast", "gacl", "icrl", "bc")  # those with the same settings on every body
LIMIT = "recovered_limit/"
LEAST_RETURN, MOST_VIOLATIONS, LEAST_AUROC, NEAR = 0.9, 0.02, 0.95, 0.15  # what counts as reached
ABOUT = (
    f"Each row's settings are those of every body, seeds {FIRST_SEED} and on, each run once. A seed has reached its targets "
    f"where π earns at least {LEAST_RETURN} of the demonstrations' return, at most {MOST_VIOLATIONS} of its steps violate, "
    f"and the feasibility tells the reference set apart with an AUROC of at least {LEAST_AUROC}. Limits of motors are right "
    f"within {100 * NEAR:.0f} % of the true one, or else off, or not found: one that nothing tempts to cross cannot be."
)
HEAD = (
    "row",
    "seeds within targets",
    "return, of",
    "violating steps",
    "episodes with one",
    "AUROC",
    "limits right, off, not found",
    "minutes",
    "commit",
)


@dataclass(frozen=True)
class World:
    """What is learned from, and the limit that binds each motor on either side, or 0 where the constraint is of states."""

    about: str
    env: str
    settings: Mapping[str, Any] = field(default_factory=dict)
    motor_limit: float = 0.5


WORLDS: Mapping[str, World] = {
    "halfcheetah": World("half-cheetah, |torque| ≤ 0.5", "halfcheetah"),  # only worlds with shipped demonstrations
}


@dataclass(frozen=True)
class Settings:
    worlds: str = "all"
    rows: str = "aircl_contrast"
    seeds: int = SEEDS
    iterations: int = 0
    runs: str = "runs/bodies"
    out: str = RESULTS
    train: bool = True


def main(argv: Sequence[str] | None = None) -> int:
    return run_command(compare, argv, Settings(), __doc__, then="the same command continues")


def compare(settings: Settings, words: Sequence[str]) -> None:
    """Train the cells that are missing, then write the page of all that are there."""
    refuse_short_runs(settings.seeds, settings.iterations, settings.out, RESULTS)
    out, rows = Path(settings.out), listed("row", settings.rows, ROWS)
    for name in listed("world", settings.worlds, tuple(WORLDS)) if settings.train else ():
        for row in rows:
            _cell(settings, name, row)
    places = [(name, row) for name in WORLDS for row in ROWS if (out / name / f"{row}.json").exists()]
    cells = [read_kept(out / name / f"{row}.json", "world", "row", "metrics") for name, row in places]
    write_whole(out.with_suffix(".md"), page(cells, shlex.join(["python", "-m", "experiments.bodies", *words])))
    say(f"wrote {out.with_suffix('.md')}")


def _cell(settings: Settings, name: str, row: str) -> None:
    path, world = Path(settings.out) / name / f"{row}.json", WORLDS[name]
    if path.exists():
        return
    say(f"{row} on {world.about}")
    commit, directory = current_commit(), Path(settings.runs) / name / row
    result = train(
        world.env,
        row,
        seeds=settings.seeds,
        first_seed=FIRST_SEED,
        iterations=settings.iterations or "default",
        env_settings=dict(world.settings),
        run_dir=directory,
        resume=True,
    )
    kept = ("seeds", "iterations", "env_steps", "wall_s", "env_steps_per_s", "metrics")
    keep(path, {"world": name, "row": row, "commit": commit, **{word: result.summary[word] for word in kept}})


def reached(cell: Mapping[str, Any]) -> int:
    """Count the seeds within all targets of π: return, violations, and AUROC where the row has a feasibility."""
    names = ("return", "expert_return", "violation_rate_policy", "feasibility_auroc")
    tells = _mean(cell, "feasibility_auroc") is not None
    count = 0
    for earned, shown, violated, auroc in zip(*(cell["metrics"][name]["per_seed"] for name in names), strict=True):
        if None in (earned, violated) or (tells and auroc is None):
            continue  # a seed with a number that is not finite
        good = earned >= LEAST_RETURN * shown and violated <= MOST_VIOLATIONS
        count += good and (not tells or auroc >= LEAST_AUROC)
    return count


def limits_found(cell: Mapping[str, Any], true: float) -> tuple[int, int, int] | None:
    """Count the limits of motors within 15 % of the true one, those further off, and those not found, over all seeds.

    None where the constraint is not of motors, or the row draws no limits.
    """
    found = [
        (value, true if name.endswith("/upper") else -true)
        for name, row in cell["metrics"].items()
        if name.startswith(f"{LIMIT}motor ")
        for value in row["per_seed"]
    ]
    if not true or not found:
        return None
    drawn = [abs(value - limit) <= NEAR * abs(limit) for value, limit in found if value is not None]
    return sum(drawn), len(drawn) - sum(drawn), len(found) - len(drawn)


def page(cells: Sequence[Mapping[str, Any]], command: str) -> str:
    """Write a section a world: what each row reaches, and every seed."""
    sections = ["# Bodies and constraints that no setting was chosen on", f"`{command}`", ABOUT]
    for name, world in WORLDS.items():
        own = [cell for cell in cells if cell["world"] == name]
        if own:
            table = markdown.table(HEAD, [_row(cell, world) for cell in own])
            sections += [f"## {world.about[0].upper()}{world.about[1:]}", table, *map(_seeds, own)]
    return markdown.paragraphs(*sections)


def _row(cell: Mapping[str, Any], world: World) -> tuple[str, ...]:
    limits = limits_found(cell, world.motor_limit)
    return (
        cell["row"],
        f"{reached(cell)} of {len(cell['seeds'])}",
        f"{_shown(_mean(cell, 'return'), 0)}, {_shown(_mean(cell, 'expert_return'), 0)}",
        f"{_shown(_mean(cell, 'violation_rate_policy'), 2, 100)} %",
        f"{_shown(_mean(cell, 'infeasible_share_policy'), 0, 100)} %",
        _shown(_mean(cell, "feasibility_auroc"), 3),
        "—" if limits is None else ", ".join(map(str, limits)),
        f"{cell['wall_s'] / 60:.0f}",
        cell["commit"],
    )


def _mean(cell: Mapping[str, Any], name: str) -> float | None:
    return cell["metrics"][name]["mean"]


def _shown(value: float | None, digits: int, factor: float = 1.0) -> str:
    return "—" if value is None else f"{factor * value:.{digits}f}"


def _seeds(cell: Mapping[str, Any]) -> str:
    found = {name: row["per_seed"] for name, row in cell["metrics"].items()}
    correlation = found.get("reward_correlation", [])
    of_reward = f"; correlation of f with the reward {each(correlation)}" if set(correlation) - {None} else ""
    returns = " ".join(_shown(value, 0) for value in found["return"])
    return f"`{cell['row']}`, every seed: returns {returns}; violations {each(found['violation_rate_policy'])}{of_reward}."


if __name__ == "__main__":
    sys.exit(main())
