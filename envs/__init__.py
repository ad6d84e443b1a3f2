"""Constrained worlds in pure JAX. This package imports nothing of `aircl_jax`."""

from envs.base import Box, Discrete, Env, Limit, Recorded, Shipped, SoftOptimalExpert, Step, Tabular
from envs.brax_adapter import adapt
from envs.registry import ENVS, make_env
from envs.robots.constraints import CONSTRAINTS, Constraint
from envs.simulators.gymnasium import from_gymnasium
from envs.views import Activities, Codes, Coordinates, Grid, Maze

__all__ = [
    "CONSTRAINTS",
    "ENVS",
    "Activities",
    "Box",
    "Codes",
    "Constraint",
    "Coordinates",
    "Discrete",
    "Env",
    "Grid",
    "Limit",
    "Maze",
    "Recorded",
    "Shipped",
    "SoftOptimalExpert",
    "Step",
    "Tabular",
    "adapt",
    "from_gymnasium",
    "make_env",
]
