"""Any Gymnasium environment with a Box of observations and a Box of actions: `env=gymnasium env.task=Pendulum-v1`.

    env = from_gymnasium(lambda: MyRobot(), lambda obs, action: jnp.abs(obs[2]) > 5.0, horizon=200)

It is not JAX. Every step is a call of the host (envs/simulators/host.py), which is slow.
"""

import importlib
import warnings
from collections.abc import Callable
from dataclasses import replace
from typing import Any, Literal

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, PRNGKeyArray

from envs.base import Box, Env, Limit, Step
from envs.checks import check_predicate
from envs.measures import Measures, beyond, given, measures_of, side_of
from envs.simulators.host import Episode, Host, Seen, advance, begin, pose_of
from envs.simulators.options import GymnasiumOptions
from envs.simulators.rules import Rule, find_rule

NO_JOINTS = Measures({}, {})
PLAYED = 10  # steps by which it is tried whether seed and actions make an episode


def make_gymnasium(options: GymnasiumOptions) -> Env:
    """Make a registered environment. Raises ValueError, in one line, where there is none, or it is of another kind."""
    gymnasium = _import()

    def make() -> Any:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # of versions, and of bounds that single precision rounds
            return gymnasium.make(options.task, max_episode_steps=options.horizon, disable_env_checker=True)

    try:
        world = make()
    except (gymnasium.error.Error, ImportError, TypeError) as error:
        first = (str(error) or type(error).__name__).splitlines()[0]
        raise ValueError(f"env.task={options.task} of gymnasium cannot be made: {first}; choose another") from error
    whose = f"env.task={options.task}"
    rule = _rule(options, world, whose)
    env = _hosted(make, rule, options.horizon, whose)
    return replace(env, name="gymnasium", task=options.task, limit=rule.limit)


def from_gymnasium(
    make: Any,
    violated: Callable[[Float[Array, " O"], Float[Array, " A"]], Bool[Array, ""]] | Literal["info"],
    horizon: int,
    constraint_input: Literal["state", "action", "state_action"] = "state_action",
) -> Env:
    """Make an `Env` of a function that makes the environment; one that is registered stands for its own.

    `violated(observation after the step, clipped action)` is the cost; "info": `info["cost"]` above 0 is.
    Raises ValueError, in one line, for another kind of environment.
    """
    gymnasium = _import()
    if isinstance(make, gymnasium.Env):
        spec = make.spec
        if spec is None:
            raise ValueError(f"{type(make.unwrapped).__name__} is not registered; pass a function that makes it")
        return from_gymnasium(lambda: gymnasium.make(spec), violated, horizon, constraint_input)
    whose = type(make().unwrapped).__name__
    if violated == "info":
        rule = Rule(_costs, constraint_input, None)
    else:
        rule = Rule(lambda seen, action: violated(seen.obs, action), constraint_input, None)
    return replace(_hosted(make, rule, horizon, whose), name=whose.lower())


def _import() -> Any:
    try:
        return importlib.import_module("gymnasium")
    except ImportError as error:
        raise ValueError("env=gymnasium needs the package gymnasium, which is not installed; install aircl-jax[gym]") from error


def _rule(options: GymnasiumOptions, world: Any, whose: str) -> Rule:
    """Find what the settings forbid: what any body has, a coordinate of the observation, or the environment's own cost."""
    model = getattr(world.unwrapped, "model", None)
    has_body = pose_of_shape(world) > 0 and hasattr(model, "jnt_type")
    positions = int(model.nq) if has_body else 0  # pyright: ignore[reportOptionalMemberAccess]
    if options.constraint == "info":
        return Rule(_costs, "state_action", None)
    if options.constraint == "coordinate":
        index, size = options.coordinate, _sizes(world, whose)[0]
        if not 0 <= index < size:
            raise ValueError(f"env.coordinate={index}: an observation of {whose} has {size}; choose from 0 to {size - 1}")
        limit, side = given("coordinate", options.limit, "the coordinate's unit"), side_of("coordinate", options.side)
        line = Limit("coordinate", limit, index, both_sides=side == "outside")
        return Rule(lambda seen, action: beyond(seen.obs[index], side, limit), "state", line)
    measures = measures_of(model) if has_body else NO_JOINTS
    own = ("coordinate", "info")
    return find_rule(options, measures, lambda seen: (seen.pose[:positions], seen.pose[positions:]), own)


