"""The table of environments: name → its options and where it is made. Modules are imported when an env is made."""

import importlib
from collections.abc import Mapping
from dataclasses import dataclass, fields
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
    "swimmer": EnvRow(options.RobotOptions, "envs.robots.robot:make_swimmer"),
    "walker": EnvRow(options.RobotOptions, "envs.robots.robot:make_walker"),
    "pendulum": EnvRow(options.PendulumOptions, "envs.robots.robot:make_pendulum"),
    "meerkat": EnvRow(options.MeerkatOptions, "envs.animals.meerkat:make_meerkat"),
    "labyrinth": EnvRow(options.LabyrinthOptions, "envs.animals.labyrinth:make_labyrinth"),
}


def make_env(name: str, **settings: Any) -> Env:
    """Make an environment by name; settings are the fields of its options. Raises ValueError on a wrong name or setting."""
    if name not in ENVS:
        raise ValueError(f"unknown env {name!r}; choose from {', '.join(sorted(ENVS))}")
    row = ENVS[name]
    known = [field.name for field in fields(row.options)]
    for setting in settings:
        if setting not in known:
            raise ValueError(f"unknown setting env.{setting} of {name}; choose from {', '.join(known)}")
    module, function = row.factory.split(":")
    return getattr(importlib.import_module(module), function)(row.options(**_frozen(settings)).resolved())


def _frozen(settings: Mapping[str, Any]) -> dict[str, Any]:
    """Lists (as they come from YAML or a command line) become tuples, so that options stay hashable."""

    def freeze(value: Any) -> Any:
        return tuple(freeze(item) for item in value) if isinstance(value, (list, tuple)) else value

    return {name: freeze(value) for name, value in settings.items()}
