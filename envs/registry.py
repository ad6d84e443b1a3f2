"""The table of environments: name → its options and where it is made. Modules are imported when an env is made."""

import importlib
from collections.abc import Mapping
from dataclasses import dataclass, fields, is_dataclass, replace
from typing import Any

from envs import options
from envs.base import Env


@dataclass(frozen=True)
class EnvRow:
    options: type[Any]  # an `Options`, frozen dataclass of settings
    factory: str  # "module:function", called with the options


ENVS: dict[str, EnvRow] = {
    "gridworld": EnvRow(options.GridOptions, "envs.gridworld:make_gridworld"),
    "nonmarkov": EnvRow(options.NonMarkovOptions, "envs.gridworld:make_nonmarkov"),
    "swimmer": EnvRow(options.SwimmerOptions, "envs.robots.robot:make_swimmer"),
    "walker": EnvRow(options.WalkerOptions, "envs.robots.robot:make_walker"),
    "pendulum": EnvRow(options.PendulumOptions, "envs.robots.robot:make_pendulum"),
    "meerkat": EnvRow(options.MeerkatOptions, "envs.animals.meerkat:make_meerkat"),
    "labyrinth": EnvRow(options.LabyrinthOptions, "envs.animals.labyrinth:make_labyrinth"),
}


def make_env(name: str, **settings: Any) -> Env:
    """Make an environment by name; settings are the fields of its options. Raises ValueError on a wrong name or setting."""
    if name not in ENVS:
        raise ValueError(f"unknown env {name!r}; choose from {', '.join(sorted(ENVS))}")
    row = ENVS[name]
    module, function = row.factory.split(":")
    return getattr(importlib.import_module(module), function)(_updated(row.options(), settings, name, "env").resolved())


def _updated(default: Any, settings: Mapping[str, Any], env: str, group: str) -> Any:
    """Put settings into options, groups within groups."""
    known = [field.name for field in fields(default)]
    for setting in settings:
        if setting not in known:
            raise ValueError(f"unknown setting {group}.{setting} of {env}; choose from {', '.join(known)}")

    def value_of(name: str, value: Any) -> Any:
        before = getattr(default, name)
        if not is_dataclass(before) or isinstance(value, type(before)):
            return _frozen(value)
        if isinstance(value, Mapping):
            return _updated(before, value, env, f"{group}.{name}")
        raise ValueError(f"wrong {group}.{name} {value!r} of {env}; choose a {type(before).__name__} or its fields")

    return replace(default, **{name: value_of(name, value) for name, value in settings.items()})


def _frozen(value: Any) -> Any:
    """Lists (as they come from YAML or a command line) become tuples, so that options stay hashable."""
    return tuple(_frozen(item) for item in value) if isinstance(value, (list, tuple)) else value
