"""Train, keep and read the cells of Table 1: one method on one environment each, in results/cells/ENV/METHOD.json."""

import hashlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from importlib import resources
from pathlib import Path
from typing import Any, Literal

import numpy as np

from aircl_jax import train
from aircl_jax.runs.directory import CONFIG
from aircl_jax.runs.spec import RunSpec, make_spec
from aircl_jax.settings.env_defaults import default_config, unnamed_settings
from aircl_jax.settings.renamed import renamed
from envs.settings import flatten
from experiments.cli.progress import Reporter
from experiments.shared.fresh_seeds import first_seed_of, has_fresh_seeds
from experiments.shared.kept_files import keep, read_kept
from experiments.shared.paired_tests import Values
from experiments.shared.paper import COLUMNS, METHODS_OF_THE_PAPER

ROWS = (*METHODS_OF_THE_PAPER, "airl_centred", "aircl_corrected", "aircl_contrast", "bc")
POINTS = 20  # least number of points of a learning curve
CURVES = ("violation_rate", "violation_rate_policy", "rc_acc", "balanced_acc", "return", "feasibility_gap")
KEPT = (
    *("seeds", "scale", "command", "commit", "commits", "settings", "alarms", "curves.iteration"),
    *(f"metrics.{name}.per_seed" for name in CURVES),
)

Cell = Mapping[str, Any]
Cells = Mapping[tuple[str, str], Cell]  # by env and method


@dataclass(frozen=True)
class Job:
    """Settings that all cells of a table share. `iterations` 0 means the environment's own."""

    scale: Literal["full", "smoke"]
    seeds: int
    iterations: int
    out: Path
    runs: Path
    config: Mapping[str, Any] = field(default_factory=dict)

    def path(self, env: str, method: str) -> Path:
        return self.out / "cells" / env / f"{method}.json"

    def run_dir(self, env: str, method: str) -> Path:
        return self.runs / env / method


@dataclass(frozen=True)
class Study:
    """Input of a table: the finished cells, the reason for each missing one, and the cells of the swap test beside them."""

    job: Job
    cells: Cells
    missing: Mapping[tuple[str, str], str]
    command: str
    commit: str
    swap: Mapping[tuple[str, str, str], Cell] = field(default_factory=dict)

    def column(self, env: str, metric: str, methods: Sequence[str] = ROWS) -> dict[str, Values]:
        """Return {method: {seed: value}} of the finished cells."""
        row = {method: self.cells.get((env, method)) for method in methods}
        return {method: values(cell, metric) for method, cell in row.items() if cell is not None}


def iterations_of(job: Job, env: str, method: str) -> int:
    """Return the iterations of a row: its own settings', or the longer of the paper's and our earlier settings'."""
    settings = ("contrast",) if has_fresh_seeds(method) else ("paper", "tuned")
    return job.iterations or max(default_config(env, name).iterations for name in settings)


