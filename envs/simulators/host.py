"""Episodes of a Gymnasium world on the host. An episode's state is its seed and its actions so far, and nothing else.

The host keeps the worlds that are under way, so that a step is one step of one of them. A state that none of them is in, as
after `resume=true` or where two learners go on from one episode, is played again from its seed.
"""

from collections import OrderedDict
from collections.abc import Callable
from threading import Lock
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int, UInt32

KINDS = (np.float32, np.float32, np.bool_, np.float32, np.float32)  # of the fields of `Seen`
KEPT = 8  # worlds under way that are kept, in numbers of those that one call steps; others are played again


class Episode(NamedTuple):
    """What an episode carries. A step beyond the last one of `actions` does nothing and does not count."""

    seed: UInt32[Array, ""]
    actions: Float[Array, "T A"]  # 0 from `steps` on
    steps: Int[Array, ""]
    obs: Float[Array, " O"]
    over: Bool[Array, ""]  # the world has ended


class Seen(NamedTuple):
    """What a step of the host gives."""

    obs: Float[Array, " O"]
    reward: Float[Array, ""]
    over: Bool[Array, ""]
    cost: Float[Array, ""]  # info["cost"], NaN where there is none
    pose: Float[Array, " P"]  # [qpos, qvel] of a world by MuJoCo; else empty


def pose_of(world: Any) -> np.ndarray:
    """Read [qpos, qvel] of a world by MuJoCo; empty of any other."""
    data: Any = getattr(world.unwrapped, "data", None)
    if not (hasattr(data, "qpos") and hasattr(data, "qvel")):
        return np.zeros(0, np.float32)
    return np.concatenate([data.qpos, data.qvel]).astype(np.float32)


class Host:
    """Worlds of one kind, on this machine's processor. Its two functions are pure, as `jax.pure_callback` needs them."""

    def __init__(self, make: Callable[[], Any], obs_size: int, pose_size: int) -> None:
        self._make, self._obs_size, self._pose_size = make, obs_size, pose_size
        self._idle: list[Any] = []
        self._under_way: OrderedDict[bytes, Any] = OrderedDict()  # by seed and actions, the least recently used first
        self._lock = Lock()  # devices call from threads of their own
        self._most = 0

    def reset(self, seed: Any) -> np.ndarray:
        """Give the first observation of the episodes of these seeds, [*N, O]."""
        seeds = np.asarray(seed)
        with self._lock:
            world = self._idle_world()
            first = [np.asarray(world.reset(seed=int(each))[0], np.float32) for each in seeds.reshape(-1)]
            self._idle.append(world)
        return np.stack(first).reshape(*seeds.shape, self._obs_size)

    def step(self, seed: Any, actions: Any, steps: Any, action: Any, active: Any) -> tuple[np.ndarray, ...]:
        """Take one step of each active episode, [*N]; give the fields of `Seen`."""
        shape, seeds = np.shape(seed), np.asarray(seed).reshape(-1)
        past = np.asarray(actions).reshape(len(seeds), *np.shape(actions)[-2:])
        lengths, now = np.asarray(steps).reshape(-1), np.asarray(action).reshape(len(seeds), -1)
        idle = np.zeros(self._obs_size), 0.0, True, np.nan, np.zeros(self._pose_size)
        with self._lock:
            self._most = max(self._most, len(seeds))
            rows = [
                self._one_step(int(seeds[i]), past[i], int(lengths[i]), now[i]) if moves else idle
                for i, moves in enumerate(np.asarray(active).reshape(-1))
            ]
            while len(self._under_way) > KEPT * self._most:
                self._idle.append(self._under_way.popitem(last=False)[1])
        columns = (np.array(column, kind) for column, kind in zip(zip(*rows, strict=True), KINDS, strict=True))
        return tuple(column.reshape((*shape, *column.shape[1:])) for column in columns)

    def _one_step(self, seed: int, actions: np.ndarray, steps: int, action: np.ndarray) -> tuple[Any, ...]:
        past, last = actions[:steps], steps + 1 == len(actions)
        known = seed.to_bytes(4, "little") + past.tobytes()
        world = self._under_way.pop(known, None)
        if world is None:
            world = self._idle_world()
            world.reset(seed=seed)
            for earlier in past:
                world.step(_of(world, earlier))
        obs, reward, terminated, truncated, info = world.step(_of(world, action))
        over = bool(terminated) or (bool(truncated) and not last)
        if over or last:
            self._idle.append(world)
        else:
            twin = self._under_way.pop(after := known + action.tobytes(), None)
            self._idle += [] if twin is None else [twin]
            self._under_way[after] = world
        return obs, reward, over, info["cost"] > 0 if "cost" in info else np.nan, pose_of(world)

    def _idle_world(self) -> Any:
        return self._idle.pop() if self._idle else self._make()


def _of(world: Any, action: np.ndarray) -> np.ndarray:
    return action.astype(world.action_space.dtype)


def begin(host: Host, seed: UInt32[Array, ""], horizon: int, obs_size: int, num_actions: int) -> Episode:
    """Begin the episode of a seed."""
    shape = jax.ShapeDtypeStruct((obs_size,), jnp.float32)
    obs = jax.pure_callback(host.reset, shape, seed, vmap_method="broadcast_all")
    return Episode(seed, jnp.zeros((horizon, num_actions)), jnp.zeros((), jnp.int32), obs, jnp.zeros((), bool))


def advance(host: Host, episode: Episode, action: Float[Array, " A"], pose_size: int) -> tuple[Episode, Seen]:
    """Take one step of an episode; one that is over, or has no step left, stays as it is."""
    horizon = len(episode.actions)
    active = ~episode.over & (episode.steps < horizon)
    scalar, ended = (jax.ShapeDtypeStruct((), kind) for kind in (jnp.float32, bool))
    obs, pose = (jax.ShapeDtypeStruct(shape, jnp.float32) for shape in (episode.obs.shape, (pose_size,)))
    inputs = episode.seed, episode.actions, episode.steps, action, active
    seen = Seen(*jax.pure_callback(host.step, (obs, scalar, ended, scalar, pose), *inputs, vmap_method="broadcast_all"))
    sound = jnp.isfinite(seen.obs).all() & jnp.isfinite(seen.reward)
    obs = jnp.where(active & sound, seen.obs, episode.obs)
    over = episode.over | (active & (seen.over | ~sound))
    moved = episode._replace(
        actions=jnp.where(active, episode.actions.at[episode.steps].set(action), episode.actions),
        steps=episode.steps + active,
        obs=obs,
        over=over,
    )
    return moved, seen._replace(obs=obs, reward=jnp.where(active & sound, seen.reward, 0.0), over=over)
