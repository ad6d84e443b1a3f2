"""Learn one constraint from several tasks, beside each task alone: `python -m experiments.tasks env=gridworld`.

  python -m experiments.tasks env=gridworld run_dir=runs/tasks/grid                    # three goals, one set of obstacles
  python -m experiments.tasks env=swimmer backwards=FILE seeds=3 first_seed=120 run_dir=runs/tasks/swimmer

FILE has demonstrations of `python -m experiments.expert env=swimmer env.reward=backwards`. Runs are kept in run_dir/alone and
run_dir/together, a folder for each task, and the same command continues them; the table is run_dir/tasks.md.
"""

import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from aircl_jax import Result, train_tasks
from aircl_jax.analysis.episodes import learned_tables
from aircl_jax.messages import say
from aircl_jax.model.feasibility import FORBIDDEN_BELOW
from aircl_jax.reports import markdown
from aircl_jax.storage import write_whole
from experiments.cli.command import run_command
from experiments.shared.paired_tests import each

Tasks = Mapping[str, Mapping[str, Any]]
GOALS: Tasks = {
    "corner": {"env_settings": {"goal": [5, 5]}},
    "below": {"env_settings": {"goal": [5, 0]}},
    "right": {"env_settings": {"goal": [0, 5]}},
}
ENVS = ("gridworld", "swimmer")
MEASURES = ("violation_rate_policy", "violation_rate_expert", "return", "expert_return", "feasibility_auroc")


@dataclass(frozen=True)
class Settings:
    env: str = "gridworld"
    backwards: str = ""  # file of the swimmer's demonstrations of that reward
    seeds: int = 10
    first_seed: int = 1010
    iterations: int = 0  # 0: the row's own
    run_dir: str = "runs/tasks"


def main(argv: Sequence[str] | None = None) -> int:
    return run_command(learn, argv, Settings(), __doc__, then="the same command continues")


def learn(settings: Settings, _: Sequence[str]) -> None:
    """Train all tasks together and each alone, and write the table."""
    tasks, folder = _tasks(settings), Path(settings.run_dir)
    together = _trained(settings, tasks, folder / "together")
    alone = {name: _trained(settings, {name: own}, folder / "alone")[name] for name, own in tasks.items()}
    written = folder / "tasks.md"
    write_whole(written, table(together, alone))
    say(written.read_text(encoding="utf-8"))


def table(together: Mapping[str, Result], alone: Mapping[str, Result]) -> str:
    """Return a Markdown table: each measure of each task, every seed, together and alone."""
    rows = []
    for name, result in together.items():
        both = [measures(result), measures(alone[name])]
        rows += [(name, measure, each(both[0][measure]), each(both[1][measure])) for measure in both[0]]
    heading = ("task", "measure", f"{len(together)} tasks together", "alone")
    return markdown.paragraphs(markdown.table(heading, rows)) + "\n"


def measures(result: Result) -> dict[str, list[float | None]]:
    """Return each measure of every seed: of π, and of the limits or the cells that δ₁ forbids."""
    found = {name: row["per_seed"] for name, row in result.summary["metrics"].items()}
    chosen = {name: found[name] for name in found if name in MEASURES or name.startswith("recovered_limit/")}
    return chosen | flags(result)


def flags(result: Result) -> dict[str, list[float | None]]:
    """Count the cells that δ₁ forbids and the world allows, and the obstacles that it misses; nothing off a grid."""
    table = result.spec.env.tabular
    if table is None:
        return {}
    forbids = (learned_tables(result.networks, result.states, table).step_delta < FORBIDDEN_BELOW).all(axis=-1)
    true = np.asarray(table.forbidden) > 0
    counts = {"false flags": forbids & ~true, "missed obstacles": ~forbids & true}
    return {name: cells.sum(axis=-1).astype(float).tolist() for name, cells in counts.items()}


def _tasks(settings: Settings) -> Tasks:
    if settings.env not in ENVS:
        raise ValueError(f"env={settings.env} has no tasks here; choose from {', '.join(ENVS)}")
    if settings.env == "gridworld":
        return GOALS
    if not settings.backwards:
        raise ValueError(
            "backwards= is missing: a file of demonstrations, by experiments.expert env=swimmer env.reward=backwards"
        )
    return {
        "forwards": {},
        "backwards": {"env_settings": {"reward": "backwards"}, "demonstrations": settings.backwards},
    }


def _trained(settings: Settings, tasks: Tasks, folder: Path) -> dict[str, Result]:
    say(f"{', '.join(tasks)} in {folder}")
    return train_tasks(
        settings.env,
        tasks,
        "aircl_contrast",
        seeds=settings.seeds,
        first_seed=settings.first_seed,
        iterations=settings.iterations or "default",
        run_dir=folder,
        resume=True,
    )


if __name__ == "__main__":
    sys.exit(main())
