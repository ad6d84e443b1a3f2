"""Compute where actions lead in a finite world whose states have positions."""

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from envs import Env


def expected_moves(env: Env) -> Float[Array, "O A P"]:
    """E[position of s'] − position of s of each observed state and action, the mean over states that look the same."""
    table, position = env.tabular, env.position
    if table is None or position is None:
        raise TypeError(f"{env.name} is no table with positions")
    where = jax.vmap(position)(table.obs)
    moves = table.transition @ where - where[:, None]
    return jnp.einsum("xo,xap->oap", table.obs, moves) / table.obs.sum(axis=0)[:, None, None]
