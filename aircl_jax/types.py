"""What flows through the spine. Axis letters: S seeds, N trajectories, T steps, O observation, A action; others are local.

Everything here describes one seed and, where it can, one trajectory; the batch axes are made by `vmap` at a few visible places.
"""

from typing import Any, NamedTuple

import jax.numpy as jnp
from jaxtyping import Array, Float, Int, PRNGKeyArray, Shaped

ROUNDING = 1e-6  # of a coordinate's mean: what varies less has not moved
STILL_SHARE = 1e-3  # standard deviation of a coordinate that has not, as a share of its mean, or of 1

Metrics = dict[str, Float[Array, "..."]]  # a number of one iteration and seed; scans and vmaps put axes before it


class Trajectory(NamedTuple):
    """One episode τ. The true `reward` and `cost` ride along for evaluation; no learned-reward loss may read them."""

    obs: Float[Array, "*N T O"]
    action: Shaped[Array, "..."]  # [*N, T, *A], as drawn, before the environment clips it
    log_prob: Float[Array, "*N T"]  # log π(a_t|s_t) when it was drawn; 0 in demonstrations
    value: Float[Array, "*N T"]  # V(s_t) when it was drawn; 0 in demonstrations
    reward: Float[Array, "*N T"]  # true r(s_t, a_t, s_{t+1})
    cost: Float[Array, "*N T"]  # true cost, 0 or 1
    mask: Float[Array, "*N T"]  # 1 up to and with the step that terminates, 0 after it
    bootstrap: Float[Array, "*N"]  # V(s_T) where the horizon cut the episode; 0 where it terminated, or the task ends there


class ObsStats(NamedTuple):
    """Mean and standard deviation of the demonstrations' observations, by which the networks see s̃."""

    mean: Float[Array, " O"]
    std: Float[Array, " O"]

    @classmethod
    def of(cls, mean: Float[Array, " O"], std: Float[Array, " O"]) -> "ObsStats":
        """Give a coordinate that hardly moves a share of its own size for standard deviation, so that no rounding is seen."""
        size = jnp.abs(mean)
        still = STILL_SHARE * jnp.where(size > 0, jnp.minimum(size, 1.0), 1.0)
        return cls(mean, jnp.where(std > ROUNDING * size, std, still))


class Thresholds(NamedTuple):
    """log ϑ of the corrected tests: the log density ratio below which a step or a trajectory is infeasible."""

    step: Float[Array, "*N"]
    sequence: Float[Array, "*N"]


class Params(NamedTuple):
    """The four networks' parameters (flax dictionaries), and the thresholds of δ̄ that follow from them and D_E."""

    policy: Any  # π_ω
    value: Any  # V
    reward: Any  # f_θ
    feasibility: Any  # δ̄_φ
    thresholds: Thresholds
    entry_price: Any = None  # [O, A], in rows that test entries: E[log δ₁(s')] of each state and action as π is paid it
    evidence: Any = None  # [2, O], in such rows where tasks share one constraint: n and M of all of them


class TrainState(NamedTuple):
    """All that training carries from one iteration to the next: this, and only this, is checkpointed."""

    params: Params
    ppo_opt: Any  # optax state of (policy, value)
    adversary_opt: Any  # optax state of (reward, feasibility)
    obs_stats: ObsStats
    replay: Trajectory  # of earlier policies, [N, T, …] (N/2 in the rows with a pool): half of the ratio terms' negatives
    key: PRNGKeyArray
    step: Int[Array, ""]


class FeasibilityScores(NamedTuple):
    """What the two factors of δ̄ say of one trajectory, before any reduction over t."""

    step_logit: Float[Array, "*N T"]  # logit of the per-step feasibility; 0 where the method has none
    sequence_logit: Float[Array, "*N"]  # logit of the trajectory-level feasibility; 0 where the method has none
    mask: Float[Array, "*N T"]
    thresholds: Thresholds


class Scores(NamedTuple):
    """What the discriminator and the feasibility say of one trajectory: per step, before any reduction over t."""

    f: Float[Array, "*N T"]  # f_θ(s_t, a_t); the true reward in the rows that know it
    log_pi: Float[Array, "*N T"]  # log π_ω(a_t|s_t)
    step_logit: Float[Array, "*N T"]  # logit of the per-step feasibility; 0 where the method has none
    sequence_logit: Float[Array, "*N"]  # logit of the trajectory-level feasibility; 0 where the method has none
    mask: Float[Array, "*N T"]
    thresholds: Thresholds
