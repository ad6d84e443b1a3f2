"""Plan soft-optimally and exactly in a tabular world."""

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, PRNGKeyArray

from aircl_jax.types import Trajectory
from envs import Env, SoftOptimalExpert, Tabular

FORBIDDEN_LOGIT = -1e3  # stands for −∞: e^−1000 is 0 in float32, and 0 × −1000 stays 0


class SoftOptimal(NamedTuple):
    """π*_t(a|x) = exp((Q_t(x, a) − V_t(x)) / temperature) and its value from the start."""

    log_policy: Float[Array, "T X A"]
    soft_value: Float[Array, "T X"]


def soft_value_iteration(
    table: Tabular, reward: Float[Array, "X A"], horizon: int, temperature: float, forbid: bool
) -> SoftOptimal:
    """Plan backward in t: Q_t = r + E[V_{t+1}], V_t = temperature · log Σ_a exp(Q_t / temperature), V_T = 0 (Ziebart 2010).

    With `forbid`, actions whose intended successor is forbidden have probability 0; process noise may still slip into it.
    """
    intended = jnp.argmax(table.transition, axis=-1)
    barred = table.forbidden[intended] * FORBIDDEN_LOGIT if forbid else jnp.zeros_like(reward)

    def backup(value_next: Float[Array, " X"], _: None) -> tuple[Float[Array, " X"], tuple[Array, Array]]:
        q = reward + table.transition @ value_next
        logits = q / temperature + barred
        value = temperature * jax.nn.logsumexp(logits, axis=-1)
        return value, (jax.nn.log_softmax(logits, axis=-1), value)

    _, (log_policy, value) = jax.lax.scan(backup, jnp.zeros(len(reward)), None, length=horizon, reverse=True)
    return SoftOptimal(log_policy, value)


def lapsing(log_policy: Float[Array, "T X A"], share: float) -> Float[Array, "T X A"]:
    """log ((1 − share) π + share / A): the policy with a share of its actions uniformly random."""
    return jnp.logaddexp(jnp.log1p(-share) + log_policy, jnp.log(share / log_policy.shape[-1]))


def plan_expert(env: Env, planner: SoftOptimalExpert) -> Float[Array, "T X A"]:
    """log π of the exact expert that demonstrates, with its lapses."""
    plan = soft_value_iteration(planner.table, planner.table.reward, env.horizon, planner.temperature, forbid=True)
    return lapsing(plan.log_policy, planner.lapse) if planner.lapse else plan.log_policy


def occupancy(table: Tabular, log_policy: Float[Array, "T X A"]) -> Float[Array, "T X"]:
    """Compute P(x_t = x) under a time-dependent policy, exactly, forward in t."""

    def forward(state: Float[Array, " X"], step_log_policy: Float[Array, "X A"]) -> tuple[Array, Array]:
        flow = jnp.einsum("x,xa,xay->y", state, jnp.exp(step_log_policy), table.transition)
        return flow, state

    return jax.lax.scan(forward, table.start, log_policy)[1]


def sample_table(env: Env, log_policy: Float[Array, "T X A"], key: PRNGKeyArray, number: int) -> Trajectory:
    """Draw `number` episodes [N, T, …] of a time-dependent policy in a tabular world; log_prob and value are 0."""

    def episode(key: PRNGKeyArray) -> Trajectory:
        key_reset, key_steps = jax.random.split(key)
        state, obs = env.reset(key_reset)

        def one_step(carry: tuple, inputs: tuple[Array, Array]) -> tuple[tuple, Trajectory]:
            state, obs = carry
            step_log_policy, key_step = inputs
            key_action, key_env = jax.random.split(key_step)
            action = jax.random.categorical(key_action, step_log_policy[state])
            state, step = env.step(key_env, state, action)
            zero = jnp.zeros(())
            return (state, step.obs), Trajectory(obs, action, zero, zero, step.reward, step.cost, jnp.ones(()), zero)

        keys = jax.random.split(key_steps, env.horizon)
        trajectory = jax.lax.scan(one_step, (state, obs), (log_policy, keys))[1]
        return trajectory._replace(bootstrap=jnp.zeros(()))

    return jax.vmap(episode)(jax.random.split(key, number))
