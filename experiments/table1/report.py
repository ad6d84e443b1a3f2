"""Write Table 1 as Markdown and as JSON: ours beside the paper's, paired tests over seeds, and each cell's provenance."""

import json
from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from aircl_jax.methods import METHODS
from aircl_jax.reports import markdown as md
from aircl_jax.reports.summary import statistics, versions
from experiments.shared.commits import changed_since
from experiments.shared.fresh_seeds import first_seed_of, has_fresh_seeds
from experiments.shared.paired_tests import CONFIDENCE, SIGNIFICANCE, Values, best_or_tied, each, interval
from experiments.shared.paper import PAPER
from experiments.table1.cells import COLUMNS, ROWS, Cell, Study, iterations_of, other_settings
from experiments.table1.convergence import STILL, settled

LEVELS = (0.001, 0.005, 0.01, 0.02, 0.05, 0.1, 0.2, 0.5)  # violation rates of the performance profile


class Measure(NamedTuple):
    """One table of methods × environments; `better` says which values are set in bold."""

    metric: str
    title: str
    better: str  # lower, higher, or neither


FIRST = (
    Measure("rc_acc", "RCAcc: share of the demonstrations with D > ½", "neither"),
    Measure("balanced_acc", "Balanced accuracy of D: demonstrations and fresh samples", "neither"),
    Measure("violation_rate", "Violation rate of q: share of timesteps", "lower"),
    Measure("violation_rate_policy", "Violation rate of π: share of timesteps", "lower"),
)
SECOND = (
    Measure("return_ratio", "Return of π over the expert's", "higher"),
    Measure("feasibility_auroc", "AUROC of δ̄ on the reference set", "higher"),
    Measure("feasibility_gap", "Gap of δ̄: mean of feasible minus mean of infeasible trajectories", "higher"),
    Measure("reward_correlation", "Correlation of f with the true reward", "higher"),
)


def markdown(study: Study) -> str:
    """Return the text of table1.md."""
    parts = [
        *_heading(study),
        *_missing(study),
        *(_measure_table(study, measure) for measure in FIRST),
        "# Further measures",
        *(_measure_table(study, measure) for measure in SECOND),
        _effort_table(study),
        *_profile(study),
        *_provenance(study),
        *_every_seed(study),
        *_alarms(study),
    ]
    return md.paragraphs(*parts)


def as_json(study: Study) -> str:
    """Return the text of table1.json: summaries without curves, the paper's numbers, missing cells and best-or-tied rows."""
    summaries: dict[str, dict[str, Cell]] = {env: {} for env in COLUMNS}
    for (env, method), cell in study.cells.items():
        summaries[env][method] = {name: value for name, value in cell.items() if name not in ("curves", "settings")}
    whole = {
        "scale": study.job.scale,
        "command": study.command,
        "commit": study.commit,
        "versions": versions(),
        "missing": {f"{env}/{method}": reason for (env, method), reason in study.missing.items()},
        "best_or_tied": {
            measure.metric: {env: sorted(bold(study, env, measure)) for env in COLUMNS}
            for measure in (*FIRST, *SECOND)
            if measure.better != "neither"
        },
        "paper": PAPER,
        "cells": summaries,
    }
    return json.dumps(whole, indent=1, ensure_ascii=False, allow_nan=False) + "\n"


def warning(study: Study) -> str:
    """Return the warning that a smoke test's pages begin with."""
    return (
        f"**This tests the machinery and says nothing about the methods**: `scale=smoke`, {study.job.seeds} seeds of "
        f"{study.job.iterations} iterations, of most methods on the grid alone."
    )


def bold(study: Study, env: str, measure: Measure) -> set[str]:
    """Return the methods that are best or tied in one environment."""
    return best_or_tied(study.column(env, measure.metric), measure.better == "lower")


