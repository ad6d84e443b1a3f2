from itertools import product

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from aircl_jax.demonstrations.soft_optimal import occupancy, sample_table, soft_value_iteration
from envs import make_env
from tests.worlds import expected_return, table_of

HORIZON = 3


def square(slip=0.0):
    """A 2×2 grid from [0, 0] to [1, 1] with an obstacle in [0, 1]."""
    return make_env("gridworld", size=2, goal=[1, 1], obstacles=[[0, 1]], horizon=HORIZON, slip=slip, reward_scale=1.0)


def enumerate_square(temperature, forbid):
    """Every action sequence of the deterministic square, with p(τ) ∝ exp(r(τ)) δ(τ) of Eq. 1 and 5, by hand."""
    weight = {}
    for actions in product(range(4), repeat=HORIZON):
        at, total, feasible = (0, 0), 0.0, 1.0
        for action in actions:
            step = ((-1, 0), (0, 1), (1, 0), (0, -1))[action]
            moved = tuple(min(max(here + by, 0), 1) for here, by in zip(at, step, strict=True))
            new = at if at == (1, 1) else moved
            total += sum(new) - sum(at)  # one per unit of distance to [1, 1] gained
            feasible *= new != (0, 1)
            at = new
        weight[actions] = np.exp(total / temperature) * (feasible if forbid else 1.0)
    partition = sum(weight.values())
    return {actions: one / partition for actions, one in weight.items()}, partition


@pytest.mark.parametrize("forbid", [False, True])
@pytest.mark.parametrize("temperature", [1.0, 0.5])
def test_soft_optimal_policy_draws_trajectories_by_equations_1_and_5(temperature, forbid):
    env = square()
    probability, partition = enumerate_square(temperature, forbid)
    table = jax.tree.map(np.asarray, table_of(env))
    expert = soft_value_iteration(table_of(env), table_of(env).reward, HORIZON, temperature, forbid)
    log_policy = np.asarray(expert.log_policy)
    for actions, expected in probability.items():
        state, log_probability = 0, 0.0
        for t, action in enumerate(actions):
            log_probability += log_policy[t, state, action]
            state = int(table.transition[state, action].argmax())
        np.testing.assert_allclose(np.exp(log_probability), expected, rtol=1e-4, atol=1e-7)
    np.testing.assert_allclose(expert.soft_value[0, 0], temperature * np.log(partition), rtol=1e-5)


def test_soft_value_is_expected_return_plus_entropy_under_slip():
    env = square(slip=0.3)
    table, temperature = table_of(env), 0.7
    expert = soft_value_iteration(table, table.reward, HORIZON, temperature, forbid=False)
    flow = occupancy(table, expert.log_policy)[:, :, None] * jnp.exp(expert.log_policy)
    entropy = -(flow * expert.log_policy).sum()
    total = expected_return(table, expert.log_policy, table.reward) + temperature * entropy
    np.testing.assert_allclose(expert.soft_value[0, 0], total, rtol=1e-5)


def test_occupancy_and_expected_return_are_those_of_sampled_episodes():
    env = square(slip=0.3)
    table = table_of(env)
    log_policy = soft_value_iteration(table, table.reward, HORIZON, 1.0, forbid=False).log_policy
    episodes = jax.jit(lambda key: sample_table(env, log_policy, key, 20_000))(jax.random.key(0))
    np.testing.assert_allclose(episodes.obs.mean(axis=0), occupancy(table, log_policy), atol=0.015)
    exact = expected_return(table, log_policy, table.reward)
    np.testing.assert_allclose(episodes.reward.sum(axis=1).mean(), exact, atol=0.03)


def test_occupancy_is_a_distribution_at_every_step():
    env = square(slip=0.3)
    log_policy = jnp.full((HORIZON, 4, 4), jnp.log(0.25))
    np.testing.assert_allclose(occupancy(table_of(env), log_policy).sum(axis=1), 1.0, rtol=1e-5)


def test_expert_never_chooses_to_enter_what_is_forbidden():
    env = make_env("gridworld")
    table = table_of(env)
    expert = soft_value_iteration(table, table.reward, env.horizon, 1.0, forbid=True)
    enters = np.asarray(table.forbidden)[np.asarray(table.transition).argmax(axis=-1)] > 0
    assert np.exp(np.asarray(expert.log_policy))[:, enters].max() == 0.0


def test_sampled_episodes_start_at_the_start_and_never_end_early():
    env = square()
    log_policy = jnp.full((HORIZON, 4, 4), jnp.log(0.25))
    episodes = sample_table(env, log_policy, jax.random.key(0), 3)
    np.testing.assert_array_equal(episodes.obs[:, 0], np.eye(4)[[0, 0, 0]])
    np.testing.assert_array_equal(episodes.mask, 1.0)
