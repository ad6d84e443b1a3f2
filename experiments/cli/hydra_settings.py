"""Generate the settings that Hydra composes from the library's dataclasses."""

import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass, fields, is_dataclass
from functools import cache
from itertools import product
from typing import Any, Literal

from hydra.core.config_store import ConfigStore

from aircl_jax.methods import METHODS
from aircl_jax.recorders.table import LOGGERS
from aircl_jax.settings.env_defaults import default_config, default_method
from aircl_jax.settings.train_config import TrainConfig
from envs import ENVS
from envs.settings import plain

HELP = f"""Learn a reward, a constraint and a policy from demonstrations.

  python -m experiments.run env=gridworld method=aircl_corrected seeds=10
  python -m experiments.run -m env=gridworld,nonmarkov method=aircl_corrected,airl

env             {", ".join(ENVS)}; env.NAME=VALUE changes a setting of it
method          default (the environment's own), {", ".join(METHODS)}
contrast_prior  method, on or off: Eq. 13 as the method has it, added, or removed
seeds           number of seeds, from first_seed on; seed s is the same run alone and among others
iterations      iterations of training; with resume=true, a larger number extends a run
run_dir         folder of the run; an existing run needs resume=true or overwrite=true
demonstrations  an .npz file, a Minari folder or minari:ID instead of the environment's own; a list learns several tasks
                under one constraint, a folder each: [FILE,{{source: FILE, name: NAME, SETTING: VALUE}}], SETTING of env
distributed     true: the processes that srun, mpirun or the environment started together share the seeds of one run
log             a comma list of {", ".join(LOGGERS)}; or none: metrics are in run_dir/metrics.jsonl in any case
scale           full, or smoke: a run of seconds that tests the machinery
train           learning rates, network sizes and coefficients, as in train.ppo.learning_rate=0.001

All settings, with the values that this command line gives them:

$CONFIG
-m runs every combination of comma-separated values; --cfg job prints the settings alone.
"""


@dataclass(frozen=True)
class RunSettings:
    """The settings that belong neither to the environment (env.…) nor to training (train.…)."""

    method: str = "default"
    contrast_prior: Literal["method", "on", "off"] = "method"
    seeds: int = 10
    first_seed: int = 0
    iterations: int = 250
    run_dir: str = "runs/${hydra:runtime.choices.env}/${method}"
    demonstrations: str | tuple[str | dict, ...] = "default"
    log: str = "none"
    resume: bool = False
    overwrite: bool = False
    distributed: bool = False


DEFAULT_ENV = "gridworld"
QUIET = [{"override hydra/job_logging": "none"}, {"override hydra/hydra_logging": "none"}]  # end of a list of defaults


def hydra_node(app_name: str, template: str) -> dict[str, Any]:
    """Return Hydra's own settings: it leaves no file, stays in the current folder and prints our help."""
    return {
        "run": {"dir": "."},
        "output_subdir": None,
        "job": {"chdir": False},
        "help": {"app_name": app_name, "template": template},
    }


def store(name: str, node: Mapping[str, Any]) -> None:
    """Put the settings of a command into Hydra's store."""
    ConfigStore.instance().store(name=name, node=dict(node))


def register(argv: Sequence[str]) -> None:
    """Put the settings of a run, and of the training that these words name, into Hydra's store.

    Hydra copies the whole store several times a command, for `--help` some sixty times.
    """
    _register_run()
    every = ConfigStore.instance()
    every.repo.pop("train", None)  # of an earlier command in this process
    for env, choice in product(
        _named("env", DEFAULT_ENV, ENVS, argv), _named("method", "default", ("default", *METHODS), argv)
    ):
        method = default_method(env) if choice == "default" else choice
        train = plain(asdict(default_config(env, METHODS[method].settings)))
        node = {"method": method, "iterations": train.pop("iterations"), "train": train}
        every.store(group="train", name=f"{env}_{choice}", node=node, package="_global_")


def _named(group: str, default: str, known: Iterable[str], argv: Sequence[str]) -> list[str]:
    """List the default and what the words name, or all that is known where the words may name it in Hydra's own ways."""
    words = [word for word in argv if re.match(rf"[+~]*{group}(?![.\w])|hydra", word)]
    ours = re.compile(rf"{group}=([\w,]+)|hydra/launcher=\w+|hydra\.sweep\.dir=.*")
    matched = [ours.fullmatch(word) for word in words]
    if not all(matched):
        return list(known)
    named = {name for match in matched if match and match[1] for name in match[1].split(",")}
    return [name for name in known if name == default or name in named]


@cache
def _register_run() -> None:
    every = ConfigStore.instance()
    store("run", {"defaults": _DEFAULTS, **asdict(RunSettings()), "hydra": hydra_node("experiments.run", HELP)})
    for name, row in ENVS.items():
        every.store(group="env", name=name, node=plain(asdict(row.options())))
    every.store(group="method", name="default", node={}, package="_global_")  # it comes with the training's settings
    for method in METHODS:
        every.store(group="method", name=method, node={"method": method}, package="_global_")


def choices(group: str, env: str, command: str) -> list[str]:
    """List the settings of a command within a group, such as "" (the top), "env" or "train.ppo"."""
    node = ConfigStore.instance().repo[f"{command}.yaml"].node
    groups = [name for default in node.defaults if default != "_self_" for name in default if name in GROUPS]
    own = [str(name) for name in node if name not in ("defaults", "hydra")]
    names: dict[str, list[str]] = {"": list(dict.fromkeys([*own, *groups]))}
    names |= _nested("env", ENVS[env].options()) if env in ENVS else {"env": list(ENVS)}
    names |= _nested("train", node["train"] if "train" in node else TrainConfig())
    return names.get(group, names[""])


def _nested(prefix: str, config: Any) -> Mapping[str, list[str]]:
    """List the settings of a dataclass or a mapping, and of each group within it, by the group's name."""
    values = {field.name: getattr(config, field.name) for field in fields(config)} if is_dataclass(config) else dict(config)
    names = {prefix: [name for name in values if name != "iterations"]}
    for name, value in values.items():
        if is_dataclass(value) or isinstance(value, Mapping):
            names |= _nested(f"{prefix}.{name}", value)
    return names


GROUPS = {"env": list(ENVS), "method": ["default", *METHODS], "scale": ["full", "smoke"], "train": []}
_DEFAULTS = [
    "_self_",
    {"env": DEFAULT_ENV},
    {"method": "default"},
    {"train": "${env}_${method}"},
    {"scale": "full"},
    *QUIET,
]
