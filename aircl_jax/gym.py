"""Open every world to Gymnasium's tools: `aircl_jax.gym.make("swimmer")`, with the true cost of each step in `info`."""

from typing import Any

import jax
import numpy as np

from envs import ENVS, Box, Codes, Discrete, Env, Grid, Maze, make_env

try:
    import gymnasium
except ImportError as error:
    raise ImportError("aircl_jax.gym needs the package gymnasium, which is not installed; install aircl-jax[gym]") from error

NAMESPACE = "aircl"  # `gymnasium.make("aircl/swimmer-v0")`, once this module is imported
KEYS = 2**31  # of which each episode without a seed draws one


class World(gymnasium.Env[np.ndarray, Any]):
    """One of our worlds, an episode at a time; `info["cost"]` is the true cost of the step, absent where it is unknown.

    The reward is the true one, and 0 where there is none. An episode is truncated at the horizon, or terminated there where
    the task ends with it.
    """

    metadata = {"render_modes": []}  # noqa: RUF012 (as Gymnasium has it)

    def __init__(self, env: Env) -> None:
        self.env = env
        one_hot = isinstance(env.view, Grid | Codes | Maze)
        low, high = (0.0, 1.0) if one_hot else (-np.inf, np.inf)
        self.observation_space = gymnasium.spaces.Box(low, high, (env.obs_size,), np.float32)
        self.action_space = _space(env.action_space)
        self._begin, self._move = jax.jit(env.reset), jax.jit(self._one_step)
        self._state: Any = None  # None: an episode has to be begun
        self._key: Any = None
        self._steps = 0

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[np.ndarray, dict[str, Any]]:
        """Begin an episode; the same seed begins the same one, and each after it is another."""
        super().reset(seed=seed)
        key, self._key = jax.random.split(jax.random.key(int(self.np_random.integers(KEYS))))
        self._state, obs = self._begin(key)
        self._steps = 0
        return np.asarray(obs, np.float32), {}

    def step(self, action: Any) -> tuple[np.ndarray, float, bool, bool, dict[str, Any]]:
        """Take one control step.

        Raises RuntimeError where no episode has begun, or the last one has ended, and ValueError for what is no action: a
        number that is none of them, another shape, or a value that is not finite. Beyond a box the world itself clips.
        """
        if self._state is None:
            raise RuntimeError("no episode is under way; call reset first")
        taken = self._checked(action)
        self._state, self._key, step = self._move(self._key, self._state, taken)
        self._steps += 1
        ended, over = bool(step.terminated > 0), self._steps >= self.env.horizon
        terminated = ended or (over and self.env.finite_horizon)
        truncated = over and not terminated
        if terminated or truncated:
            self._state = None
        reward = float(step.reward) if self.env.has_reward else 0.0
        cost = float(step.cost)
        return np.asarray(step.obs, np.float32), reward, terminated, truncated, {} if np.isnan(cost) else {"cost": cost}

    def _checked(self, action: Any) -> np.ndarray:
        """Return an action as the world takes it."""
        space, given = self.env.action_space, np.asarray(action)
        if given.shape != space.shape:
            raise ValueError(f"action has shape {list(given.shape)}; {self.env.name} needs {list(space.shape)}")
        if isinstance(space, Discrete):
            if given.dtype.kind not in "iu" or not 0 <= given < space.n:
                raise ValueError(f"action={action} is none of {self.env.name}; choose from 0 to {space.n - 1}")
            return given.astype(np.int32)
        if not np.isfinite(given).all():
            raise ValueError(f"action={given.tolist()} is not finite")
        return given.astype(np.float32)

    def _one_step(self, key: Any, state: Any, action: Any) -> tuple[Any, Any, Any]:
        key_step, key = jax.random.split(key)
        state, step = self.env.step(key_step, state, action)
        return state, key, step


def make(name: str, **settings: Any) -> World:
    """Make one of our worlds by its name; settings are those of `env.…`. Raises ValueError, in one line, for what is wrong."""
    return World(make_env(name, **settings))


def _space(actions: Box | Discrete) -> gymnasium.Space[Any]:
    if isinstance(actions, Discrete):
        return gymnasium.spaces.Discrete(actions.n)
    return gymnasium.spaces.Box(actions.low, actions.high, actions.shape, np.float32)


for _name in ENVS:
    if f"{NAMESPACE}/{_name}-v0" not in gymnasium.registry:
        gymnasium.register(id=f"{NAMESPACE}/{_name}-v0", entry_point="aircl_jax.gym:make", kwargs={"name": _name})
