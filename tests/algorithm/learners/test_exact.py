"""The exact learner plans what PPO tends to, on the reward that the row pays."""

from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from aircl_jax import train
from aircl_jax.algorithm.learners import exact
from aircl_jax.algorithm.policy_reward import policy_reward
from aircl_jax.algorithm.rollout import rollouts
from aircl_jax.algorithm.trainer import make_trainer
from aircl_jax.api import load
from aircl_jax.demonstrations.soft_optimal import soft_value_iteration
from aircl_jax.methods import METHODS, Method
from aircl_jax.model.feasibility import SIGMOID_FLOOR
from aircl_jax.settings.train_config import PPOConfig
from envs import make_env
from tests.worlds import (
    KNOWN_REWARD,
    TINY,
    expected_return,
    random_trajectories,
    table_of,
    tiny_grid,
    tiny_networks,
    unit_stats,
)

PLANNED = replace(TINY, learner="exact")
# A row that is paid the true reward and the log δ₁ that a linear network is told.
TOLD = Method(reward="true", discriminator_of="none", feasibility="step", terms=(), constrained_policy=True, network="linear")


def told_the_truth(state, table):
    """The state with δ₁ = 1 in what is allowed and 0, as far as the floor goes, in what is forbidden."""
    kernel = jnp.concatenate([30.0 - 1030.0 * table.forbidden, jnp.zeros(4)])[:, None]
    feasibility = {"step": {"params": {"Dense_0": {"kernel": kernel, "bias": jnp.zeros(1)}}}}
    params = state.params._replace(feasibility=feasibility)
    return state._replace(params=params, obs_stats=unit_stats(tiny_grid()))


def planned(env, method, config=PLANNED, truth=False):
    """The networks after one step of training."""
    trainer, expert = make_trainer(env, method, config), random_trajectories(env, 0, 3)
    state = jax.jit(trainer.init)(jax.random.key(0), expert)
    state = told_the_truth(state, table_of(env)) if truth else state
    state, metrics = jax.jit(trainer.step)(state, expert)
    return trainer.networks.bind(state.params, state.obs_stats), metrics


def policy_of(nets):
    """log π [T, X, A] as the networks act."""
    states = jnp.eye(nets.env.obs_size)
    at = jax.vmap(lambda t: jax.vmap(lambda obs: nets.policy(obs, t).logits)(states))
    return jax.nn.log_softmax(at(jnp.arange(nets.env.horizon)), axis=-1)


def test_the_policy_of_the_true_reward_is_soft_value_iteration():
    env = tiny_grid(slip=0.1)
    nets, metrics = planned(env, KNOWN_REWARD)
    plan = soft_value_iteration(table_of(env), table_of(env).reward, 4, 1.0, forbid=False)
    np.testing.assert_allclose(jnp.exp(policy_of(nets)), jnp.exp(plan.log_policy), atol=1e-6)
    np.testing.assert_allclose(metrics["policy_loss"], -plan.soft_value[0, 0], rtol=1e-6)
    values = jax.vmap(lambda obs: nets.value(obs, jnp.asarray(1)))(jnp.eye(9))
    np.testing.assert_allclose(values, plan.soft_value[1], rtol=1e-6)
    assert nets.value(jnp.eye(9)[0], jnp.asarray(4)) == 0.0  # nothing is worth anything past the horizon


def test_the_policy_of_the_true_reward_and_constraint_is_soft_value_iteration_at_the_floor_of_log_delta():
    env = tiny_grid(slip=0.1)
    table = table_of(env)
    nets, _ = planned(env, TOLD, truth=True)
    paid = table.reward + SIGMOID_FLOOR * table.forbidden[:, None]
    plan = soft_value_iteration(table, paid, 4, 1.0, forbid=False)
    np.testing.assert_allclose(jnp.exp(policy_of(nets)), jnp.exp(plan.log_policy), atol=1e-6)
    assert jnp.exp(policy_of(nets))[0, 1, 2] < 1e-2  # down from [0, 1], into the obstacle


def test_the_temperature_is_that_of_the_entropy_that_the_row_is_paid():
    env = tiny_grid()
    nets, _ = planned(env, KNOWN_REWARD, replace(PLANNED, temperature=3.0))
    plan = soft_value_iteration(table_of(env), table_of(env).reward, 4, 3.0, forbid=False)
    np.testing.assert_allclose(jnp.exp(policy_of(nets)), jnp.exp(plan.log_policy), atol=1e-6)


