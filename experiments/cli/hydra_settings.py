"""The command line's settings as Hydra composes them, generated from the library's dataclasses."""

from collections.abc import Mapping
from dataclasses import asdict, dataclass, fields, is_dataclass
from typing import Any, Literal

from hydra.core.config_store import ConfigStore

from aircl_jax.methods import METHODS
from aircl_jax.settings.env_defaults import default_config
from aircl_jax.settings.train_config import TrainConfig
from envs import ENVS
from envs.settings import plain

HELP = f"""Learns a reward, a constraint and a policy from demonstrations.

  python -m experiments.run env=gridworld method=aircl_corrected seeds=10
  python -m experiments.run -m env=gridworld,nonmarkov method=aircl_corrected,airl

env             {", ".join(ENVS)}; env.NAME=VALUE changes a setting of it
method          {", ".join(METHODS)}
contrast_prior  method, on or off: Eq. 13 as the row has it, added, or taken away
seeds           how many, from first_seed on; seed s is the same run alone and among others
iterations      of training; more of them extend a run with resume=true
run_dir         where everything is kept; a run that is there already needs resume=true or overwrite=true
demonstrations  an .npz file, a Minari folder or minari:ID instead of the environment's own
scale           full, or smoke: a run of seconds that shows that everything works
train           learning rates, network sizes and coefficients, as in train.ppo.learning_rate=0.001

All settings, with the values that this command line gives them:

$CONFIG
-m runs every combination of comma-separated values; --cfg job prints the settings alone.
"""


@dataclass(frozen=True)
class RunSettings:
    """The settings beside those of the environment (env.…) and of training (train.…)."""

    method: str = "aircl_corrected"
    contrast_prior: Literal["method", "on", "off"] = "method"
    seeds: int = 10
    first_seed: int = 0
    iterations: int = 250
    run_dir: str = "runs/${hydra:runtime.choices.env}/${method}"
    demonstrations: str = "default"
    resume: bool = False
    overwrite: bool = False


QUIET = [{"override hydra/job_logging": "none"}, {"override hydra/hydra_logging": "none"}]  # of a list of defaults


def hydra_node(app_name: str, template: str) -> dict[str, Any]:
    """Hydra's own settings: it leaves no file, stays in the folder it is called from, and its help is ours."""
    return {
        "run": {"dir": "."},
        "output_subdir": None,
        "job": {"chdir": False},
        "help": {"app_name": app_name, "template": template},
    }


def store(name: str, node: Mapping[str, Any]) -> None:
    """Put the settings of a command into Hydra's store."""
    ConfigStore.instance().store(name=name, node=dict(node))


def register() -> None:
    """Put the settings of a run, of every environment and its training into Hydra's store."""
    every = ConfigStore.instance()
    store("run", {"defaults": _DEFAULTS, **asdict(RunSettings()), "hydra": hydra_node("experiments.run", HELP)})
    for name, row in ENVS.items():
        every.store(group="env", name=name, node=plain(asdict(row.options())))
        for method in METHODS:
            train = plain(asdict(default_config(name, METHODS[method].settings)))
            node = {"iterations": train.pop("iterations"), "train": train}
            every.store(group="train", name=f"{name}_{method}", node=node, package="_global_")
    for method in METHODS:
        every.store(group="method", name=method, node={"method": method}, package="_global_")


def choices(group: str, env: str) -> list[str]:
    """The settings within a group, such as "" (the top), "env" or "train.ppo"."""
    names: dict[str, list[str]] = {"": [field.name for field in fields(RunSettings)] + ["env", "train", "scale"]}
    names |= _nested("env", ENVS[env].options()) if env in ENVS else {"env": list(ENVS)}
    names |= _nested("train", TrainConfig())
    return names.get(group, names[""])


def _nested(prefix: str, config: Any) -> Mapping[str, list[str]]:
    names = {prefix: [field.name for field in fields(config) if field.name != "iterations"]}
    for field in fields(config):
        if is_dataclass(getattr(config, field.name)):
            names |= _nested(f"{prefix}.{field.name}", getattr(config, field.name))
    return names


GROUPS = {"env": list(ENVS), "method": list(METHODS), "scale": ["full", "smoke"], "train": []}
_DEFAULTS = [
    "_self_",
    {"env": "gridworld"},
    {"method": "aircl_corrected"},
    {"train": "${env}_${method}"},
    {"scale": "full"},
    *QUIET,
]
