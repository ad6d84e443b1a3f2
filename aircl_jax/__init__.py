"""Adversarial inverse reward-constraint learning: a reward, a constraint and a policy from demonstrations, in JAX.

Names are loaded at their first use, so that `import aircl_jax` is fast and `runtime.prepare` can run before jax.
"""

import importlib
import sys
from types import ModuleType
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from aircl_jax.api import Result, load, train
    from aircl_jax.methods import METHODS
    from aircl_jax.train import make_trainer
    from envs import ENVS, make_env

_HOMES = {
    "ENVS": "envs",
    "METHODS": "aircl_jax.methods",
    "Result": "aircl_jax.api",
    "load": "aircl_jax.api",
    "make_env": "envs",
    "make_trainer": "aircl_jax.train",
    "train": "aircl_jax.api",
}

__all__ = ["ENVS", "METHODS", "Result", "load", "make_env", "make_trainer", "train"]


class _Package(ModuleType):
    """`aircl_jax.train` is the function; importing the submodule of that name must not put the module in its place."""

    def __setattr__(self, name: str, value: Any) -> None:
        if not (name == "train" and isinstance(value, ModuleType)):
            super().__setattr__(name, value)

    def __getattr__(self, name: str) -> Any:
        if name not in _HOMES:
            raise AttributeError(f"module {self.__name__!r} has no attribute {name!r}")
        return getattr(importlib.import_module(_HOMES[name]), name)

    def __dir__(self) -> list[str]:
        return sorted({*super().__dir__(), *_HOMES})


sys.modules[__name__].__class__ = _Package
