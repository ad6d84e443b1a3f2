"""Small Gymnasium environments, shared by the tests."""

import gymnasium
import jax.numpy as jnp
import numpy as np

HORIZON, WALL = 6, 1.5
Box = gymnasium.spaces.Box


class Cart(gymnasium.Env):
    """A cart that is pushed, in a wind that its own generator draws; it ends at a wall."""

    observation_space = Box(-np.inf, np.inf, (2,), np.float32)
    action_space = Box(-1.0, 1.0, (1,), np.float32)
    tells_cost, made = True, 0

    def __init__(self):
        type(self).made += 1

    def reset(self, *, seed=None, options=None):
        super().reset(seed=seed)
        self.x, self.v = self.np_random.normal(size=2) * 0.1
        return np.array([self.x, self.v]), {}

    def step(self, action):
        self.v += float(action[0]) + 0.1 * self.np_random.normal()
        self.x += 0.3 * self.v
        info = {"cost": 2.0 * (self.v > 0.5)} if self.tells_cost else {}
        return np.array([self.x, self.v]), -abs(self.x), self.x > WALL, False, info


def fast(obs, action):
    return jnp.abs(obs[1]) > 0.5


class Silent(Cart):
    tells_cost = False


class Restless(Cart):
    def reset(self, *, seed=None, options=None):
        return super().reset(seed=None)


class Named(Cart):
    observation_space = gymnasium.spaces.Dict({"x": Box(-1.0, 1.0, (1,))})


class Uneven(Cart):
    action_space = Box(np.array([-1.0, -2.0]), np.array([1.0, 2.0]), dtype=np.float64)
