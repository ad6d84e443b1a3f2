"""Measure how well the constraint is recovered: every method on the default grid, four methods on three more grids.

`python -m experiments.recovery` keeps each finished cell in results/recovery/WORLD/METHOD.json with its command and commit.
The next call skips it. `seeds=2 iterations=4 out=DIR` makes a quick pass elsewhere.
"""

import json
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from aircl_jax import METHODS, train
from aircl_jax.messages import say
from aircl_jax.reports import markdown
from envs.layouts import LAYOUTS
from experiments.cli.command import run_command
from experiments.cli.words import SEEDS, refuse_short_runs
from experiments.shared.commits import current_commit
from experiments.shared.fresh_seeds import ON_GRIDS, first_seed_of
from experiments.shared.kept_files import keep, read_kept
from experiments.shared.paired_tests import each, spread

SECOND, THIRD = ([list(cell) for cell in LAYOUTS[name].obstacles] for name in ("second", "third"))
WORLDS: dict[str, tuple[str, Mapping[str, Any]]] = {
    "default": ("gridworld", {}),
    "second layout": ("gridworld", {"obstacles": SECOND}),
    "third layout": ("gridworld", {"obstacles": THIRD}),
    "non-Markov": ("nonmarkov", {}),
}
HEADING = (
    "`python -m experiments.recovery`; mean ± std over seeds, — where undefined. "
    "A cell names the commit of the code that trained it; delete its file to have it trained anew. Seeds are 0 to 9, those of "
    f"the contrast rows {ON_GRIDS} to {ON_GRIDS + SEEDS - 1}: their settings were chosen on other seeds of the default grid."
)
RESULTS = "results/recovery"
UNDEFINED: Mapping[str, Any] = {"per_seed": []}
LEGEND = (
    "violation_rate: share of timesteps, of q; infeasible_share: share of trajectories with a violation, of q; both with "
    "_policy of π. goal_rate: of π; feasibility_auroc and feasibility_gap: δ̄ on the reference set; feasibility_expert: mean "
    "δ̄ of D_E; violation_reward_only: timesteps of the plan for f alone; reward_correlation: f and the true reward on π's "
    "feasible steps; rc_acc: share of D_E with D > ½; balanced_acc: mean of that and of q's share with D < ½."
)
ELSEWHERE = ("aircl_corrected", "airl_centred", "aircl")  # the rows that also run on the other worlds, and a contrast row
ROWS: dict[str, tuple[str, ...]] = {
    # All but those that are fitted to recordings, or practise where actions are of a box.
    "default": tuple(name for name, method in METHODS.items() if not method.is_fitted and not method.practises),
    "second layout": (*ELSEWHERE, "aircl_contrast"),
    "third layout": (*ELSEWHERE, "aircl_contrast"),
    "non-Markov": (*ELSEWHERE, "aircl_contrast_memory"),  # no entry can be counted where a state is not seen whole
}
SHOWN = (
    "violation_rate",
    "violation_rate_policy",
    "infeasible_share",
    "infeasible_share_policy",
    "goal_rate",
    "expert_goal_rate",
    "feasibility_auroc",
    "feasibility_gap",
    "feasibility_expert",
    "violation_reward_only",
    "reward_correlation",
    "rc_acc",
    "balanced_acc",
)


@dataclass(frozen=True)
class Settings:
    seeds: int = SEEDS
    iterations: int = 0  # 0: each row's own
    out: str = RESULTS


def main(argv: Sequence[str] | None = None) -> int:
    return run_command(recover, argv, Settings(), __doc__, then="the same command continues with the missing cells")


def recover(settings: Settings, _: Sequence[str]) -> None:
    """Train the missing cells and write the table."""
    refuse_short_runs(settings.seeds, settings.iterations, settings.out, RESULTS)
    commit = current_commit()  # of the code that this process has loaded
    cells = {(world, method): _cell(settings, world, method, commit) for world in WORLDS for method in ROWS[world]}
    written = Path(settings.out) / "table.md"
    written.write_text(table(cells), encoding="utf-8")
    say(f"wrote {written}")


def _cell(settings: Settings, world: str, method: str, commit: str) -> dict[str, Any]:
    path = Path(settings.out) / world.replace(" ", "_") / f"{method}.json"
    if path.exists():
        return read_kept(path, "metrics", "iterations")
    say(f"training {method} on {world}")
    env, layout = WORLDS[world]
    iterations, first = settings.iterations or "default", first_seed_of(env, method)
    result = train(env, method, seeds=settings.seeds, first_seed=first, env_settings=layout, iterations=iterations)
    overrides = [f"env.{name}={json.dumps(value, separators=(',', ':'))}" for name, value in layout.items()]
    seeds = [f"seeds={settings.seeds}", *([f"first_seed={first}"] if first else [])]
    words = [f"env={env}", f"method={method}", *seeds, *overrides]
    cell = {
        **result.summary,
        "world": world,
        "command": " ".join(["python -m experiments.run", *words]),
        "commit": commit,
        "alarms": result.alarms,
    }
    keep(path, cell)
    return cell


def table(cells: Mapping[tuple[str, str], Mapping[str, Any]]) -> str:
    """Return a Markdown table per world: mean ± standard deviation over seeds, and every seed's two violation rates."""
    lines = ["# Recovery on the grids", "", HEADING, "", LEGEND, ""]
    for world in WORLDS:
        rows = {method: cell for (name, method), cell in cells.items() if name == world}
        if not rows:
            continue
        first = next(iter(rows.values()))
        lines += [f"## {world}", "", f"`{first['command'].replace('method=' + first['method'], 'method=…')}`", ""]
        shown = [
            (method, cell["commit"], cell["iterations"], *(spread(_per_seed(cell, name), 3) for name in SHOWN))
            for method, cell in rows.items()
        ]
        lines += [
            markdown.table(("method", "commit", "iterations", *SHOWN), shown),
            "",
            "Every seed, violation rate of q and of π:",
            "",
        ]
        for method, cell in rows.items():
            seeds = [cell["metrics"][name]["per_seed"] for name in ("violation_rate", "violation_rate_policy")]
            lines.append(f"- {method}: q {each(seeds[0])}; π {each(seeds[1])}")
        rung = [f"- {method}: {sentence}" for method, cell in rows.items() for sentence in cell["alarms"]]
        lines += ["", "Alarms:", "", *(rung or ["none"]), ""]
    return "\n".join(lines) + "\n"


def _per_seed(cell: Mapping[str, Any], metric: str) -> Sequence[float | None]:
    return cell["metrics"].get(metric, UNDEFINED)["per_seed"]


if __name__ == "__main__":
    sys.exit(main())
