"""Any task of `brax.envs`: `env=brax env.task=ant env.constraint=position env.limit=-3`."""

import importlib
from dataclasses import replace
from typing import Any

from jaxtyping import Array, Float

from envs.base import Env
from envs.brax_adapter import adapt
from envs.measures import measures_of
from envs.robots.robot import import_mjx
from envs.simulators.options import BraxOptions
from envs.simulators.rules import find_rule
from envs.simulators.trial import tried

UNREAL = ("fast",)  # of Brax's own tests: it has no body


def make_brax(options: BraxOptions) -> Env:
    """Make the task. Raises ValueError, in one line, where it is unknown or does not run with the versions installed."""
    with tried(options.task, "brax"):
        import_mjx()  # Brax imports it and lets it print
        library: Any = importlib.import_module("brax.envs")
        known = [name for name in library._envs if name not in UNREAL]
        if options.task not in known:
            raise ValueError(f"unknown env.task {options.task!r} of brax; choose from {', '.join(known)}")
        world = library.get_environment(options.task, backend=options.backend)
        rule = find_rule(options, measures_of(world.sys.mj_model), _pose)
        env = adapt(world, rule.violated, options.horizon, options.terminate, rule.of)
    return replace(env, name="brax", task=options.task, limit=rule.limit)


def _pose(state: Any) -> tuple[Float[Array, " Q"], Float[Array, " V"]]:
    return state.pipeline_state.q, state.pipeline_state.qd