def chunk_of(iterations: int) -> int:
    """Return the longest chunk that divides the iterations into at least POINTS; 1 where there are fewer iterations."""
    return max((n for n in range(1, iterations + 1) if iterations % n == 0 and iterations // n >= POINTS), default=1)


def arguments(job: Job, env: str, method: str) -> Mapping[str, Any]:
    """Return the arguments of `train` for this cell."""
    iterations = iterations_of(job, env, method)
    config = {**job.config, "checkpoint_every": chunk_of(iterations)}
    seeds = {"seeds": job.seeds, "first_seed": first_seed_of(env, method)}
    return {"env": env, "method": method, **seeds, "iterations": iterations, "config": config}


def command(job: Job, env: str, method: str) -> str:
    """Return the command line that makes this cell's run alone."""
    chosen = arguments(job, env, method)
    settings = [f"train.{name}={value}" for name, value in flatten(chosen["config"]).items()]
    words = [f"{name}={value}" for name, value in chosen.items() if name != "config"]
    return " ".join(["python -m experiments.run", *words, *settings, f"run_dir={job.run_dir(env, method)}"])


def spec_of(job: Job, env: str, method: str) -> RunSpec:
    """Return the checked run of this cell."""
    rest: dict[str, Any] = {"contrast_prior": "method", "demonstrations": "default", "env_settings": {}}
    return make_spec(**arguments(job, env, method), **rest)


def settings_of(spec: RunSpec) -> dict[str, Any]:
    """Return what a cell's numbers depend on beside the code: the run's settings, digests of shipped demonstrations."""
    name = spec.env.shipped_demonstrations
    files = [resources.files("envs") / "demonstrations" / f"{part}.npz" for part in (name, f"{name}_reference")]
    digests = [hashlib.sha256(file.read_bytes()).hexdigest()[:16] for file in files] if name else []
    return {**spec.settings, "shipped": digests}


def unavailable(env: str) -> str | None:
    """Return the reason why an environment can have no cells; None where it can."""
    from envs import make_env

    return None if make_env(env).expert is not None else "no demonstrations are shipped for this environment"


def make_cell(job: Job, env: str, method: str, commit: str, overwrite: bool = False) -> Cell:
    """Train the cell's run, or continue it where it was cut, and keep the cell.

    Raises ValueError where the directory holds a run with other settings.
    """
    spec, directory = spec_of(job, env, method), job.run_dir(env, method)
    chosen = arguments(job, env, method)
    if overwrite:
        job.path(env, method).unlink(missing_ok=True)  # so that the next call continues a cut run and does not skip it
    commits = _commits(directory, commit, overwrite)
    reporter = Reporter(f"{method} on {env}, {chosen['iterations']} iterations of {job.seeds} seeds, in {directory}")
    line = command(job, env, method)
    try:
        result = train(
            **chosen, run_dir=directory, resume=not overwrite, overwrite=overwrite, command=line, recorders=[reporter]
        )
    finally:
        reporter.close()
    cell = {
        **result.summary,
        "scale": job.scale,
        "command": line,
        "commit": commit,
        "commits": commits,
        "settings": settings_of(spec),
        "alarms": result.alarms,
        "curves": curves(result.history, spec.config.checkpoint_every),
    }
    keep(job.path(env, method), cell)
    return cell


def _commits(directory: Path, commit: str, overwrite: bool) -> list[str]:
    """Record and return the commits at which a run was trained, this one last; they are kept beside its directory."""
    path = directory.with_name(f"{directory.name}.commits")
    begun = not overwrite and (directory / CONFIG).exists() and path.exists()
    earlier = [line for line in path.read_text(encoding="utf-8").split() if line != commit] if begun else []
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text("\n".join([*earlier, commit]) + "\n", encoding="utf-8")
    return [*earlier, commit]


def curves(history: Mapping[str, np.ndarray], chunk: int) -> dict[str, list]:
    """Thin the history to its evaluations: {"iteration": [P], NAME: [P, S]}; iteration 0 is the untrained policy's batch."""
    iterations = len(next(iter(history.values())))
    rows = list(range(chunk - 1, iterations, chunk))
    done = [row + 1 for row in rows]
    if chunk > 1:  # the first row is the batch before the first update, which is no evaluation
        rows, done = [0, *rows], [0, *done]
    thinned: dict[str, list] = {"iteration": done}
    for name in CURVES:
        if name in history:
            thinned[name] = [[_short(value) for value in history[name][row]] for row in rows]
    return thinned


def _short(value: float) -> float | None:
    return float(f"{value:.4g}") if np.isfinite(value) else None


def load(job: Job) -> dict[tuple[str, str], Cell]:
    """Read the finished cells of this table. Raises ValueError where a cell is of another scale."""
    paths = {(env, method): job.path(env, method) for env in COLUMNS for method in ROWS}
    cells: dict[tuple[str, str], Cell] = {place: read_kept(path, *KEPT) for place, path in paths.items() if path.exists()}
    for place, cell in cells.items():
        if cell["scale"] != job.scale:
            raise ValueError(f"{paths[place]} is of scale={cell['scale']}; choose another folder with out=DIR")
    return cells


def other_settings(job: Job, cells: Cells) -> dict[str, list[str]]:
    """Compare the cells' settings with those of this table; return {difference: the cells that have it}.

    A cell that does not name a setting is older than the setting and gets the value that stands for the earlier behaviour.
    """
    differences: dict[str, list[str]] = {}
    for (env, method), cell in cells.items():
        here, there = flatten(settings_of(spec_of(job, env, method))), flatten(renamed(cell["settings"]))
        before = unnamed_settings(env)
        for name in here | there:
            then = there.get(name, before.get(name))
            if here.get(name) != then:
                difference = f"{name} is {then} there and {here.get(name)} here"
                differences.setdefault(difference, []).append(f"{env}/{method}")
    return differences


def values(cell: Cell, metric: str) -> Values:
    """Return {seed: value} at the end of training.

    `return_ratio` is the return divided by the expert's, where the expert's is positive.
    """
    if metric == "return_ratio":
        both = zip(*(cell["metrics"][name]["per_seed"] for name in ("return", "expert_return")), strict=True)
        ratios = [None if own is None or not expert or expert <= 0 else own / expert for own, expert in both]
        return dict(zip(cell["seeds"], ratios, strict=True))
    per_seed = cell["metrics"].get(metric, {}).get("per_seed", [None] * len(cell["seeds"]))
    return dict(zip(cell["seeds"], per_seed, strict=True))
