"""Measure what was learned on demonstrations that it has not seen; neither the true reward nor the true cost is read."""

import math
from dataclasses import dataclass
from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from aircl_jax.algorithm.rollout import rollouts
from aircl_jax.algorithm.scoring import trajectory_feasibility
from aircl_jax.model.feasibility import FORBIDDEN_BELOW
from aircl_jax.model.networks import BoundNetworks, Networks
from aircl_jax.runs.result import Result
from aircl_jax.types import Metrics, TrainState, Trajectory

KEY_HELD_OUT = 3  # folded into a state's key, so that the episodes differ from those of evaluation and figures
SHUFFLED = 0  # seed of the order in which demonstrations are held out


@dataclass(frozen=True)
class Weights:
    """What a score adds up: likelihood − moments + passing, each times its weight."""

    likelihood: float = 1.0
    moments: float = 1.0
    passing: float = 1.0

    def score(self, parts: dict[str, float]) -> float:
        return self.likelihood * parts["likelihood"] - self.moments * parts["moments"] + self.passing * parts["passing"]


def split(trajectories: Trajectory, share: float) -> tuple[Trajectory, Trajectory]:
    """Split demonstrations [N, T, …] at random, always alike: what is trained on, and what is held out.

    Raises ValueError where one of them would be empty.
    """
    number = len(trajectories.mask)
    held = round(share * number)
    if not 0 < held < number:
        raise ValueError(f"held_out={share:g} of {number} demonstrations leaves a part empty; choose another share")
    order = np.random.default_rng(SHUFFLED).permutation(number)
    training, out = np.sort(order[held:]), np.sort(order[:held])
    return _part(trajectories, training), _part(trajectories, out)


def measure(result: Result, held_out: Trajectory) -> dict[str, float]:
    """Average the three measures over the seeds of a run; NaN where one of them is."""
    of_seed = partial(measure_seed, result.networks, result.spec.config.num_evaluation)
    found = jax.device_get(jax.jit(jax.vmap(of_seed, (0, None)))(result.states, held_out))
    return {name: float(np.mean(values)) for name, values in found.items()}


def measure_seed(networks: Networks, number: int, state: TrainState, held_out: Trajectory) -> Metrics:
    """Compute the three measures of one seed, the moments from `number` fresh episodes.

    likelihood  mean log π(a|s) of held-out steps, a coordinate of the action
    moments     `gap` of held-out and fresh steps
    passing     share of held-out demonstrations with δ̄ ≥ ½; 1 where no feasibility is learned
    """
    nets = networks.bind(state.params, state.obs_stats)
    key = jax.random.fold_in(jax.random.fold_in(state.key, KEY_HELD_OUT), state.step)
    log_pi = jax.vmap(nets.log_pi)(held_out)
    coordinates = math.prod(nets.env.action_space.shape)
    passing = trajectory_feasibility(nets, held_out) >= jnp.log(FORBIDDEN_BELOW)
    return {
        "likelihood": (log_pi * held_out.mask).sum() / held_out.mask.sum() / coordinates,
        "moments": gap(nets, held_out, rollouts(nets, key, number)),
        "passing": passing.mean(),
    }


def gap(nets: BoundNetworks, ours: Trajectory, theirs: Trajectory) -> Float[Array, ""]:
    """√ mean_k ((E φ_k − E' φ_k) / σ_k)² of two sets of steps: 0 the same, at most 2.

    φ are the coordinates of observation and action and their squares; σ_k is that of both sets mixed half and half.
    What does not vary in the mixture counts as 0.
    """
    (mean, square), (mean_theirs, square_theirs) = _moments(nets, ours), _moments(nets, theirs)
    variance = 0.5 * (square + square_theirs) - (0.5 * (mean + mean_theirs)) ** 2
    apart = (mean - mean_theirs) ** 2
    least = 1e-6 * jnp.maximum(square + square_theirs, 1e-12)  # of single precision
    return jnp.sqrt(jnp.where(variance > least, apart / jnp.maximum(variance, least), 0.0).mean())


def _part(trajectories: Trajectory, places: Int[np.ndarray, " M"]) -> Trajectory:
    return jax.tree.map(lambda leaf: np.asarray(leaf)[places], trajectories)


def _moments(nets: BoundNetworks, trajectories: Trajectory) -> tuple[Float[Array, " K"], Float[Array, " K"]]:
    """E φ_k and E φ_k² of the unmasked steps."""
    acted = jax.vmap(jax.vmap(nets.env.action_space.features))(trajectories.action)
    seen = jnp.concatenate([jax.vmap(jax.vmap(nets.normalise))(trajectories.obs), acted], axis=-1)
    phi = jnp.concatenate([seen, seen**2], axis=-1)
    weight = (trajectories.mask / trajectories.mask.sum())[..., None]
    inside = jnp.where(trajectories.mask[..., None] > 0, phi, 0.0)
    return (weight * inside).sum(axis=(0, 1)), (weight * inside**2).sum(axis=(0, 1))
