"""Train a method on an environment: `python -m experiments.run env=gridworld method=aircl_corrected`; see `--help`."""

import shlex
import sys
from collections.abc import Sequence
from typing import Any, cast

from aircl_jax import runtime

runtime.prepare()  # before anything imports jax

from hydra.core.hydra_config import HydraConfig  # noqa: E402
from omegaconf import DictConfig, OmegaConf  # noqa: E402

from aircl_jax.settings import updated  # noqa: E402
from experiments import cli  # noqa: E402
from experiments.progress import Reporter  # noqa: E402
from experiments.settings import RunSettings  # noqa: E402


def main(argv: Sequence[str] | None = None) -> int:
    """Run with these arguments (the command line's by default); 0 done, 2 bad input, 130 interrupted."""
    arguments = sys.argv[1:] if argv is None else list(argv)

    def task(config: DictConfig) -> None:
        command = shlex.join(["python", "-m", "experiments.run", *HydraConfig.get().overrides.task])
        run(config, command)

    return cli.launch(task, "run", arguments)


def run(config: DictConfig, command: str) -> None:
    """One run with composed settings, from the first line that it prints to the last."""
    values = cast(dict[str, Any], OmegaConf.to_container(config, resolve=True))
    env, env_settings, train_settings = HydraConfig.get().runtime.choices["env"], values.pop("env"), values.pop("train")
    settings = updated(RunSettings(), values)

    from aircl_jax import report, train

    iterations = f"{settings.iterations} iterations of {settings.seeds} seeds"
    reporter = Reporter(f"{settings.method} on {env}, {iterations}, in {settings.run_dir}")
    try:
        result = train(
            env=env,
            env_settings=env_settings,
            config=train_settings,
            command=command,
            on_progress=reporter,
            **vars(settings),
        )
    finally:
        reporter.close()
    print(report.closing(result.summary, result.alarms, settings.run_dir))


if __name__ == "__main__":
    sys.exit(main())
