"""Constrained worlds in pure JAX. This package imports nothing of `aircl_jax`."""

from envs.base import Box, Codes, Discrete, Env, Maze, Recorded, Step, Tabular
from envs.brax_adapter import adapt
from envs.registry import ENVS, make_env
from envs.robots.constraints import CONSTRAINTS, Constraint

__all__ = [
    "CONSTRAINTS",
    "ENVS",
    "Box",
    "Codes",
    "Constraint",
    "Discrete",
    "Env",
    "Maze",
    "Recorded",
    "Step",
    "Tabular",
    "adapt",
    "make_env",
]
