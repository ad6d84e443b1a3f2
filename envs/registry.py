"""The table of environments: name → its options and where it is made. Modules are imported when an env is made."""

import importlib
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

from envs import options
from envs.base import Env
from envs.settings import updated
from envs.simulators.options import BraxOptions, GymnasiumOptions, PlaygroundOptions


@dataclass(frozen=True)
class EnvRow:
    options: type[Any]  # frozen dataclass of settings
    factory: str  # "module:function", called with the options


ENVS: dict[str, EnvRow] = {
    "gridworld": EnvRow(options.GridOptions, "envs.gridworld:make_gridworld"),
    "nonmarkov": EnvRow(options.NonMarkovOptions, "envs.gridworld:make_nonmarkov"),
    "swimmer": EnvRow(options.SwimmerOptions, "envs.robots.robot:make_swimmer"),
    "walker": EnvRow(options.WalkerOptions, "envs.robots.robot:make_walker"),
    "halfcheetah": EnvRow(options.HalfCheetahOptions, "envs.robots.robot:make_halfcheetah"),
    "hopper": EnvRow(options.HopperOptions, "envs.robots.robot:make_hopper"),
    "pendulum": EnvRow(options.PendulumOptions, "envs.robots.robot:make_pendulum"),
    "meerkat": EnvRow(options.MeerkatOptions, "envs.animals.meerkat:make_meerkat"),
    "labyrinth": EnvRow(options.LabyrinthOptions, "envs.animals.labyrinth:make_labyrinth"),
    "brax": EnvRow(BraxOptions, "envs.simulators.brax:make_brax"),
    "playground": EnvRow(PlaygroundOptions, "envs.simulators.playground:make_playground"),
    "gymnasium": EnvRow(GymnasiumOptions, "envs.simulators.gymnasium:make_gymnasium"),
}


def make_env(name: str, **settings: Any) -> Env:
    """Make an environment by name; settings are the fields of its options. Raises ValueError on a wrong name or setting."""
    return build(name, options_of(name, settings))


def options_of(name: str, settings: Mapping[str, Any]) -> Any:
    """Read the options of an environment from untyped settings. Raises ValueError on a wrong name or setting."""
    if name not in ENVS:
        raise ValueError(f"unknown env {name!r}; choose from {', '.join(ENVS)}")
    resolved = updated(ENVS[name].options(), settings, "env").resolved()
    if resolved.horizon > options.LONGEST:
        raise ValueError(f"env.horizon={resolved.horizon}; choose a whole number from 1 to {options.LONGEST}")
    return resolved


def build(name: str, options: Any) -> Env:
    """Build an environment of the table from its options. Raises ValueError where they do not fit each other."""
    module, function = ENVS[name].factory.split(":")
    return replace(getattr(importlib.import_module(module), function)(options), registered=True)
