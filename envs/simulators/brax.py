"""Any task of `brax.envs`: `env=brax env.task=ant env.constraint=position env.limit=-3`."""

import importlib
import warnings
from dataclasses import replace
from importlib.metadata import version
from typing import Any

from jaxtyping import Array, Float

from envs.base import Env
from envs.brax_adapter import adapt
from envs.measures import measures_of
from envs.robots.robot import import_mjx
from envs.simulators.options import BraxOptions
from envs.simulators.quiet import mujoco_quiet
from envs.simulators.rules import find_rule

UNREAL = ("fast",)  # of Brax's own tests: it has no body


def make_brax(options: BraxOptions) -> Env:
    """Make the task. Raises ValueError, in one line, where it is unknown or does not run with the versions installed."""
    with warnings.catch_warnings(), mujoco_quiet():
        warnings.simplefilter("ignore")  # of jaxopt, and of Brax that it is no longer developed
        import_mjx()  # Brax imports it and lets it print
        library: Any = importlib.import_module("brax.envs")
        known = [name for name in library._envs if name not in UNREAL]
        if options.task not in known:
            raise ValueError(f"unknown env.task {options.task!r} of brax; choose from {', '.join(known)}")
        try:
            world = library.get_environment(options.task, backend=options.backend)
            rule = find_rule(options, measures_of(world.sys.mj_model), _pose)
            env = adapt(world, rule.violated, options.horizon, options.terminate, rule.of)
        except ValueError:
            raise
        except Exception as error:
            why = f"{type(error).__name__}: {(str(error) or 'no reason given').splitlines()[0]}"
            versions = f"brax {version('brax')}, jax {version('jax')}"
            raise ValueError(
                f"env.task={options.task} of brax does not run here ({why}; {versions}); choose another"
            ) from error
    return replace(env, name="brax", task=options.task, limit=rule.limit)


def _pose(state: Any) -> tuple[Float[Array, " Q"], Float[Array, " V"]]:
    return state.pipeline_state.q, state.pipeline_state.qd
