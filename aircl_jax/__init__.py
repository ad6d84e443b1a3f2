"""Adversarial inverse reward-constraint learning: a reward, a constraint and a policy from demonstrations, in JAX.

Names are loaded at their first use, so that `import aircl_jax` is fast and `runtime.prepare` can run before jax. Importing it
adds to XLA_FLAGS what makes jaxlib 0.10.2 multiply rightly (`runtime.correct_products`).
"""

import importlib
from typing import TYPE_CHECKING, Any

from aircl_jax.runtime import correct_products

if TYPE_CHECKING:
    from aircl_jax import gym
    from aircl_jax.algorithm.masks import mean_over_steps
    from aircl_jax.algorithm.terms.table import TERMS
    from aircl_jax.algorithm.trainer import make_trainer
    from aircl_jax.api import load, train
    from aircl_jax.demonstrations.files import from_arrays
    from aircl_jax.demonstrations.soft_optimal import occupancy, soft_value_iteration
    from aircl_jax.demonstrations.sources import load_shipped as load_demonstrations
    from aircl_jax.figures.of_a_run import figures_of
    from aircl_jax.methods import METHODS
    from aircl_jax.reports.card import card_of
    from aircl_jax.runs.metrics_log import read_metrics
    from aircl_jax.runs.result import Result
    from aircl_jax.runs.sweep import sweep
    from aircl_jax.tasks import train_tasks
    from aircl_jax.transfer.shield import shield
    from aircl_jax.transfer.swap import swap
    from aircl_jax.tuning.search import search
    from envs import ENVS, make_env

_HOMES = {
    "ENVS": "envs:ENVS",
    "METHODS": "aircl_jax.methods:METHODS",
    "TERMS": "aircl_jax.algorithm.terms.table:TERMS",
    "Result": "aircl_jax.runs.result:Result",
    "card_of": "aircl_jax.reports.card:card_of",
    "figures_of": "aircl_jax.figures.of_a_run:figures_of",
    "from_arrays": "aircl_jax.demonstrations.files:from_arrays",
    "gym": "aircl_jax.gym",
    "load": "aircl_jax.api:load",
    "load_demonstrations": "aircl_jax.demonstrations.sources:load_shipped",
    "make_env": "envs:make_env",
    "make_trainer": "aircl_jax.algorithm.trainer:make_trainer",
    "mean_over_steps": "aircl_jax.algorithm.masks:mean_over_steps",
    "occupancy": "aircl_jax.demonstrations.soft_optimal:occupancy",
    "read_metrics": "aircl_jax.runs.metrics_log:read_metrics",
    "search": "aircl_jax.tuning.search:search",
    "shield": "aircl_jax.transfer.shield:shield",
    "soft_value_iteration": "aircl_jax.demonstrations.soft_optimal:soft_value_iteration",
    "sweep": "aircl_jax.runs.sweep:sweep",
    "swap": "aircl_jax.transfer.swap:swap",
    "train": "aircl_jax.api:train",
    "train_tasks": "aircl_jax.tasks:train_tasks",
}

__all__ = [
    "ENVS",
    "METHODS",
    "TERMS",
    "Result",
    "card_of",
    "figures_of",
    "from_arrays",
    "gym",
    "load",
    "load_demonstrations",
    "make_env",
    "make_trainer",
    "mean_over_steps",
    "occupancy",
    "read_metrics",
    "search",
    "shield",
    "soft_value_iteration",
    "swap",
    "sweep",
    "train",
    "train_tasks",
]

correct_products()


def __getattr__(name: str) -> Any:
    if name not in _HOMES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    module, _, attribute = _HOMES[name].partition(":")
    home = importlib.import_module(module)
    return getattr(home, attribute) if attribute else home


def __dir__() -> list[str]:
    return sorted({*globals(), *_HOMES})
