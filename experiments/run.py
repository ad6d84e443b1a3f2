"""Train a method on an environment: `python -m experiments.run env=gridworld method=aircl_corrected`; see `--help`."""

import json
import shlex
import sys
from collections.abc import Sequence
from pathlib import Path

from envs.settings import updated
from experiments.cli.hydra_cli import Composed, launch
from experiments.cli.hydra_settings import RunSettings
from experiments.cli.progress import Reporter


def main(argv: Sequence[str] | None = None) -> int:
    """Run with these arguments (the command line's by default); 0 done, 2 bad input, 130 interrupted."""
    return launch(run, "run", sys.argv[1:] if argv is None else list(argv))


def run(composed: Composed) -> None:
    """One run with composed settings, from the first line that it prints to the last."""
    values = dict(composed.values)
    env_settings, train_settings = values.pop("env"), values.pop("train")
    settings = updated(RunSettings(), values)

    from aircl_jax import train
    from aircl_jax.reports.card import card_of
    from aircl_jax.reports.card import closing as card_closing
    from aircl_jax.reports.run_report import closing
    from aircl_jax.runs.directory import CARD

    iterations = f"{settings.iterations} iterations of {settings.seeds} seeds"
    reporter = Reporter(f"{settings.method} on {composed.env}, {iterations}, in {settings.run_dir}")
    try:
        result = train(
            env=composed.env,
            env_settings=env_settings,
            config=train_settings,
            command=shlex.join(["python", "-m", "experiments.run", *composed.words]),
            recorders=[reporter],
            **vars(settings),
        )
    finally:
        reporter.close()
    path = Path(settings.run_dir) / CARD
    card = json.loads(path.read_text(encoding="utf-8")) if path.exists() else card_of(result)  # of a run from before cards
    print(closing(result.summary, result.alarms, settings.run_dir) + card_closing(card))


if __name__ == "__main__":
    sys.exit(main())
