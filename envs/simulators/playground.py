"""Any task of MuJoCo Playground, by MJX in JAX: `env=playground env.task=CartpoleBalance env.constraint=tilt env.limit=0.1`."""

import importlib
from dataclasses import replace
from importlib.util import find_spec
from typing import Any

from jaxtyping import Array, Float

from envs.base import Env
from envs.brax_adapter import adapt
from envs.measures import measures_of
from envs.robots.robot import import_mjx
from envs.simulators.options import PlaygroundOptions
from envs.simulators.rules import find_rule
from envs.simulators.trial import tried


def make_playground(options: PlaygroundOptions) -> Env:
    """Make the task. Raises ValueError, in one line, where it is unknown, or does not run with what is installed."""
    if find_spec("mujoco_playground") is None:
        raise ValueError("env=playground needs the package playground, which is not installed; install aircl-jax[playground]")
    with tried(options.task, "playground"):
        import_mjx()
        registry: Any = importlib.import_module("mujoco_playground").registry
        if options.task not in registry.ALL_ENVS:
            raise ValueError(f"unknown env.task {options.task!r} of playground; choose from {', '.join(registry.ALL_ENVS)}")
        world = registry.load(options.task, config_overrides={"impl": "jax"})
        rule = find_rule(options, measures_of(world.mj_model), _pose)
        env = adapt(world, rule.violated, options.horizon, options.terminate, rule.of, options.observation)
    return replace(env, name="playground", task=options.task, limit=rule.limit)


def _pose(state: Any) -> tuple[Float[Array, " Q"], Float[Array, " V"]]:
    return state.data.qpos, state.data.qvel
