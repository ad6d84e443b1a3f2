"""Describe how the swimmer swims: amplitude, frequency and phase of its two joints."""

from typing import NamedTuple

import numpy as np

from aircl_jax.types import Trajectory
from envs import Coordinates, Env

SETTLED = 0.4  # share of an episode after which the gait is measured


class Gait(NamedTuple):
    """Of one policy, averaged over its episodes."""

    front_amplitude: float  # rad
    rear_amplitude: float  # rad
    frequency: float  # Hz, of the front joint
    lag: float  # cycles by which the rear joint follows the front one


def gait_of(env: Env, episodes: Trajectory) -> Gait:
    """Measure the gait from episodes [N, T, …].

    A joint that moves as A sin(ωt) has amplitude √2 std q, angular frequency std q̇ / std q and phase arg(q − i q̇/ω).
    """
    assert isinstance(env.view, Coordinates)  # noqa: S101
    first = int(SETTLED * episodes.obs.shape[1])
    obs = np.asarray(episodes.obs, float)[:, first:]
    phases, amplitudes, rates = [], [], []
    for joint in ("front", "rear"):
        angle = obs[..., env.view.names.index(joint)]
        speed = obs[..., env.view.names.index(f"velocity of {joint}")]
        angle = angle - angle.mean(axis=1, keepdims=True)
        rate = speed.std() / max(float(angle.std()), 1e-9)
        phases.append(angle - 1j * speed / max(rate, 1e-9))
        amplitudes.append(float(np.sqrt(2) * angle.std()))
        rates.append(float(rate))
    lag = float(np.angle((phases[0] * phases[1].conj()).mean()) / (2 * np.pi))
    return Gait(amplitudes[0], amplitudes[1], rates[0] / (2 * np.pi), lag)
