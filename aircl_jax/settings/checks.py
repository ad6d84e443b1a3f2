"""Settings that cannot work are refused before anything is computed: one line that names the setting and the choices."""

import math
import os
from dataclasses import fields, is_dataclass
from typing import Any

import jax
import jax.numpy as jnp

from aircl_jax.settings.train_config import PPOConfig, TrainConfig
from envs.settings import at_least

SHARES = ("discount", "gae_lambda", "replay_rate", "sampled_coef", "false_alarms")  # numbers between 0 and 1
COUNTS_FROM_ZERO = ("clone_epochs", "policy_delay", "feasibility_delay", "lr_decay_iterations")
SCATTERS = ("reward_scatter", "potential_scatter")
POSITIVE = ("sharpness", "threshold", "ratio_clip", *SCATTERS, "pseudo_count")  # numbers of which 0 is none
BOUNDLESS = ("log_std_init", "log_std_min", "log_std_max")  # numbers of either sign


def check_jax() -> None:
    """Raise ValueError where jax is told to compute in double precision, or on devices that are not there."""
    if jnp.result_type(float) == jnp.float64:
        raise ValueError("JAX_ENABLE_X64=1 is set, and runs are of single precision; unset it, or choose 0")
    try:
        jax.devices()
    except (RuntimeError, AssertionError) as error:  # the latter of a platform that jax knows and has no plugin for
        asked, reason = os.environ.get("JAX_PLATFORMS", ""), (str(error) or "there is no such device").splitlines()[0]
        raise ValueError(f"JAX_PLATFORMS={asked}: {reason}; choose cpu, or unset it") from error


def check_config(config: Any, prefix: str) -> None:
    """Raises ValueError unless counts are positive, rates not negative, shares at most 1, bounds in order, and π may move."""
    for field in fields(config):
        name, value = f"{prefix}.{field.name}", getattr(config, field.name)
        if is_dataclass(value):
            check_config(value, name)
        elif field.type is int or isinstance(value, tuple):
            _check_counts(name, value, 0 if field.name in COUNTS_FROM_ZERO else 1)
        elif isinstance(value, (int, float)):
            _check_number(name, value, field.name)
    if isinstance(config, PPOConfig) and not config.log_std_min <= config.log_std_init <= config.log_std_max:
        bounds = f"log_std_min={config.log_std_min} and log_std_max={config.log_std_max}"
        raise ValueError(f"{prefix}.log_std_init={config.log_std_init} is not between {bounds}; choose one that is")
    if isinstance(config, TrainConfig) and 0 < config.lr_decay_iterations <= config.policy_delay:
        delay = f"{prefix}.policy_delay={config.policy_delay} is not less than lr_decay_iterations={config.lr_decay_iterations}"
        raise ValueError(f"{delay}, so that the policy would never move; choose less")


def _check_counts(name: str, value: Any, smallest: int) -> None:
    if value == ():
        raise ValueError(f"{name} names no layer; give the width of at least one")
    for part in value if isinstance(value, tuple) else (value,):
        at_least(name, part, smallest)


def _check_number(name: str, value: float, field: str) -> None:
    if not math.isfinite(value):
        raise ValueError(f"{name}={value} is not finite; choose a number")
    if value < 0 and field not in BOUNDLESS:
        raise ValueError(f"{name}={value} is negative; choose a number of at least 0")
    if value == 0 and field in POSITIVE:
        raise ValueError(f"{name}={value} is not above 0; choose a positive number")
    if value > 1 and field in SHARES:
        raise ValueError(f"{name}={value} is more than 1; choose a number from 0 to 1")
