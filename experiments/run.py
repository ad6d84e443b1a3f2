"""Train a method on an environment: `python -m experiments.run env=gridworld method=aircl_corrected`; see `--help`."""

import shlex
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from aircl_jax.messages import say, warn
from aircl_jax.recorders.logger import Run as Logged
from aircl_jax.recorders.table import make_loggers
from envs.settings import flatten, updated
from experiments.cli.command import DEFECT, DONE
from experiments.cli.hydra_cli import Composed, launch
from experiments.cli.hydra_settings import RunSettings
from experiments.cli.progress import Reporter
from experiments.cli.tasks import tasks_of

if TYPE_CHECKING:
    from aircl_jax import Result


def main(argv: Sequence[str] | None = None) -> int:
    """Run with these arguments, the command line's by default, and return the exit code; see docs/guide.md."""
    return launch(run, "run", sys.argv[1:] if argv is None else list(argv))


def run(composed: Composed) -> int:
    """Train with composed settings and print from the first line to the last; return DEFECT where a part of the run failed."""
    values = dict(composed.values)
    env_settings, train_settings = values.pop("env"), values.pop("train")
    settings = updated(RunSettings(), values)
    about = flatten({"env": {"name": composed.env, **env_settings}, "train": train_settings})
    loggers = make_loggers(settings.log, Logged(f"{composed.env}/{settings.method}", Path(settings.run_dir), about))

    if isinstance(settings.demonstrations, tuple):
        return _several(composed, settings, env_settings, train_settings)

    from aircl_jax.runs import world

    if settings.distributed:
        world.join()
    elif strangers := world.strangers():
        warn(f"{strangers}; with distributed=true they share the seeds of one run")

    from aircl_jax import train  # computes constants, which must not be before a world is joined

    iterations = f"{settings.iterations} iterations of {settings.seeds} seeds"
    headline = f"{settings.method} on {composed.env}, {iterations}, in {settings.run_dir}"
    recorders = [Reporter(headline), *loggers] if world.is_first() else []
    try:
        result = train(
            env=composed.env,
            env_settings=env_settings,
            config=train_settings,
            command=shlex.join(["python", "-m", "experiments.run", *composed.words]),
            recorders=recorders,
            notes=_notes(composed.env, settings.method, env_settings),
            **{name: value for name, value in vars(settings).items() if name not in ("log", "distributed")},
        )
    finally:
        for recorder in recorders:
            recorder.close()
    if world.is_first():
        _say(result, settings.run_dir)
    return DEFECT if result.defects else DONE


def _several(
    composed: Composed, settings: RunSettings, env_settings: Mapping[str, Any], train_settings: Mapping[str, Any]
) -> int:
    """Train several tasks under one constraint, and print of each what a run of it alone prints."""
    for name, only in (("log", "none"), ("distributed", False), ("contrast_prior", "method")):
        if getattr(settings, name) != only:
            raise ValueError(f"{name} is not for several tasks (demonstrations=[…]); leave it out")
    tasks = tasks_of(settings.demonstrations)

    from aircl_jax import train_tasks

    iterations = f"{settings.iterations} iterations of {settings.seeds} seeds"
    reporter = Reporter(f"{settings.method} on {composed.env}, {', '.join(tasks)}, {iterations}, in {settings.run_dir}")
    try:
        results = train_tasks(
            composed.env,
            tasks,
            settings.method,
            seeds=settings.seeds,
            first_seed=settings.first_seed,
            iterations=settings.iterations,
            run_dir=settings.run_dir,
            env_settings=env_settings,
            config=train_settings,
            resume=settings.resume,
            overwrite=settings.overwrite,
            command=shlex.join(["python", "-m", "experiments.run", *composed.words]),
            recorders=[reporter],
        )
    finally:
        reporter.close()
    for name, result in results.items():
        say(f"\n{name}:")
        _say(result, str(Path(settings.run_dir) / name))
    return DEFECT if any(result.defects for result in results.values()) else DONE


def _say(result: "Result", run_dir: str) -> None:
    """Print what a run has found, and where to read it."""
    from aircl_jax.reports.card import card_of, is_card
    from aircl_jax.reports.card import closing as card_closing
    from aircl_jax.reports.run_report import closing
    from aircl_jax.runs.directory import CARD, PAGE
    from aircl_jax.runs.readers import read_json

    card = read_json(Path(run_dir) / CARD)
    if not (card and is_card(card)) and not result.defects:  # of a run from before cards, or damaged
        card = card_of(result)
    said = closing(result.summary, result.alarms, run_dir)
    say(said + card_closing(card) if card else said)
    page = Path(run_dir) / PAGE
    if page.exists():
        say(f"\nRead it in a browser: {page.resolve().as_uri()}")


def _notes(env: str, method: str, env_settings: Mapping[str, Any]) -> tuple[str, ...]:
    """Say of the meerkats what this method and the behaviour model gain over counting, where the results are kept."""
    from aircl_jax.settings.env_defaults import default_method
    from experiments.shared.kept_gains import gains_over_the_chain

    if env != "meerkat" or env_settings.get("mapping") != "meerkat":
        return ()
    return gains_over_the_chain(default_method(env) if method == "default" else method)


if __name__ == "__main__":
    sys.exit(main())
