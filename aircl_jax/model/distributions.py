"""Make distributions over actions, and keep their parameters in bounds."""

from typing import Any

import distrax
import jax.numpy as jnp
from jaxtyping import Array, Float

from aircl_jax.settings.train_config import PPOConfig


def categorical(probabilities: Float[Array, " A"]) -> distrax.Distribution:
    """Return the distribution over actions with these probabilities."""
    return distrax.Categorical(probs=probabilities)


def project_log_std(params: Any, config: PPOConfig) -> Any:
    """log σ moved back into its bounds after an update; clipped inside the network it would lose its gradient there."""
    if "log_std" not in params["params"]:
        return params
    bounded = jnp.clip(params["params"]["log_std"], config.log_std_min, config.log_std_max)
    return {"params": {**params["params"], "log_std": bounded}}