def _heading(study: Study) -> list[str]:
    smoke = study.job.scale == "smoke"
    title = "# Smoke test of Table 1's machinery" if smoke else "# Table 1, ours beside the paper's"
    counts: dict[str, set[int]] = {env: set() for env in COLUMNS}
    for (env, _), cell in study.cells.items():
        counts[env].add(cell["iterations"])
    ran = ", ".join(f"{env} {' or '.join(map(str, sorted(ns)))}" for env, ns in counts.items() if ns) or "none yet"
    seconds = sum(cell["wall_s"] for cell in study.cells.values())
    devices = sorted({cell["versions"]["devices"] for cell in study.cells.values()})
    made = (
        f"`{study.command}`, at commit `{study.commit}`. {len(study.cells)} of {len(COLUMNS) * len(ROWS)} cells, "
        f"{seconds / 3600:.1f} hours together on {' or '.join(devices) or 'no device'}. Iterations: {ran}."
    )
    numbers = (
        f"Ours: mean ± standard deviation over seeds, [{100 * CONFIDENCE:.0f} % bootstrap interval of the mean]; beside it "
        "what the paper prints, mean ± standard deviation. Robots have a transition noise of 0.001 (`env.noise`). — marks an "
        "undefined or missing value, † a method that is given the true reward."
    )
    fat = (
        "**Bold**: the best mean, and every row that a test does not show to be worse (Wilcoxon's signed-rank test over seeds "
        "against the best, or, where they have no seeds in common, exchanging seeds between both rows; Holm's correction over "
        f"the column, p < {SIGNIFICANCE:g}). Nothing is bold where the seeds are too few to show a difference. RCAcc and "
        "balanced accuracy are never bold: where π equals the expert, D is ½ and both are chance. A low violation rate means "
        "little for a policy that does not do the task; see the return."
    )
    return [title, *([warning(study)] if smoke else []), made, numbers, *_own_budgets(study), fat]


def _own_budgets(study: Study) -> list[str]:
    """Say in a sentence of each row with its own iterations and seeds which they are."""
    said = []
    for method in filter(has_fresh_seeds, ROWS):
        budgets = []
        for env in COLUMNS:
            first = first_seed_of(env, method)
            cell = study.cells.get((env, method), {"seeds": range(first, first + study.job.seeds)})
            seeds = f"seeds {min(cell['seeds'])} to {max(cell['seeds'])}"
            budgets.append(f"{env} {iterations_of(study.job, env, method)} iterations, {seeds}")
        said.append(
            f"`{method}` has its own iterations and fresh seeds, none on which its settings were chosen: {'; '.join(budgets)}."
        )
    return said


def _missing(study: Study) -> list[str]:
    if not study.missing:
        return []
    lines = [f"{reason}: {', '.join(places)}" for reason, places in _grouped(study.missing).items()]
    return ["## Missing cells", md.bullets(lines)]


def _grouped(places: Mapping[tuple[str, str], str]) -> dict[str, list[str]]:
    """Return {reason: cells}; an environment all of whose cells share the reason is named once."""
    grouped: dict[str, list[str]] = {}
    for reason in dict.fromkeys(places.values()):
        for env in COLUMNS:
            rows = [method for method in ROWS if places.get((env, method)) == reason]
            if rows:
                grouped.setdefault(reason, []).append(f"{env} (all)" if len(rows) == len(ROWS) else f"{env}: {', '.join(rows)}")
    return grouped


def _measure_table(study: Study, measure: Measure) -> str:
    printed = any(measure.metric in row for row in PAPER["gridworld"].values())
    head = ["method"]
    for env in COLUMNS:
        head += [env, "paper's"] if printed else [env]
    best = {env: bold(study, env, measure) if measure.better != "neither" else set() for env in COLUMNS}
    rows = []
    for method in ROWS:
        row = [name_of(method)]
        for env in COLUMNS:
            text = shown(study.column(env, measure.metric, [method]).get(method))
            row.append(f"**{text}**" if method in best[env] else text)
            if printed:
                row.append(_printed(PAPER[env].get(method, {}).get(measure.metric)))
        rows.append(row)
    return f"## {measure.title}\n\n" + md.table(head, rows)


def name_of(method: str) -> str:
    """Return the method's name, with † where it is given the true reward."""
    return f"`{method}`" + (" †" if METHODS[method].needs_true_reward else "")