@pytest.mark.parametrize("method", ["aircl_corrected_sa", "airl_centred", "icrl", "aircl"])
def test_the_table_holds_what_a_rollout_is_paid_for_the_same_steps(method):
    env = tiny_grid(slip=0.0)  # so that every reward is the expected one
    nets, params = tiny_networks(env, method, PLANNED)
    ours, expert = nets.bind(params, unit_stats(env)), random_trajectories(env, 0, 3)
    episodes = rollouts(ours, jax.random.key(1), 5)
    paid, _ = policy_reward(ours, expert, episodes)
    entropy = -nets.entropy_weight * episodes.log_prob
    table = exact.reward_table(ours, expert, table_of(env))
    np.testing.assert_allclose(table[episodes.obs.argmax(-1), episodes.action], paid - entropy, atol=1e-5)


def test_before_it_may_move_the_policy_stays_as_it_began():
    nets, _ = planned(tiny_grid(), KNOWN_REWARD, replace(PLANNED, policy_delay=1))
    np.testing.assert_allclose(jnp.exp(policy_of(nets)), 0.25, rtol=1e-6)


def test_a_table_can_be_a_clone_of_demonstrations_first():
    config = replace(PLANNED, policy_delay=1, clone_epochs=30, clone_learning_rate=0.1)
    expert = random_trajectories(tiny_grid(), 0, 3)
    nets, _ = planned(tiny_grid(), KNOWN_REWARD, config)
    assert jnp.exp(jax.vmap(nets.log_pi)(expert))[expert.mask > 0].mean() > 0.6


@pytest.mark.parametrize(
    ("env", "method", "changes", "line"),
    [
        ("nonmarkov", "airl", {}, "env=nonmarkov does not show its states"),
        ("labyrinth", "airl", {}, "env=labyrinth is no table with an end to plan from"),
        ("swimmer", "airl", {}, "env=swimmer is no table"),
        ("gridworld", "bc", {}, "the row clones its demonstrations"),
        ("gridworld", "aircl_corrected", {}, "the row pays log δ of whole trajectories"),
        ("gridworld", "airl_centred", {"temperature": 0.0}, "train.temperature=0"),
    ],
)
def test_what_no_table_can_plan_is_refused_in_one_line(env, method, changes, line):
    settings = {"data": "simulated"} if env == "labyrinth" else {}
    with pytest.raises(ValueError, match=line) as error:
        make_trainer(make_env(env, **settings), METHODS[method], replace(PLANNED, **changes))
    assert "\n" not in str(error.value)


@pytest.mark.slow
def test_a_run_is_trained_drawn_and_loaded(tmp_path):
    config = {"learner": "exact", "num_trajectories": 6, "num_demonstrations": 5, "num_evaluation": 5, "hidden": [4]}
    settings = {"size": 3, "goal": [2, 2], "obstacles": [[1, 1]], "horizon": 4}
    run = {"env_settings": settings, "method": "aircl_corrected_sa", "seeds": 1, "iterations": 2, "config": config}
    result = train("gridworld", **run, run_dir=tmp_path / "run")
    for one, other in zip(*(jax.tree.leaves(each.states.params) for each in (result, load(tmp_path / "run"))), strict=True):
        np.testing.assert_array_equal(one, other)
    assert (tmp_path / "run" / "figures" / "paths.png").exists()


@pytest.mark.slow
def test_ppo_tends_to_the_plan_of_reward_and_constraint():
    env = tiny_grid(slip=0.1)
    table, expert = table_of(env), random_trajectories(env, 0, 3)
    config = replace(TINY, num_trajectories=200, hidden=(32, 32), ppo=PPOConfig(discount=1.0, learning_rate=2e-3))
    trainer = make_trainer(env, TOLD, config)

    @jax.jit
    def learned(key):
        state = told_the_truth(trainer.init(key, expert), table)
        return jax.lax.scan(lambda state, _: (trainer.step(state, expert)[0], None), state, length=300)[0].params

    log_policy = policy_of(trainer.networks.bind(learned(jax.random.key(0)), unit_stats(env)))
    plan = policy_of(planned(env, TOLD, truth=True)[0])
    paid = table.reward + SIGMOID_FLOOR * table.forbidden[:, None]
    returns = [expected_return(table, one, paid) for one in (log_policy, plan)]
    np.testing.assert_allclose(*returns, rtol=0.03)
    np.testing.assert_allclose(jnp.exp(log_policy[0, 0]), jnp.exp(plan[0, 0]), atol=0.05)
