"""Train the missing cells of Table 1 and write it beside the paper's: `python -m experiments.table1`.

Finished cells are skipped, and interrupted ones continue. Settings, as NAME=VALUE:

scale       full, or smoke: a few minutes that test the machinery, kept apart from results
env         a comma list of environments, or all
method      a comma list of methods, or all
seeds       number of seeds; 0 takes the scale's own
iterations  number of iterations; 0 takes the environment's own, and the contrast row's own
out         folder of the results
train       false only writes from the cells that exist
overwrite   true trains the chosen cells anew
"""

import shlex
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from aircl_jax.messages import say
from experiments.cli.command import BAD_INPUT, DONE, complain, run_command
from experiments.cli.words import SEEDS, listed, smoke_budget
from experiments.shared.commits import current_commit
from experiments.swap import scores
from experiments.table1 import cells, claims_report, report
from experiments.table1.cells import COLUMNS, ROWS, Job

RESULTS = Path("results")
# One method of each kind, because compiling takes the time.
SMOKE_ON_ROBOTS = ("airl", "aircl", "aircl_corrected", "aircl_contrast", "bc")


@dataclass(frozen=True)
class Settings:
    scale: Literal["full", "smoke"] = "full"
    env: str = "all"
    method: str = "all"
    seeds: int = 0  # 0: the scale's own
    iterations: int = 0
    out: str = "default"
    train: bool = True
    overwrite: bool = False


def main(argv: Sequence[str] | None = None) -> int:
    return run_command(make_table, argv, Settings(), __doc__, then="the same command continues")


def make_table(settings: Settings, words: Sequence[str]) -> int:
    """Train the missing cells and write the table and the claims; return BAD_INPUT where a cell was refused."""
    job = job_of(settings)
    chosen = chosen_cells(settings)
    cells.load(job)  # refuses cells of another scale before anything is trained
    refused = make(job, chosen, settings.overwrite) if settings.train else {}
    write(job, refused, shlex.join(["python", "-m", "experiments.table1", *words]))
    for reason in refused.values():
        complain(reason)
    return BAD_INPUT if refused else DONE


def chosen_cells(settings: Settings) -> list[tuple[str, str]]:
    """List the requested environments and methods; a smoke test of all methods leaves out most robot cells."""
    envs = listed("env", settings.env, COLUMNS)
    methods = listed("method", settings.method, ROWS)
    few = SMOKE_ON_ROBOTS if settings.scale == "smoke" and settings.method == "all" else methods
    return [(env, method) for env in envs for method in (methods if env == "gridworld" else few)]


def job_of(settings: Settings) -> Job:
    """Choose the folders and the budget of the cells. Raises ValueError where short runs could pass for results."""
    if settings.seeds < 0 or settings.iterations < 0:
        raise ValueError(f"seeds={settings.seeds} iterations={settings.iterations}: neither may be negative")
    smoke = settings.scale == "smoke"
    published = RESULTS if settings.out == "default" else Path(settings.out)
    into_results = published.resolve().is_relative_to(RESULTS.resolve())
    if not smoke and into_results and (settings.seeds not in (0, SEEDS) or settings.iterations):
        raise ValueError(
            f"seeds={settings.seeds} iterations={settings.iterations} are not those of the full table (seeds={SEEDS}, "
            f"iterations=0), which is in {published}; choose another folder with out=DIR"
        )
    if smoke and into_results and settings.out != "default":
        raise ValueError(f"out={settings.out}: scale=smoke makes no results; choose a folder outside {RESULTS}")
    out = Path("runs/smoke/table1") if smoke and settings.out == "default" else published
    runs = Path("runs/table1") if out == RESULTS else out / "runs"
    own = smoke_budget() if smoke else {"seeds": SEEDS, "iterations": 0, "train": {}}
    seeds, iterations = settings.seeds or own["seeds"], settings.iterations or own["iterations"]
    return Job(settings.scale, seeds, iterations, out, runs, own["train"])


def make(job: Job, chosen: Sequence[tuple[str, str]], overwrite: bool) -> dict[tuple[str, str], str]:
    """Train the chosen cells that are missing; return {cell: reason} of those that were refused."""
    commit = current_commit()  # of the code that this process has loaded
    refused: dict[tuple[str, str], str] = {}
    with _compiling_fast(job.scale == "smoke"):
        for env, method in chosen:
            if (job.path(env, method).exists() and not overwrite) or cells.unavailable(env):
                continue
            try:
                cells.make_cell(job, env, method, commit, overwrite)
            except ValueError as error:
                refused[env, method] = f"{env}/{method}: {error}"
    return refused


@contextmanager
def _compiling_fast(fast: bool) -> Iterator[None]:
    """Switch off XLA's costlier optimisations if `fast`, for runs that are shorter than their compilation."""
    import jax

    before = jax.config.read("jax_disable_most_optimizations")
    jax.config.update("jax_disable_most_optimizations", fast or before)
    try:
        yield
    finally:
        jax.config.update("jax_disable_most_optimizations", before)


def write(job: Job, refused: dict[tuple[str, str], str], command: str) -> None:
    """Write table1.md, table1.json and claims.md from the cells that exist."""
    finished = cells.load(job)
    absent = {env: cells.unavailable(env) for env in COLUMNS}
    missing = {
        (env, method): refused.get((env, method)) or absent[env] or "not trained yet"
        for env in COLUMNS
        for method in ROWS
        if (env, method) not in finished
    }
    study = cells.Study(job, finished, missing, command, current_commit(), scores.load(job.out / "swap"))
    job.out.mkdir(parents=True, exist_ok=True)
    for name, text in (
        ("table1.md", report.markdown(study)),
        ("table1.json", report.as_json(study)),
        ("claims.md", claims_report.markdown(study)),
    ):
        (job.out / name).write_text(text, encoding="utf-8")
        say(f"wrote {job.out / name}")


if __name__ == "__main__":
    sys.exit(main())
