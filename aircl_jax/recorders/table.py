"""The table of loggers: the word of `log=…`, and where each is."""

import importlib

from aircl_jax.recorders.logger import Logger, Run

NONE = "none"
LOGGERS = {
    "tensorboard": "aircl_jax.recorders.tensorboard:TensorBoard",
    "wandb": "aircl_jax.recorders.wandb:Wandb",
    "trackio": "aircl_jax.recorders.wandb:Trackio",
    "mlflow": "aircl_jax.recorders.mlflow:MLflow",
}


def make_loggers(words: str, run: Run) -> list[Logger]:
    """Make the loggers of a comma list. Raises ValueError, in one line, for an unknown one and for a missing package."""
    chosen = [] if words == NONE else [word.strip() for word in words.split(",")]
    for word in chosen:
        if word not in LOGGERS:
            raise ValueError(f"unknown log {word!r}; choose from {', '.join(LOGGERS)}, or {NONE}")
    return [_found(LOGGERS[word])(run) for word in dict.fromkeys(chosen)]


def _found(place: str) -> type[Logger]:
    module, _, name = place.partition(":")
    return getattr(importlib.import_module(module), name)
