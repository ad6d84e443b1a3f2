"""The reward of a world without a table: θ of Σ θ_k φ_k(s), first by the moments of Eq. 6, then the sparsest that separates."""

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from aircl_jax.model.features import features
from aircl_jax.model.networks import BoundNetworks
from aircl_jax.settings.train_config import MomentConfig, TrainConfig
from aircl_jax.types import Trajectory

SOLVED = 2_000  # steps of the choice of features
LATER_GAPS = 100  # of the time after it


class Weights(NamedTuple):
    """θ, and the gaps from which it is chosen: E_E φ − E_k φ of π in iteration k, zeros where there was none yet.

    I: the iterations until the first choice, at most, and the last `LATER_GAPS` since then in which π was far from them.
    """

    now: Float[Array, " K"]
    gaps: Float[Array, "I K"]
    away: Float[Array, ""]  # iterations in a row in which π, paid by what was chosen, was far from the demonstrations
    all_away: Float[Array, ""]  # all such iterations
    rechosen: Float[Array, ""]  # how often θ was chosen anew


def first_weights(number: int, config: TrainConfig) -> Weights:
    """Begin with θ = 0 and room for the gaps."""
    zero = jnp.zeros(())
    return Weights(jnp.zeros(number), jnp.zeros((config.feasibility_delay + 1 + LATER_GAPS, number)), zero, zero, zero)


def next_weights(
    weights: Weights,
    gap: Float[Array, " K"],
    step: Int[Array, ""],
    begins: Bool[Array, ""],
    begun: Bool[Array, ""],
    early: Bool[Array, ""],
    config: MomentConfig,
) -> Weights:
    """Follow the gap until the constraint begins, then choose what separates all that π was, and keep it.

    Where π, paid by what was chosen, is `far` from the demonstrations for `patience` iterations, that is no reward of theirs:
    it is chosen anew, and the demonstrations have to be worth more than what π became of it too. That is done while it is
    `early` enough for π to learn it.
    """
    lost = begun & (size_of(gap) > config.far)
    away = jnp.where(lost, weights.away + 1.0, 0.0)
    again = early & (away >= config.patience)
    later = len(weights.gaps) - LATER_GAPS + weights.all_away.astype(jnp.int32) % LATER_GAPS
    row = jnp.where(begun, later, step)
    gaps = weights.gaps.at[row].set(jnp.where(begun & ~lost, weights.gaps[row], gap))
    kept = jnp.where(begun, weights.now, following(weights.now, gap, step, config))
    chosen = separating(gaps, kept, config, jnp.where((begins & ~begun) | again, SOLVED, 0))
    return Weights(chosen, gaps, jnp.where(again, 0.0, away), weights.all_away + lost, weights.rechosen + again)


def following(
    now: Float[Array, " K"], gap: Float[Array, " K"], step: Int[Array, ""], config: MomentConfig
) -> Float[Array, " K"]:
    """θ ← shrink(θ + α (E_E φ − E_π φ)), its norm at most B and never less than before, and B from `sphere` iterations on.

    shrink(θ)_k = θ_k max(0, 1 − α λ / |θ_k|), so that what explains nothing is 0; a θ that would vanish whole is not shrunk.
    The gradient of Eq. 6 has no unit of time, so it is descended plainly: θ adds up the gaps. Without the kept norm θ would
    fall to 0 once the means agree, and chance would say where it goes next.
    """
    moved = now + config.rate * gap
    shrunk = moved * jnp.maximum(0.0, 1.0 - config.rate * config.sparsity / jnp.maximum(jnp.abs(moved), 1e-12))
    new = jnp.where(jnp.linalg.norm(shrunk) > 1e-3, shrunk, moved)
    least = jnp.where(step >= config.sphere, config.norm, jnp.linalg.norm(now))
    size = jnp.linalg.norm(new) + 1e-9
    return new * jnp.clip(size, least, config.norm) / size


def separating(
    gaps: Float[Array, "I K"], otherwise: Float[Array, " K"], config: MomentConfig, steps: int | Int[Array, ""] = SOLVED
) -> Float[Array, " K"]:
    """Choose the fewest features by which demonstrations are worth more, by 1, than each π_k that was unlike them; ‖θ‖ = B.

    argmin_θ ½ Σ_k max(0, 1 − θ · gap_k)² + λ ‖θ‖₁ over the k whose gap is above `near`, λ a share of the least that makes θ 0;
    by accelerated proximal gradient. Following the gaps says what π lacks now; this says what all that it has been lacked, and
    a manner of the demonstrator is not of that, for π had it early. `otherwise` where no π was unlike them, or after 0 steps,
    which cost nothing: under `vmap` too, as long as no seed takes any.
    """
    unlike = (jax.vmap(size_of)(gaps) > config.near).astype(jnp.float32)
    rows = gaps * unlike[:, None]
    steepest = jnp.abs(rows.T @ rows).sum(axis=0).max()  # at least the greatest curvature
    rate = 1.0 / jnp.maximum(steepest, 1e-12)
    penalty = config.selection * jnp.abs(rows.sum(axis=0)).max()

    def step(_: Array, carry: tuple[Array, Array, Array]) -> tuple[Array, Array, Array]:
        theta, ahead, pace = carry
        moved = ahead + rate * (jnp.maximum(0.0, 1.0 - rows @ ahead) @ rows)
        new = jnp.sign(moved) * jnp.maximum(jnp.abs(moved) - rate * penalty, 0.0)
        faster = 0.5 * (1.0 + jnp.sqrt(1.0 + 4.0 * pace**2))
        return new, new + (pace - 1.0) / faster * (new - theta), faster

    zero = jnp.zeros(gaps.shape[1])
    theta, _, _ = jax.lax.fori_loop(0, steps, step, (zero, zero, jnp.ones(())))
    size = jnp.linalg.norm(theta)
    return jnp.where(size > 0, config.norm * theta / jnp.maximum(size, 1e-12), otherwise)


def size_of(gap: Float[Array, " K"]) -> Float[Array, ""]:
    """Root mean square over the features."""
    return jnp.sqrt((gap**2).mean())


def mean_features(nets: BoundNetworks, trajectories: Trajectory) -> Float[Array, " K"]:
    """Mean of φ(s̃) over the unmasked steps of a set, [N, T, …]."""
    phi = jax.vmap(jax.vmap(lambda obs: features(nets.normalise(obs))))(trajectories.obs)
    return jnp.einsum("ntk,nt->k", phi, trajectories.mask) / trajectories.mask.sum()
