"""One check of a world before anything runs in it: whether `reset` and `step` give what its fields say."""

from collections.abc import Iterator
from typing import Any, get_args, get_type_hints

import chex
import jax
import jax.numpy as jnp

from envs.base import Box, Discrete, Env, Step
from envs.views import Codes, Coordinates, Grid, Maze

CONSTRAINT_INPUTS = get_args(get_type_hints(Env)["constraint_input"])


def check_env(env: Env) -> None:
    """Trace `reset` and `step` once, without computing. Raises ValueError, in one line, for the first misfit."""
    for misfit in _misfits(env):
        raise ValueError(f"env={env.name}: {misfit}")


def _misfits(env: Env) -> Iterator[str]:
    """Every misfit, each with what would fit. What comes later assumes that what came before fits."""
    if not isinstance(env.horizon, int) or env.horizon < 1:
        yield f"horizon={env.horizon}; choose a whole number above 0"
    if not isinstance(env.action_space, Discrete | Box):
        yield f"action_space is of type {type(env.action_space).__name__}; choose Discrete or Box"
    if env.constraint_input not in CONSTRAINT_INPUTS:
        yield f"constraint_input={env.constraint_input!r}; choose from {', '.join(CONSTRAINT_INPUTS)}"
    yield from _of_an_episode(env)
    yield from _of_the_reward_view(env)
    yield from _of_the_table(env)
    yield from _of_the_view(env)


def _of_an_episode(env: Env) -> Iterator[str]:
    key = jax.random.key(0)
    begun: Any = jax.eval_shape(env.reset, key)
    if not isinstance(begun, tuple) or len(begun) != 2:
        yield f"reset returns {type(begun).__name__}; choose (state, obs)"
    state, obs = begun
    yield from _shape("obs of reset", obs, (env.obs_size,))
    kind = jnp.int32 if isinstance(env.action_space, Discrete) else jnp.float32
    done: Any = jax.eval_shape(env.step, key, state, jax.ShapeDtypeStruct(env.action_space.shape, kind))
    if not isinstance(done, tuple) or len(done) != 2 or not isinstance(done[1], Step):
        yield "step does not return (state, Step); choose envs.Step for the second"
    after, step = done
    yield from _shape("obs of step", step.obs, (env.obs_size,))
    for name in ("reward", "cost", "terminated", "counts"):
        yield from _shape(f"{name} of step", getattr(step, name), ())
    try:
        chex.assert_trees_all_equal_shapes_and_dtypes((state, obs), (after, step.obs))
    except AssertionError:
        yield "step changes the structure, a shape or a type of state or obs; choose those that reset returns"


def _of_the_reward_view(env: Env) -> Iterator[str]:
    seen = jax.eval_shape(env.reward_view, jax.ShapeDtypeStruct((env.obs_size,), jnp.float32))
    yield from _shape("reward_view", seen, (env.reward_view_size or env.obs_size,), "reward_view_size")


def _of_the_table(env: Env) -> Iterator[str]:
    if env.tabular is None:
        return
    if not isinstance(env.action_space, Discrete):
        yield "tabular needs a finite world; choose Discrete actions"
    else:
        states, actions = len(env.tabular.start), env.action_space.n
        yield from _shape("tabular.transition", env.tabular.transition, (states, actions, states))
        yield from _shape("tabular.reward", env.tabular.reward, (states, actions))
        yield from _shape("tabular.obs", env.tabular.obs, (states, env.obs_size))


def _of_the_view(env: Env) -> Iterator[str]:
    match env.view:
        case Grid(size=size):
            number = size**2
        case Codes(names=names):
            number = len(names)
        case Maze(position=position):
            number = len(position)
        case Coordinates(names=names, motors=motors):
            number = len(names) or env.obs_size
            if len(motors) not in (0, env.action_space.feature_size):
                yield f"view names {len(motors)} motors; choose {env.action_space.feature_size}, or none"
    if number != env.obs_size:
        yield f"view names {number} coordinates; choose {env.obs_size}, as obs_size says"
    bounds = env.limit.bounds if env.limit is not None else None
    if isinstance(bounds, int) and not 0 <= bounds < env.obs_size:
        yield f"limit.bounds={bounds}; choose a coordinate from 0 to {env.obs_size - 1}, actions, or None"


def _shape(what: str, found: Any, expected: tuple[int, ...], said_by: str = "") -> Iterator[str]:
    shape = getattr(found, "shape", None)
    if shape != expected:
        of = "no shape" if shape is None else f"shape {list(shape)}"
        yield f"{what} has {of}; choose {list(expected)}" + (f", or set {said_by}" if said_by else "")
