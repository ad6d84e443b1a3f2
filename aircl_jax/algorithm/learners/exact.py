"""Plan the policy exactly in tabular worlds with observed states: soft value iteration in place of PPO."""

from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from aircl_jax.algorithm.policy_reward import policy_reward
from aircl_jax.demonstrations.soft_optimal import SoftOptimal, soft_value_iteration
from aircl_jax.methods import Method
from aircl_jax.model.networks import BoundNetworks
from aircl_jax.settings.train_config import TrainConfig
from aircl_jax.types import Metrics, Params, Trajectory
from envs import Env, Tabular


def plannable(env: Env, method: Method, config: TrainConfig) -> Tabular:
    """Return the world's table. Raises ValueError, in one line, for worlds, methods and temperatures that forbid planning."""
    asked = "train.learner=exact"
    if env.tabular is None or not env.finite_horizon:
        raise ValueError(f"{asked}: env={env.name} is no table with an end to plan from; choose ppo, or a grid")
    if not np.array_equal(env.tabular.obs, np.eye(len(env.tabular.start))):
        raise ValueError(f"{asked}: env={env.name} does not show its states; choose ppo, or a world whose obs is its state")
    if method.clones:
        raise ValueError(f"{asked}: the row clones its demonstrations and plans nothing; choose ppo")
    if method.constrained_policy and method.tests_trajectories:
        raise ValueError(f"{asked}: the row pays log δ of whole trajectories, not of steps; choose ppo, or a row that does")
    if method.needs_true_reward and not env.has_reward:
        raise ValueError(f"{asked}: the row needs the true reward and env={env.name} has none; choose ppo")
    if config.temperature == 0:
        raise ValueError(f"train.temperature=0: {asked} plans softly; choose a temperature above 0")
    return env.tabular


def reward_table(nets: BoundNetworks, expert: Trajectory, table: Tabular) -> Float[Array, "X A"]:
    """Compute the policy's reward of each action in each state, without entropy: `policy_reward` of single steps."""
    states, actions = table.reward.shape
    taken = jnp.tile(jnp.arange(actions), states)
    step = jnp.zeros((states * actions, 1))
    every = Trajectory(
        obs=jnp.repeat(table.obs, actions, axis=0)[:, None],
        action=taken[:, None],
        log_prob=step,
        value=step,
        reward=table.reward.reshape(-1, 1),
        cost=jnp.repeat(table.cost, actions)[:, None],
        mask=jnp.ones_like(step),
        bootstrap=step[:, 0],
    )
    return policy_reward(nets, expert, every)[0].reshape(states, actions)


def plan(nets: BoundNetworks, expert: Trajectory, table: Tabular) -> SoftOptimal:
    """π_t(a|x) ∝ exp(Q_t(x, a) / β) and V_t = β log Σ_a exp(Q_t / β), Q_t = r + E[V_{t+1}], of the row's own reward.

    β is the entropy's weight in the policy's reward.
    """
    reward = reward_table(nets, expert, table)
    return soft_value_iteration(table, reward, nets.env.horizon, nets.networks.entropy_weight, forbid=False)


def update(nets: BoundNetworks, expert: Trajectory, table: Tabular, moves: Any = True) -> tuple[Params, Metrics]:
    """Line 7: π and V become those of the `plan`. Both tables stay unchanged where `moves` is False."""
    made = plan(nets, expert, table)
    planned = nets.params._replace(policy=_as_params(made.log_policy), value=_as_params(made.soft_value[..., None]))
    params = jax.tree.map(lambda new, old: jnp.where(moves, new, old), planned, nets.params)
    return params, {"policy_loss": -table.start @ made.soft_value[0]}


def _as_params(table: Float[Array, "T X O"]) -> dict[str, Any]:
    """Wrap the table as the parameters of a `model.modules.Table`."""
    return {"params": {"table": table}}
