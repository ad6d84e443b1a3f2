"""Constrained worlds in pure JAX. This package imports nothing of `aircl_jax`."""

from envs.base import Box, Codes, Discrete, Env, Maze, Recorded, Step, Tabular
from envs.registry import ENVS, make_env

__all__ = ["ENVS", "Box", "Codes", "Discrete", "Env", "Maze", "Recorded", "Step", "Tabular", "make_env"]
