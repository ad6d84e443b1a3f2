"""The reward that drives the policy, computed after the rollout from the learned functions (never wrapped into the world)."""

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from aircl_jax.algorithm.masks import mean_over_steps
from aircl_jax.model.feasibility import SIGMOID_FLOOR, log_sequence_feasibility, log_step_feasibility
from aircl_jax.model.networks import Networks
from aircl_jax.types import ObsStats, Params, Trajectory


def policy_reward(
    nets: Networks, params: Params, stats: ObsStats, expert: Trajectory, policy: Trajectory
) -> tuple[Float[Array, "N T"], Float[Array, " N"]]:
    """r_t = f(s_t, a_t) [− mean_E f] [+ log δ₁(s_t, a_t)] − β log π(a_t|s_t), and the trajectory's credit log δ_seq − mean.

    log δ₁ is at least −11.5, where a verdict of the paper's rows means −∞. The entropy is causal and inside the reward (J + H
    of Section 3.1). β = 1 in the paper's rows with a learned f; the constant mean_E f, of a centred judge, moves no optimum and
    keeps the critic's targets near zero.
    """
    method, coefficients = nets.method, nets.config.coefficients
    scores = jax.vmap(nets.scores, (None, None, 0, 0))(params, stats, policy, policy.log_prob)
    reward = scores.f
    if method.judge == "centred":
        expert_f = jax.vmap(nets.f, (None, None, 0))(params, stats, expert)
        reward = reward - mean_over_steps(expert_f, expert.mask).mean()
    if method.constrained_policy:
        reward = reward + jnp.maximum(log_step_feasibility(method, coefficients, scores), SIGMOID_FLOOR)
    reward = (reward - nets.entropy_weight * policy.log_prob) * policy.mask

    if not (method.constrained_policy and "sequence" in method.feasibility):
        return reward, jnp.zeros(reward.shape[0])
    log_sequence = log_sequence_feasibility(method, coefficients, scores)
    return reward, log_sequence - log_sequence.mean()
