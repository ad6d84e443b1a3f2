"""All that determines a run's numbers, put together and checked before anything is computed or written."""

import hashlib
from collections.abc import Mapping
from dataclasses import asdict, dataclass, fields, is_dataclass, replace
from pathlib import Path
from typing import Any, Literal

import numpy as np

from aircl_jax import demonstrations as files
from aircl_jax.config import TrainConfig, default_config
from aircl_jax.methods import Method, get_method
from aircl_jax.settings import plain, updated
from aircl_jax.types import Trajectory
from envs import ENVS, Env, make_env

SHARES = ("discount", "gae_lambda", "replay_rate", "sampled_coef", "false_alarms")  # numbers between 0 and 1
COUNTS_FROM_ZERO = ("warm_start", "waiting", "annealing")
POSITIVE = ("sharpness", "threshold", "ratio_clip")  # numbers of which 0 is none
BOUNDLESS = ("log_std_init", "log_std_min", "log_std_max", "cost_budget")  # numbers of either sign


@dataclass(frozen=True)
class Plan:
    """A checked run: `own` holds the user's demonstrations, None where the environment's own are used."""

    env: Env
    env_settings: Mapping[str, Any]
    method_name: str
    method: Method
    contrast_prior: str
    seeds: tuple[int, ...]
    config: TrainConfig
    source: str
    own: Trajectory | None

    @property
    def settings(self) -> dict[str, Any]:
        """As config.yaml holds them, and as a resumed run must repeat them."""
        config = plain(asdict(self.config))
        return {
            "env": {"name": self.env.name, **plain(self.env_settings)},
            "method": self.method_name,
            "contrast_prior": self.contrast_prior,
            "seeds": len(self.seeds),
            "first_seed": self.seeds[0],
            "iterations": config.pop("iterations"),
            "demonstrations": {"source": self.source, "sha256": _digest(self.own)} if self.own else "default",
            "train": config,
        }

    @property
    def env_steps(self) -> int:
        """Environment steps of one iteration, of the trajectories that enter an update, over all seeds."""
        pool = self.config.pool if self.method.sampled_from == "pool" else 1
        return len(self.seeds) * self.config.num_trajectories * pool * self.env.horizon


def make_plan(
    env: str | Env,
    method: str,
    *,
    contrast_prior: Literal["method", "on", "off"],
    seeds: int,
    first_seed: int,
    iterations: int | Literal["default"],
    demonstrations: str | Path,
    env_settings: Mapping[str, Any],
    config: TrainConfig | Mapping[str, Any],
) -> Plan:
    """Resolve names, defaults and files. Raises ValueError, in one line, for whatever does not fit."""
    world, options = (env, env_settings) if isinstance(env, Env) else _named_env(env, env_settings)
    name = env.name if isinstance(env, Env) else env
    row = get_method(method, contrast_prior)
    if not isinstance(config, TrainConfig):
        config = updated(default_config(name, row.settings), config, "train")
    if iterations != "default":
        config = replace(config, iterations=_at_least("iterations", iterations, 1))
    _check_config(config, "train")
    count, first = _at_least("seeds", seeds, 1), _at_least("first_seed", first_seed, 0)
    own = None if demonstrations == "default" else files.load(demonstrations, world)
    unknown = not world.has_reward if own is None else np.isnan(own.reward).any()
    if row.needs_true_reward and "contrast" in row.terms and unknown:
        whose = f"env={name}" if own is None else f"demonstrations={demonstrations}"
        raise ValueError(f"{whose}: reward is missing, which the contrast prior of {method} compares")
    return Plan(
        env=world,
        env_settings=options,
        method_name=method,
        method=row,
        contrast_prior=contrast_prior,
        seeds=tuple(range(first, first + count)),
        config=config,
        source=str(demonstrations),
        own=own,
    )


def planned(settings: Mapping[str, Any]) -> Plan:
    """The plan whose `settings` these are. Raises ValueError where a world or a file of then is not known now."""
    env, demonstrations = dict(settings["env"]), settings["demonstrations"]
    plan = make_plan(
        env.pop("name"),
        settings["method"],
        demonstrations=demonstrations if demonstrations == "default" else demonstrations["source"],
        env_settings=env,
        config=settings["train"],
        **{name: settings[name] for name in ("contrast_prior", "seeds", "first_seed", "iterations")},
    )
    if plan.settings["demonstrations"] != demonstrations:
        raise ValueError(f"demonstrations={plan.source} is not the file that the run had: its content has changed")
    return plan


def _named_env(name: str, settings: Mapping[str, Any]) -> tuple[Env, dict[str, Any]]:
    if name not in ENVS:
        raise ValueError(f"unknown env {name!r}; choose from {', '.join(ENVS)}")
    options = updated(ENVS[name].options(), settings, "env")
    values = {field.name: getattr(options, field.name) for field in fields(options)}
    return make_env(name, **values), values


def _at_least(name: str, value: Any, smallest: int) -> int:
    if type(value) is not int or value < smallest:
        raise ValueError(f"{name}={value} is not an integer of at least {smallest}")
    return value


def _check_config(config: Any, prefix: str) -> None:
    """Counts are positive, rates are not negative, shares are at most 1, networks have a layer."""
    for field in fields(config):
        name, value = f"{prefix}.{field.name}", getattr(config, field.name)
        if is_dataclass(value):
            _check_config(value, name)
        elif isinstance(value, (int, tuple)) and not isinstance(value, bool):
            if value == ():
                raise ValueError(f"{name} names no layer; give the width of at least one")
            for part in value if isinstance(value, tuple) else (value,):
                _at_least(name, part, 0 if field.name in COUNTS_FROM_ZERO else 1)
        elif isinstance(value, float) and value < 0 and field.name not in BOUNDLESS:
            raise ValueError(f"{name}={value} is negative; choose a number of at least 0")
        elif value == 0 and field.name in POSITIVE:
            raise ValueError(f"{name}={value} is not above 0; choose a positive number")
        elif isinstance(value, float) and value > 1 and field.name in SHARES:
            raise ValueError(f"{name}={value} is more than 1; choose a number from 0 to 1")


def _digest(trajectories: Trajectory) -> str:
    digest = hashlib.sha256()
    for leaf in trajectories:
        digest.update(np.ascontiguousarray(leaf).tobytes())
    return digest.hexdigest()
