"""Where demonstrations come from: exact soft-optimal experts of tabular worlds, shipped files for the robots."""

from collections.abc import Sequence
from importlib import resources
from typing import NamedTuple, cast

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, PRNGKeyArray

from aircl_jax.config import TrainConfig
from aircl_jax.demonstrations import from_arrays, load
from aircl_jax.types import Trajectory
from envs import Env, Tabular

FORBIDDEN_LOGIT = -1e3  # stands for −∞: e^−1000 is 0 in float32, and 0 × −1000 stays 0


class SoftOptimal(NamedTuple):
    """π*_t(a|x) = exp((Q_t(x, a) − V_t(x)) / temperature) and its value from the start."""

    log_policy: Float[Array, "T X A"]
    soft_value: Float[Array, "T X"]


def soft_value_iteration(
    table: Tabular, reward: Float[Array, "X A"], horizon: int, temperature: float, forbid: bool
) -> SoftOptimal:
    """Backward in t: Q_t = r + E[V_{t+1}], V_t = temperature · log Σ_a exp(Q_t / temperature), V_T = 0 (Ziebart 2010).

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


def occupancy(table: Tabular, log_policy: Float[Array, "T X A"]) -> Float[Array, "T X"]:
    """P(x_t = x) under a time-dependent policy, exactly, forward in t."""

    def forward(state: Float[Array, " X"], step_log_policy: Float[Array, "X A"]) -> tuple[Array, Array]:
        flow = jnp.einsum("x,xa,xay->y", state, jnp.exp(step_log_policy), table.transition)
        return flow, state

    return jax.lax.scan(forward, table.start, log_policy)[1]


def sample_table(env: Env, log_policy: Float[Array, "T X A"], key: PRNGKeyArray, number: int) -> Trajectory:
    """`number` episodes of a time-dependent policy over a tabular world's states, [N, T, …]; log_prob and value are 0."""

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


REFERENCE_SIZE = 500  # trajectories of a tabular world's reference set
REFERENCE_SEED = 2_147_483_646  # of its key: no run's seed
PERTURBATION = 0.1  # share of uniform actions in the reference set's perturbed experts


def demonstrations(env: Env, seeds: Sequence[int], config: TrainConfig) -> tuple[Trajectory, Trajectory]:
    """D_E of every seed, [S, N, T, …], and the environment's reference set, [M, T, …].

    A grid's D_E is drawn from its exact expert, anew for each seed; an animal's is its recorded data and a robot's is
    shipped, the same for all seeds. Where nothing is known to score by, D_E itself stands for the reference set.
    """
    if env.recorded is not None:
        recorded = from_arrays(env.recorded.demonstrations(), env)
        known = env.recorded.reference
        return _for_all(recorded, len(seeds)), recorded if known is None else from_arrays(known(), env)
    if env.tabular is not None:
        table, horizon, temperature = env.tabular, env.horizon, env.expert_temperature
        expert = soft_value_iteration(table, table.reward, horizon, temperature, forbid=True)
        keys = jax.vmap(lambda seed: jax.random.fold_in(jax.random.key(seed), 1))(jnp.asarray(seeds, jnp.uint32))
        draw = jax.jit(jax.vmap(lambda key: sample_table(env, expert.log_policy, key, config.num_demonstrations)))
        return draw(keys), tabular_reference(env, expert)
    if env.demonstrations is None:
        raise ValueError(f"env={env.name} ships no demonstrations of these settings; give some with demonstrations=FILE")
    shipped = load_shipped(env.demonstrations, env)
    if config.num_demonstrations > len(shipped.mask):
        asked = f"train.num_demonstrations={config.num_demonstrations}"
        raise ValueError(f"{asked}: env={env.name} ships {len(shipped.mask)}; choose at most that")
    expert = _first(shipped, config.num_demonstrations)
    return _for_all(expert, len(seeds)), load_shipped(f"{env.demonstrations}_reference", env)


def tabular_reference(env: Env, expert: SoftOptimal) -> Trajectory:
    """Half from the unconstrained soft-optimal policy, half from the expert with a tenth of its actions uniform."""
    table, half = cast(Tabular, env.tabular), REFERENCE_SIZE // 2
    free = soft_value_iteration(table, table.reward, env.horizon, env.expert_temperature, forbid=False)
    uniform = jnp.log(PERTURBATION / table.reward.shape[1])
    perturbed = jnp.logaddexp(jnp.log1p(-PERTURBATION) + expert.log_policy, uniform)
    key_free, key_perturbed = jax.random.split(jax.random.key(REFERENCE_SEED))
    halves = (
        sample_table(env, free.log_policy, key_free, half),
        sample_table(env, perturbed, key_perturbed, REFERENCE_SIZE - half),
    )
    return jax.tree.map(lambda *leaves: jnp.concatenate(leaves), *halves)


def load_shipped(name: str, env: Env) -> Trajectory:
    """A set of trajectories that the package ships, envs/demonstrations/NAME.npz."""
    with resources.as_file(resources.files("envs") / "demonstrations" / f"{name}.npz") as path:
        return load(path, env)


def _for_all(trajectories: Trajectory, num_seeds: int) -> Trajectory:
    return jax.tree.map(lambda leaf: jnp.broadcast_to(leaf, (num_seeds, *leaf.shape)), trajectories)


def _first(trajectories: Trajectory, number: int) -> Trajectory:
    return jax.tree.map(lambda leaf: leaf[:number], trajectories)
