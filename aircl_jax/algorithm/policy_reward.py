"""Compute the policy's reward from the learned functions, after the rollout and outside the world."""

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from aircl_jax.algorithm.masks import mean_over_steps
from aircl_jax.model.feasibility import SIGMOID_FLOOR, log_sequence_feasibility, log_step_feasibility
from aircl_jax.model.networks import BoundNetworks
from aircl_jax.types import Trajectory


def policy_reward(
    nets: BoundNetworks, expert: Trajectory, policy: Trajectory
) -> tuple[Float[Array, "N T"], Float[Array, " N"]]:
    """r_t = f(s_t, a_t) [− mean_E f] [+ log δ₁(s_t, a_t)] − β log π(a_t|s_t), and the trajectory's bonus log δ_seq − mean.

    log δ₁ is at least −11.5, which stands for −∞ in the paper's rows. The entropy is causal and inside the reward (J + H of
    Section 3.1). β = 1 in the paper's rows with a learned f. Rows with a centred discriminator or a reward of states subtract
    the constant mean_E f, which moves no optimum and keeps the critic's targets near zero. Rows that test entries pay
    E[log δ₁(s_{t+1})] in place of log δ₁(s_t, a_t).
    """
    method, coefficients = nets.method, nets.config.coefficients
    scores = jax.vmap(nets.scores)(policy, policy.log_prob)
    reward = scores.f
    if method.centred or method.state_reward:
        expert_f = jax.vmap(nets.f)(expert)
        reward = reward - mean_over_steps(expert_f, expert.mask).mean()
    if nets.params.entry_price is not None:
        taken = jax.vmap(jax.vmap(nets.env.action_space.features))(policy.action)
        reward = reward + ((policy.obs @ nets.params.entry_price) * taken).sum(axis=-1)
    elif method.constrained_policy:
        reward = reward + jnp.maximum(log_step_feasibility(method, coefficients, scores), SIGMOID_FLOOR)
    reward = (reward - nets.networks.entropy_weight * policy.log_prob) * policy.mask

    if not (method.constrained_policy and method.tests_trajectories):
        return reward, jnp.zeros(reward.shape[0])
    log_sequence = log_sequence_feasibility(method, coefficients, scores)
    return reward, log_sequence - log_sequence.mean()