def _costs(seen: Seen, action: Float[Array, " A"]) -> Bool[Array, ""]:
    return seen.cost > 0


def pose_of_shape(world: Any) -> int:
    """How many numbers [qpos, qvel] has; 0 where the environment shows none."""
    return pose_of(world).size


def _sizes(world: Any, whose: str) -> tuple[int, Box]:
    """Read the size of an observation and the box of an action. Raises ValueError for every other kind of space."""
    for what, space in (("observations", world.observation_space), ("actions", world.action_space)):
        if type(space).__name__ != "Box" or len(space.shape) != 1 or not np.issubdtype(space.dtype, np.floating):
            raise ValueError(f"{what} of {whose} are {space}; choose an environment with a Box of one axis of floats")
    low, high = world.action_space.low, world.action_space.high
    if np.unique(low).size > 1 or np.unique(high).size > 1:
        raise ValueError(f"actions of {whose} have bounds that differ; wrap it in gymnasium.wrappers.RescaleAction")
    return int(world.observation_space.shape[0]), Box(int(low.size), float(low[0]), float(high[0]))


def _hosted(make: Callable[[], Any], rule: Rule, horizon: int, whose: str) -> Env:
    world = make()
    obs_size, box = _sizes(world, whose)
    _check_played_again(make, world, box, whose, needs_cost=rule.violated is _costs)
    pose_size = pose_of_shape(world)
    host = Host(make, obs_size, pose_size)

    def reset(key: PRNGKeyArray) -> tuple[Episode, Float[Array, " O"]]:
        """Begin the episode of a seed that the key draws."""
        seed = jax.random.bits(key, dtype=jnp.uint32) >> 1  # Gymnasium takes no negative ones
        episode = begin(host, seed, horizon, obs_size, box.size)
        return episode, episode.obs

    def step(key: PRNGKeyArray, episode: Episode, action: Float[Array, " A"]) -> tuple[Episode, Step]:
        """Take one control step. What is random in it follows from the episode's seed, not from the key."""
        action, left = box.clip(action), episode.over | (episode.steps < horizon)
        after, seen = advance(host, episode, action, pose_size)
        moved = after.steps > episode.steps
        return after, Step(
            obs=seen.obs,
            reward=seen.reward,
            cost=(moved & rule.violated(seen, action)).astype(jnp.float32),
            terminated=(after.over | ~left).astype(jnp.float32),
            counts=left.astype(jnp.float32),
        )

    _, seen = jax.eval_shape(lambda key: advance(host, reset(key)[0], jnp.zeros(box.size), pose_size), jax.random.key(0))
    check_predicate(f"the constraint of {whose}", rule.violated, seen, jax.ShapeDtypeStruct((box.size,), jnp.float32))
    return Env("", horizon, obs_size, box, reset, step, constraint_input=rule.of)


def _check_played_again(make: Callable[[], Any], first: Any, box: Box, whose: str, needs_cost: bool) -> None:
    """Raise ValueError where one seed and the same actions give two episodes, in a new world or in one that was used."""
    random = np.random.default_rng(0)
    spread = box.half_width * random.uniform(-1.0, 1.0, size=(PLAYED, box.size)) + box.middle
    second = make()
    second.reset(seed=1)
    second.step(spread[0].astype(second.action_space.dtype))
    played = [_play(world, spread) for world in (first, second)]
    if not np.array_equal(*(obs for obs, _ in played), equal_nan=True):
        raise ValueError(f"{whose} does not follow from its seed and actions alone; choose an environment that does")
    if needs_cost and not played[0][1]:
        raise ValueError(f"{whose} gives no info['cost']; choose another constraint")


def _play(world: Any, actions: np.ndarray) -> tuple[np.ndarray, bool]:
    """Play up to an end; return what was seen, and whether every step told its cost."""
    seen, tells_cost = [np.asarray(world.reset(seed=0)[0], np.float32)], True
    for action in actions:
        obs, reward, terminated, truncated, info = world.step(action.astype(world.action_space.dtype))
        seen.append(np.asarray(obs, np.float32))
        seen.append(np.full_like(seen[0], float(reward)))
        tells_cost &= "cost" in info
        if terminated or truncated:
            break
    return np.stack(seen), tells_cost
