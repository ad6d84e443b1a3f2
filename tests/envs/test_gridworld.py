"""The grid worlds are as defined: layout, dynamics, reward, cost, and what their experts do."""

from itertools import combinations

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from aircl_jax.demonstrations.soft_optimal import occupancy, sample_table, soft_value_iteration
from envs import make_env
from tests.worlds import table_of

UP, RIGHT, DOWN, LEFT = range(4)
OBSTACLES = {(1, 1), (0, 4), (2, 3), (4, 1), (4, 4)}


def grid(**settings):
    return make_env("gridworld", **settings)


def cell(row, column, size=6):
    return row * size + column


def monotone_paths():
    """Every shortest path from [0, 0] to [5, 5], as its eleven cells."""
    for downs in combinations(range(10), 5):
        moves = np.array([[1, 0] if t in downs else [0, 1] for t in range(10)])
        yield [tuple(one) for one in np.cumsum(np.vstack([[0, 0], moves]), axis=0).tolist()]


def expert_policy(env, forbid=True):
    return soft_value_iteration(table_of(env), table_of(env).reward, env.horizon, 1.0, forbid).log_policy


@pytest.mark.parametrize(
    ("start", "action", "end"),
    [
        ((2, 2), UP, (1, 2)),
        ((2, 2), RIGHT, (2, 3)),
        ((2, 2), DOWN, (3, 2)),
        ((2, 2), LEFT, (2, 1)),
        ((0, 0), UP, (0, 0)),  # off the grid: stays
        ((0, 0), LEFT, (0, 0)),
        ((5, 5), UP, (5, 5)),  # the goal absorbs
    ],
)
def test_moves_without_slip_are_up_right_down_left_and_stay_at_the_edge(start, action, end):
    env = grid(slip=0.0)
    state, step = env.step(jax.random.key(0), jnp.asarray(cell(*start)), jnp.asarray(action))
    assert state == cell(*end)
    np.testing.assert_array_equal(step.obs, np.eye(36)[cell(*end)])


