"""The robots' shipped episodes against the worlds that they are of: each step is taken again."""

from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import envs
from aircl_jax.demonstrations.sources import load_shipped
from envs import make_env
from envs.robots.tasks import RobotState

FILES = sorted((Path(envs.__file__).parent / "demonstrations").glob("*_torque.npz"))  # a wall is met after the noise
NOISE = 0.001  # standard deviation of the world's noise, which is between two observations and in no reward
CLIPPED = 10.0  # of the observed velocities of walker and hopper
FAST = ("swimmer",)  # the others' floor compiles for long


@pytest.mark.parametrize(
    "name",
    [pytest.param(name, marks=[] if name in FAST else pytest.mark.slow) for name in (f.stem.split("_")[0] for f in FILES)],
)
def test_a_shipped_step_leads_to_the_next_and_has_the_reward_and_the_cost_of_its_world(name: str) -> None:
    env = make_env(name, noise=0.0)
    shipped = load_shipped(f"{name}_torque", env)
    obs, action, reward, cost = (leaf[:8, 100:150] for leaf in (shipped.obs, shipped.action, shipped.reward, shipped.cost))
    joints = sum(coordinate.startswith("velocity of") for coordinate in env.coordinate_names)
    qpos, qvel = obs[..., :-joints], obs[..., -joints:]
    qpos = jnp.pad(qpos, [(0, 0), (0, 0), (joints - qpos.shape[-1], 0)])  # no place is worth more than another
    step = jax.jit(jax.vmap(lambda *at: env.step(jax.random.key(0), RobotState(*at[:2]), at[2])[1]))
    found = step(*(leaf.reshape(-1, leaf.shape[-1]) for leaf in (qpos, qvel, action)))
    found = jax.tree.map(lambda leaf: np.asarray(leaf).reshape(8, 50, *leaf.shape[1:]), found)
    seen = np.asarray((jnp.abs(qvel) < CLIPPED).all(axis=-1))
    assert seen.mean() > 0.7  # of the walker .78
    off = (found.obs[:, :-1] - np.asarray(obs)[:, 1:])[seen[:, :-1]]
    assert np.abs(off).max() < 6 * NOISE
    assert off.std() == pytest.approx(NOISE, rel=0.05)
    np.testing.assert_allclose(found.reward[seen], np.asarray(reward)[seen], atol=5e-3)
    np.testing.assert_array_equal(found.cost, cost)
