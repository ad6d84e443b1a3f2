"""One check of a world before anything runs in it: whether `reset` and `step` give what its fields say."""

from collections.abc import Callable, Iterator
from typing import Any, cast, get_args, get_type_hints

import chex
import jax
import jax.numpy as jnp

from envs.base import Box, Discrete, Env, Step
from envs.indexing import first_beyond
from envs.options import LONGEST
from envs.views import Activities, Codes, Coordinates, Grid, Maze

CONSTRAINT_INPUTS = get_args(get_type_hints(Env)["constraint_input"])
GYMNASIUM = 5  # values that Gymnasium's step returns


class MisfitError(ValueError):
    """What does not fit, and what would."""


def check_env(env: Env) -> None:
    """Trace `reset` and `step` once, without computing. Raises ValueError, in one line, for the first misfit."""
    try:
        for misfit in _misfits(env):
            raise MisfitError(misfit)
    except MisfitError as misfit:
        raise ValueError(f"env={env.title}: {' '.join(str(misfit).split())}") from misfit.__cause__


def check_predicate(what: str, violated: Callable[..., Any], *inputs: Any) -> None:
    """Raise ValueError, in one line, unless a predicate of these inputs gives one true or false and reads what there is."""
    try:
        found = _traced(what, violated, *inputs)
        for misfit in _shape(what, found, ()):
            raise MisfitError(misfit)
        if found.dtype != jnp.bool_:
            raise MisfitError(f"{what} gives {found.dtype}; choose true or false, as a comparison does")
    except MisfitError as misfit:
        raise ValueError(" ".join(str(misfit).split())) from misfit.__cause__


def _traced(what: str, function: Callable[..., Any], *inputs: Any) -> Any:
    """The shapes and types that a function gives. Raises MisfitError where it cannot be traced, or reads beyond an end."""
    try:
        program, found = jax.make_jaxpr(function, return_shape=True)(*inputs)
        beyond = first_beyond(program)
    except Exception as error:  # of any kind: it is the user's own code
        first = (str(error) or type(error).__name__).splitlines()[0]
        raise MisfitError(
            f"{what} cannot be traced ({type(error).__name__}: {first}); choose pure functions of jax arrays"
        ) from error
    if beyond is not None:
        raise MisfitError(f"{what} reads {beyond}, which jax takes for the last; choose an index within")
    return found


def _misfits(env: Env) -> Iterator[str]:
    """Every misfit, each with what would fit. What comes later assumes that what came before fits."""
    if not isinstance(env.horizon, int) or not 1 <= env.horizon <= LONGEST:
        yield f"horizon={env.horizon}; choose a whole number from 1 to {LONGEST}"
    if not isinstance(env.action_space, Discrete | Box):
        yield f"action_space is of type {type(env.action_space).__name__}; choose Discrete or Box"
    if isinstance(env.action_space, Box) and not env.action_space.low < env.action_space.high:
        yield f"action_space runs from {env.action_space.low} to {env.action_space.high}; choose a low below a high"
    if env.constraint_input not in CONSTRAINT_INPUTS:
        yield f"constraint_input={env.constraint_input!r}; choose from {', '.join(CONSTRAINT_INPUTS)}"
    yield from _of_an_episode(env)
    yield from _of_the_reward_view(env)
    yield from _of_the_table(env)
    yield from _of_the_view(env)


def _of_an_episode(env: Env) -> Iterator[str]:
    key = jax.random.key(0)
    begun = _traced("reset", env.reset, key)
    if not isinstance(begun, tuple) or len(begun) != 2:
        yield f"reset returns {type(begun).__name__}; choose (state, obs)"
    state, obs = begun
    yield from _shape("obs of reset", obs, (env.obs_size,))
    kind = jnp.int32 if isinstance(env.action_space, Discrete) else jnp.float32
    done: Any = _traced("step", env.step, key, state, jax.ShapeDtypeStruct(env.action_space.shape, kind))
    if isinstance(done, tuple) and len(done) == GYMNASIUM and not isinstance(done, Step):
        yield "step returns 5 values, as Gymnasium's does; choose (state, envs.Step(obs, reward, cost, terminated))"
    elif not isinstance(done, tuple) or len(done) != 2 or not isinstance(done[1], Step):
        yield "step does not return (state, Step); choose envs.Step for the second"
    after, step = cast(tuple[Any, Step], done)
    yield from _shape("obs of step", step.obs, (env.obs_size,))
    for name in ("reward", "cost", "terminated", "counts"):
        yield from _shape(f"{name} of step", getattr(step, name), ())
    try:
        chex.assert_trees_all_equal_shapes_and_dtypes((state, obs), (after, step.obs))
    except AssertionError:
        yield "step changes the structure, a shape or a type of state or obs; choose those that reset returns"


def _of_the_reward_view(env: Env) -> Iterator[str]:
    seen = _traced("reward_view", env.reward_view, jax.ShapeDtypeStruct((env.obs_size,), jnp.float32))
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
        case Codes(names=names) | Activities(coordinates=names):
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