def test_slip_replaces_the_action_by_a_uniform_one_with_its_probability():
    row = table_of(grid(slip=0.2)).transition[cell(2, 2), UP]
    expected = {(1, 2): 0.85, (2, 3): 0.05, (3, 2): 0.05, (2, 1): 0.05}
    assert {(int(i) // 6, int(i) % 6) for i in np.flatnonzero(row)} == set(expected)
    np.testing.assert_allclose([row[cell(*end)] for end in expected], list(expected.values()), rtol=1e-6)


def test_steps_are_drawn_from_the_table():
    env = grid(slip=0.4)
    keys = jax.random.split(jax.random.key(0), 20_000)
    state, _ = jax.jit(jax.vmap(env.step, (0, None, None)))(keys, jnp.asarray(cell(0, 2)), jnp.asarray(UP))
    frequency = np.bincount(np.asarray(state), minlength=36) / 20_000
    np.testing.assert_allclose(frequency, table_of(env).transition[cell(0, 2), UP], atol=0.012)  # 3.5 σ


@pytest.mark.parametrize(
    ("start", "action", "reward"), [((2, 2), RIGHT, 5.0), ((2, 2), UP, -5.0), ((0, 0), UP, 0.0), ((5, 5), DOWN, 0.0)]
)
def test_reward_is_five_per_unit_of_manhattan_distance_gained(start, action, reward):
    _, step = grid(slip=0.0).step(jax.random.key(0), jnp.asarray(cell(*start)), jnp.asarray(action))
    assert step.reward == reward
    assert step.terminated == 0.0


def test_expected_reward_of_the_table_is_the_mean_of_the_steps():
    env = grid(slip=0.3)
    table = table_of(env)
    distance = 10 - np.indices((6, 6)).sum(axis=0).ravel()
    gain = 5.0 * (distance[:, None] - distance)
    np.testing.assert_allclose(table.reward, np.einsum("xay,xy->xa", table.transition, gain), atol=1e-5)


@pytest.mark.parametrize(("at", "cost"), [((1, 1), 1.0), ((1, 0), 0.0), ((4, 4), 1.0)])
def test_cost_is_one_in_the_step_whose_state_is_an_obstacle_and_not_in_the_one_that_enters(at, cost):
    # From [1, 0] the action enters the obstacle [1, 1]; the cost belongs to the next step.
    _, step = grid(slip=0.0).step(jax.random.key(0), jnp.asarray(cell(*at)), jnp.asarray(RIGHT))
    assert step.cost == cost


def test_23_of_252_monotone_paths_are_clean_and_all_tie_in_return():
    paths = list(monotone_paths())
    clean = [path for path in paths if OBSTACLES.isdisjoint(path)]
    assert (len(paths), len(clean)) == (252, 23)
    blocked = np.flatnonzero(table_of(grid()).forbidden)
    assert {(int(i) // 6, int(i) % 6) for i in blocked} == OBSTACLES


def test_expert_violates_in_a_thousandth_of_steps_and_reaches_the_goal_in_nine_of_ten_episodes():
    env = grid()
    log_policy = expert_policy(env)
    episodes = jax.jit(lambda key: sample_table(env, log_policy, key, 4000))(jax.random.key(0))
    at_goal = (episodes.reward.sum(axis=1) >= 50 - 1e-3).mean()
    assert 0.0002 < (occupancy(table_of(env), log_policy) @ table_of(env).cost).mean() < 0.002
    assert 0.87 < at_goal < 0.93


def test_unconstrained_soft_optimal_policy_violates_in_16_percent_of_steps():
    env = grid()
    rate = (occupancy(table_of(env), expert_policy(env, forbid=False)) @ table_of(env).cost).mean()
    np.testing.assert_allclose(rate, 0.16, atol=0.01)


def test_visiting_zone_b_costs_only_after_zone_a():
    env = make_env("nonmarkov", slip=0.0)

    def total_cost(moves):
        state, _ = env.reset(jax.random.key(0))
        cost = 0.0
        for action in moves:
            state, step = env.step(jax.random.key(0), state, jnp.asarray(action))
            cost += float(step.cost)
        return cost

    through_a_then_b = [RIGHT, RIGHT, DOWN, DOWN, DOWN, RIGHT, RIGHT, DOWN]  # [1, 2] … [3, 4], and one step in it
    past_a_through_b = [RIGHT, RIGHT, RIGHT, DOWN, DOWN, DOWN, RIGHT, DOWN]
    assert (total_cost(through_a_then_b), total_cost(past_a_through_b)) == (1.0, 0.0)


def test_who_starts_in_zone_a_has_seen_it():
    env = make_env("nonmarkov", slip=0.0, zone_a=[[0, 0]], zone_b=[[0, 1]])
    state, _ = env.reset(jax.random.key(0))
    state, _ = env.step(jax.random.key(0), state, jnp.asarray(RIGHT))
    assert env.step(jax.random.key(0), state, jnp.asarray(RIGHT))[1].cost == 1.0


def test_the_reward_does_not_know_whether_zone_a_was_seen():
    reward = table_of(make_env("nonmarkov", slip=0.2)).reward
    for half in (reward[:36], reward[36:]):
        np.testing.assert_allclose(half, table_of(grid(slip=0.2)).reward, atol=1e-5)


def test_the_whole_return_is_that_of_the_way_from_start_to_goal_in_units_of_the_reward():
    assert grid().success_return == 5.0 * 10
    assert grid(start=[0, 2], goal=[3, 5], reward_scale=0.5).success_return == 0.5 * 6


def test_the_learned_reward_sees_row_and_column():
    view = grid().reward_view(jnp.eye(36)[cell(2, 4)])
    np.testing.assert_array_equal(view, np.concatenate([np.eye(6)[2], np.eye(6)[4]]))


def test_nonmarkov_observation_hides_whether_zone_a_was_seen():
    table = table_of(make_env("nonmarkov"))
    np.testing.assert_array_equal(table.obs[:36], table.obs[36:])


def test_70_percent_of_unconstrained_nonmarkov_trajectories_are_infeasible():
    env = make_env("nonmarkov")
    log_policy = expert_policy(env, forbid=False)
    episodes = jax.jit(lambda key: sample_table(env, log_policy, key, 4000))(jax.random.key(0))
    np.testing.assert_allclose(episodes.cost.max(axis=1).mean(), 0.70, atol=0.04)


@pytest.mark.parametrize(
    ("name", "settings", "named"),
    [
        ("gridworld", {"obstacles": [[0, 0]]}, "start"),
        ("gridworld", {"obstacles": [[5, 5]]}, "goal"),
        ("gridworld", {"obstacles": [[6, 0]]}, r"\[6, 0\]"),
        ("gridworld", {"obstacles": [[-1, 0]]}, r"\[-1, 0\]"),
        ("gridworld", {"obstacles": [[0, 1], [1, 0]]}, "no clean path"),
        ("gridworld", {"horizon": 9}, "no clean path"),
        ("gridworld", {"horizon": 0}, "env.horizon=0"),
        ("gridworld", {"slip": 1.5}, "env.slip=1.5"),
        ("gridworld", {"start": [5, 5]}, "env.start"),
        ("gridworld", {"size": 1}, "env.size=1"),
        ("gridworld", {"temperature": 0.0}, "env.temperature"),
        ("gridworld", {"colour": "red"}, "env.colour"),
        ("nonmarkov", {"zone_b": [[1, 2]]}, "zone_a and env.zone_b share"),
        ("nonmarkov", {"zone_a": [[9, 9]]}, r"env.zone_a: \[9, 9\]"),
        ("maze", {}, "unknown env 'maze'"),
    ],
)
def test_bad_layouts_are_refused_in_one_line_that_names_the_setting(name, settings, named):
    with pytest.raises(ValueError, match=named) as error:
        make_env(name, **settings)
    assert "\n" not in str(error.value)
