"""Train a robot's expert and write its demonstrations: `python -m experiments.expert env=swimmer`; see `--help`."""

import shlex
import sys
from collections.abc import Sequence
from dataclasses import asdict, dataclass, fields, is_dataclass, replace
from pathlib import Path
from typing import Any, Literal

from aircl_jax.experts.config import EXPERTS, GROUP, expert_config
from aircl_jax.settings.lagrangian_config import LagrangianConfig
from aircl_jax.settings.learner_config import LearnerConfig
from envs import ENVS
from envs.options import RobotOptions
from envs.registry import build, options_of
from envs.settings import at_least, plain, updated
from envs.simulators.options import GuestOptions
from experiments.cli.hydra_cli import Composed, launch
from experiments.cli.hydra_settings import QUIET, hydra_node, store

HELP = f"""Train experts and write demonstrations and a reference set.

  python -m experiments.expert env=swimmer
  python -m experiments.expert env=swimmer env.constraint=position run_dir=runs/expert/mine

env          a robot, or brax, playground or gymnasium with env.task; env.NAME=VALUE sets one of its settings.
             {", ".join(EXPERTS)} and tasks of other libraries
             are trained by PPO-Lagrangian, every other task by the learner of the swap tests
seeds        number of experts under the constraint, from first_seed on; free_seeds: number of those without it, which follow
iterations   number of iterations; the learning rate falls to 0 at the last one
run_dir      folder of the run; resume=true continues a run that is there, overwrite=true starts again
episodes     number of demonstrations to write; none of them violates
reference    number of episodes of each of the reference set's seven groups
out          folder of the two files, ENV_CONSTRAINT.npz (ENV_TASK_CONSTRAINT.npz) and …_reference.npz; run_dir by default
train        settings of the learner, as in train.ppo.learning_rate=0.001; default: those of the task

$CONFIG
"""
DEFAULT = "default"
OF_CANDIDATES = ("candidates", "trial")  # an expert's seeds are its candidates


@dataclass(frozen=True)
class ExpertSettings:
    """The settings that belong neither to the environment (env.…) nor to training (train.…)."""

    seeds: int = 4
    first_seed: int = 0
    free_seeds: int = 2
    iterations: int | Literal["default"] = "default"
    run_dir: str = "runs/expert/${hydra:runtime.choices.env}_${env.constraint}"
    episodes: int = 50
    reference: int = GROUP
    out: str = "${run_dir}"
    resume: bool = False
    overwrite: bool = False


def main(argv: Sequence[str] | None = None) -> int:
    """Run with these arguments, the command line's by default, and return the exit code; see docs/guide.md."""
    register()
    return launch(train, "expert", sys.argv[1:] if argv is None else list(argv))


def register() -> None:
    """Put the settings of an expert's training into Hydra's store, beside those of the environments."""
    settings = _all_default(LearnerConfig()) | _all_default(LagrangianConfig())
    node = {
        **asdict(ExpertSettings()),
        "train": {name: value for name, value in settings.items() if name not in OF_CANDIDATES},
        "defaults": _DEFAULTS,
        "hydra": hydra_node("experiments.expert", HELP),
    }
    store("expert", node)


def train(composed: Composed) -> None:
    """Check the settings; then train, measure and choose experts and write their episodes."""
    name, values = composed.env, dict(composed.values)
    able = [known for known, row in ENVS.items() if issubclass(row.options, RobotOptions | GuestOptions)]
    if name not in able:
        raise ValueError(f"env={name} has no expert to train; choose from {', '.join(able)}")
    env_values, train_values = values.pop("env"), values.pop("train")
    settings = updated(ExpertSettings(), values)
    for field in ("seeds", "free_seeds", "episodes", "reference"):
        at_least(field, getattr(settings, field), 1)
    options = options_of(name, env_values)
    env = build(name, options)
    tuned = updated(expert_config(env, options.constraint), _given(train_values), "train")
    if settings.iterations != DEFAULT:
        tuned = updated(tuned, {"iterations": settings.iterations})
    at_least("iterations", tuned.iterations, 1)
    if options.constraint == "none":
        raise ValueError("env.constraint=none: an expert is trained under a constraint, its reference set without; choose one")

    from aircl_jax.runs.opening import existing, open_run
    from experiments.expert.run import Task, run

    words = [word for word in composed.words if not word.startswith(("resume=", "overwrite="))]
    task = Task(
        name="_".join(part for part in (name, getattr(options, "task", ""), options.constraint) if part),
        env=env,
        practice=build(name, _ending(options, tuned.restart)),
        env_settings={"name": name, **plain(asdict(options))},
        config=tuned,
        seeds=settings.seeds,
        free_seeds=settings.free_seeds,
        first_seed=settings.first_seed,
        episodes=settings.episodes,
        reference=settings.reference,
        out=Path(settings.out),
        command=shlex.join(["python", "-m", "experiments.expert", *words]),
    )
    mode = existing(settings.resume, settings.overwrite)
    run(task, open_run(Path(settings.run_dir), task.settings, task.checkpoint_every, mode))


def _ending(options: Any, restart: bool) -> Any:
    """Give the practice world an early end where the expert restarts; some worlds have no other way."""
    return replace(options, terminate=options.terminate or restart) if hasattr(options, "terminate") else options


def _all_default(config: Any) -> dict[str, Any]:
    """Give every field of a configuration the value "default"."""
    values = ((field.name, getattr(config, field.name)) for field in fields(config) if field.name != "iterations")
    return {name: _all_default(value) if is_dataclass(value) else DEFAULT for name, value in values}


def _given(values: dict[str, Any]) -> dict[str, Any]:
    """Drop the fields that were left at "default"."""
    nested = {name: _given(value) if isinstance(value, dict) else value for name, value in values.items()}
    return {name: value for name, value in nested.items() if value not in (DEFAULT, {})}


_DEFAULTS = ["_self_", {"env": "swimmer"}, *QUIET]

if __name__ == "__main__":
    sys.exit(main())
