import jax.numpy as jnp
import numpy as np

from aircl_jax.analysis.gait import gait_of
from aircl_jax.types import Trajectory
from envs import make_env


def swimming(amplitudes, frequency, lag, seconds=0.04, steps=500):
    """Episodes of a swimmer whose joints move as A sin(2π f t), the rear one `lag` cycles later, around a bend of 0.3 rad."""
    names = make_env("swimmer").coordinate_names
    time = seconds * np.arange(steps)
    obs = np.zeros((2, steps, len(names)))
    for joint, amplitude, behind in (("front", amplitudes[0], 0.0), ("rear", amplitudes[1], lag)):
        angle = 2 * np.pi * (frequency * time - behind)
        obs[..., names.index(joint)] = 0.3 + amplitude * np.sin(angle)
        obs[..., names.index(f"velocity of {joint}")] = amplitude * 2 * np.pi * frequency * np.cos(angle)
    blank = jnp.zeros(obs.shape[:2])
    return Trajectory(jnp.asarray(obs), blank, blank, blank, blank, blank, blank + 1, blank[:, 0])


def test_a_known_gait_is_measured():
    gait = gait_of(make_env("swimmer"), swimming((0.7, 0.9), frequency=1.25, lag=0.2))
    np.testing.assert_allclose(gait, (0.7, 0.9, 1.25, 0.2), atol=5e-3)


def test_a_rear_joint_that_leads_has_a_negative_lag():
    assert abs(gait_of(make_env("swimmer"), swimming((0.7, 0.7), frequency=1.0, lag=-0.25)).lag + 0.25) < 5e-3