def shown(values: Values | None) -> str:
    """Format values as mean ± std [low, high]."""
    if not values:
        return "—"
    row = statistics([np.nan if value is None else value for value in values.values()])
    if row["mean"] is None:
        return "—"
    spread = "" if row["std"] is None else f" ± {row['std']:.3f}"
    bounds = interval(values.values())
    return f"{row['mean']:.3f}{spread}" + (f" [{bounds[0]:.3f}, {bounds[1]:.3f}]" if bounds else "")


def _printed(value: tuple[float, float] | None) -> str:
    return "—" if value is None else f"{value[0]:.3f} ± {value[1]:.3f}"


def _effort_table(study: Study) -> str:
    rows = []
    for method in ROWS:
        row = [name_of(method)]
        for env in COLUMNS:
            cell = study.cells.get((env, method))
            row += [f"{cell['wall_s'] / 60:.1f}", f"{cell['env_steps']:,}", settled(cell)] if cell else ["—"] * 3
        rows.append(row)
    head = ["method", *(text for env in COLUMNS for text in (f"{env}, min", "env steps", "settled"))]
    return (
        "## Wall time, environment steps, and whether the curve has settled\n\n"
        "All seeds together. Settled: the violation rate of π, mean over seeds, differs between the last two quarters of the "
        f"training by no more than its standard deviation over seeds at the end, or than {STILL:g}.\n\n" + md.table(head, rows)
    )


def _profile(study: Study) -> list[str]:
    """Compute the share of all (environment, seed) runs whose violation rate is at most τ."""
    rows = []
    for method in ROWS:
        columns = [study.column(env, "violation_rate_policy", [method]).get(method, {}) for env in COLUMNS]
        runs = [value for values in columns for value in values.values() if value is not None]
        envs = [env for env in COLUMNS if (env, method) in study.cells]
        shares = [f"{np.mean([run <= level for run in runs]):.2f}" for level in LEVELS] if runs else ["—"] * len(LEVELS)
        rows.append([name_of(method), *shares, ", ".join(envs) or "—"])
    head = ["method", *(f"≤ {level:g}" for level in LEVELS), "over the seeds of"]
    return ["## Performance profile: share of runs by violation rate of π", md.table(head, rows)]


def _provenance(study: Study) -> list[str]:
    commits: dict[str, dict[tuple[str, str], str]] = {}
    for place, cell in study.cells.items():
        commits.setdefault(" then ".join(cell["commits"]), {})[place] = ""
    lines = []
    for commit, places in commits.items():
        changed = changed_since(commit.split()[-1])
        state = {True: "the library has changed since", False: "the library is the same today", None: "cannot be compared"}
        lines.append(f"commit `{commit}` ({state[changed]}): {'; '.join(_grouped(places)[''])}")
    differing = other_settings(study.job, study.cells)
    lines += [f"**other settings**, {difference}: {', '.join(places)}" for difference, places in differing.items()]
    example = next(iter(study.cells.values()), None)
    lines += [f"a cell's own command, for instance: `{example['command']}`"] if example else []
    return ["## What the cells were made with", md.bullets(lines) or "No cell is there yet."]


def _every_seed(study: Study) -> list[str]:
    parts = ["## Every seed"]
    for env in COLUMNS:
        lines = []
        for method in ROWS:
            cell = study.cells.get((env, method))
            if cell:
                kinds = (("RCAcc", "rc_acc"), ("q", "violation_rate"), ("π", "violation_rate_policy"))
                seeds = [f"{word} {each(cell['metrics'][metric]['per_seed'])}" for word, metric in kinds]
                lines.append(f"{method}: {'; '.join(seeds)}")
        if lines:
            parts += [f"{env}: RCAcc, violation rates of q and of π", md.bullets(lines)]
    return parts


def _alarms(study: Study) -> list[str]:
    lines = [f"{env}/{method}: {sentence}" for (env, method), cell in study.cells.items() for sentence in cell["alarms"]]
    return ["## Alarms", md.bullets(lines) or "None rang."]
