"""The learner on the true reward and constraint, from scratch: `python -m experiments.learner`.

Settings, as NAME=VALUE: tasks (comma list, or all), unit (the reward is multiplied by it), seeds (0: ten), first_seed,
iterations (0: the learner's own), out (a folder). A finished cell is kept as out/TASK_UNIT.json with its commit, and skipped
by the next call; out.md has the table. beside=brax trains Brax's PPO too, on half-cheetah and hopper with the true reward
alone, three seeds: it needs the extra `brax`, and keeps its cells in results/learner_brax.
"""

import shlex
import sys
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import Any, Literal

import jax
import numpy as np
from jax.tree_util import Partial
from jaxtyping import Array

from aircl_jax import make_env
from aircl_jax.analysis.gait import gait_of
from aircl_jax.messages import say
from aircl_jax.reports import markdown
from aircl_jax.settings.learner_config import learner_config
from aircl_jax.transfer.fresh import Fresh, episodes
from aircl_jax.transfer.objectives import Part, objective, world_cost
from aircl_jax.transfer.swap import EPISODE_SEED, recombine
from aircl_jax.types import Trajectory
from envs.settings import at_least
from experiments.cli.command import run_command
from experiments.cli.words import SEEDS, listed, refuse_short_runs
from experiments.learner.beside import Budget, compare, steps_of
from experiments.shared.commits import current_commit
from experiments.shared.kept_files import keep, read_kept

RESULTS = "results/learner"
BESIDE_RESULTS, BESIDE_SEEDS = "results/learner_brax", 3


@dataclass(frozen=True)
class Task:
    """What is trained, and what counts as reached: a return, and violations of at most 0.1 % under a constraint."""

    env: str
    about: str
    target: float
    settings: Mapping[str, Any] = field(default_factory=dict)
    constrained: bool = True


TASKS: Mapping[str, Task] = {
    "swimmer": Task("swimmer", "forward, torque limit 0.5", 90.0),
    "mirrored": Task("swimmer", "the same, front motor mirrored", 90.0, {"body": {"gears": {"front": -1.0}}}),
    "backwards": Task("swimmer", "backwards, torque limit 0.5", 90.0, {"reward": "backwards"}),
    "alone": Task("swimmer", "forward, no constraint", 140.0, constrained=False),
}
MOST_VIOLATIONS = 1e-3


@dataclass(frozen=True)
class Settings:
    tasks: str = "all"
    unit: float = 1.0
    seeds: int = 0  # 0: ten, and three beside another learner
    first_seed: int = 9200  # no seed that a setting was chosen on
    iterations: int = 0
    out: str = RESULTS
    beside: Literal["", "brax"] = ""


def main(argv: Sequence[str] | None = None) -> int:
    return run_command(learn, argv, Settings(), __doc__, then="the same command goes on with the cell that was cut")


def learn(settings: Settings, words: Sequence[str]) -> None:
    """Train the cells that are missing, then write the table of all that are there."""
    if settings.beside:
        _beside(settings, words)
        return
    settings = replace(settings, seeds=settings.seeds or SEEDS)
    refuse_short_runs(settings.seeds, settings.iterations, settings.out, RESULTS)
    chosen = listed("task", settings.tasks, tuple(TASKS))
    if settings.unit <= 0:
        raise ValueError(f"unit={settings.unit:g}: the reward is multiplied by it; choose a number above 0")
    for name in chosen:
        _cell(settings, name)
    cells = [read_kept(path) for path in sorted(Path(settings.out).glob("*.json"))]
    written = Path(settings.out).with_suffix(".md")
    written.write_text(table(cells, shlex.join(["python", "-m", "experiments.learner", *words])), encoding="utf-8")
    say(f"wrote {written}")


def _beside(settings: Settings, words: Sequence[str]) -> None:
    """Compare with a known implementation, by fewer seeds. Raises ValueError for shorter runs in the folder of the results."""
    seeds = at_least("seeds", settings.seeds, 0) or BESIDE_SEEDS
    if settings.unit != 1.0:
        raise ValueError(f"unit={settings.unit:g} is of our own tasks; leave it out beside {settings.beside}")
    out = Path(BESIDE_RESULTS if settings.out == RESULTS else settings.out)
    at_least("iterations", settings.iterations, 0)
    if (seeds != BESIDE_SEEDS or settings.iterations) and out.resolve() == Path(BESIDE_RESULTS).resolve():
        raise ValueError(f"seeds={seeds} iterations={settings.iterations}: choose out=DIR beside {BESIDE_RESULTS}")
    budget = Budget(range(settings.first_seed, settings.first_seed + seeds), settings.iterations, out)
    compare(settings.tasks, budget, words)


def _cell(settings: Settings, name: str) -> None:
    unit = settings.unit
    path = Path(settings.out) / f"{name}_{unit:g}.json"
    if path.exists():
        return
    task = TASKS[name]
    say(f"{name}, reward × {unit:g}: {task.about}")
    world, commit = make_env(task.env, **task.settings), current_commit()
    config = learner_config(world, constrained=task.constrained)
    if settings.iterations:
        config = replace(config, iterations=settings.iterations)
    seeds = range(settings.first_seed, settings.first_seed + settings.seeds)
    started, busy = time.perf_counter(), time.process_time()
    swapped = recombine(world, objective(in_unit(unit), world_cost()), seeds, config, task.constrained)
    spent = {"wall_s": time.perf_counter() - started, "cpu_s_per_seed": (time.process_time() - busy) / len(seeds)}
    if not isinstance(swapped.made, Fresh):
        raise TypeError(f"{name} is a task of a robot")
    drawn = episodes(swapped.made, world, 16, jax.random.key(EPISODE_SEED))
    of_seed = [jax.tree.map(lambda leaf, i=i: leaf[i], drawn) for i in range(len(seeds))]
    made = {
        "task": name,
        "about": task.about,
        "unit": unit,
        "target": task.target,
        "constrained": task.constrained,
        "seeds": list(seeds),
        "commit": commit,
        "env_steps_per_seed": steps_of(config, world.horizon),
        **{word: round(value, 1) for word, value in spent.items()},
        "metrics": swapped.metrics,
        "gait": [[round(value, 3) for value in gait_of(world, one)] for one in of_seed],
    }
    keep(path, made)


def in_unit(unit: float) -> Part:
    """Pay the world's reward in another unit."""
    return Partial(partial(_in_unit, unit))


def _in_unit(unit: float, trajectory: Trajectory) -> Array:
    return unit * trajectory.reward


def reached(cell: Mapping[str, Any]) -> list[bool]:
    """Say of each seed whether it reached the task's return, and kept its constraint where it has one."""
    metrics = cell["metrics"]
    pairs = zip(metrics["return"], metrics["violation_rate"], strict=True)
    return [earned >= cell["target"] and (not cell["constrained"] or broken <= MOST_VIOLATIONS) for earned, broken in pairs]


def table(cells: Sequence[Mapping[str, Any]], command: str) -> str:
    """Write one line a cell, and the gaits of the seeds that missed the target."""
    rows, missed = [], []
    for cell in cells:
        metrics, hits = cell["metrics"], reached(cell)
        rows.append(
            (
                cell["about"],
                f"{cell['unit']:g}",
                f"{sum(hits)} of {len(hits)} ≥ {cell['target']:g}",
                f"{np.mean(metrics['return']):.1f}",
                " ".join(f"{value:.0f}" for value in metrics["return"]),
                f"{100 * max(metrics['violation_rate']):.3f} %",
                f"{cell['cpu_s_per_seed']:.0f}",
                cell["commit"],
            )
        )
        shown = zip(cell["seeds"], metrics["return"], cell["gait"], hits, strict=True)
        missed += [
            (cell["task"], f"{cell['unit']:g}", seed, f"{earned:.1f}", *(f"{value:.2f}" for value in gait))
            for seed, earned, gait, hit in shown
            if not hit
        ]
    head = ("task", "reward ×", "reached", "mean return", "every seed", "most violations", "CPU s a seed", "commit")
    gaits = ("task", "reward ×", "seed", "return", "front (rad)", "rear (rad)", "frequency (Hz)", "rear's lag (cycles)")
    return markdown.paragraphs(
        "# The learner on the true reward and constraint, from scratch",
        f"`{command}`; a target under a constraint needs at most {MOST_VIOLATIONS:.1%} violating steps as well.",
        markdown.table(head, rows),
        "Seeds that missed, and how they swim:",
        markdown.table(gaits, missed) if missed else "None.",
    )


if __name__ == "__main__":
    sys.exit(main())
