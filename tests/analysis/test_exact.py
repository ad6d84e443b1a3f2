"""Exact plans, evaluation, the distance of rewards and the true temptation: by hand, by loops, and by the planner in JAX."""

from itertools import product

import numpy as np
import pytest

from aircl_jax.analysis import exact
from aircl_jax.analysis.exact import World
from aircl_jax.demonstrations.soft_optimal import soft_value_iteration
from envs import make_env
from tests.worlds import table_of, tiny_grid

UP, RIGHT, DOWN, LEFT = range(4)


def grid(**settings) -> tuple[World, int]:
    env = tiny_grid(**settings)
    return exact.world_of(table_of(env)), env.horizon


def corridor() -> World:
    """Three states in a row, moves left and right with certainty; the last absorbs, the middle one is forbidden."""
    transition = np.zeros((3, 2, 3))
    for state, (left, right) in enumerate([(0, 1), (0, 2), (2, 2)]):
        transition[state, 0, left] = transition[state, 1, right] = 1.0
    reward = np.array([[0.0, 0.0], [1.0, 1.0], [2.0, 2.0]])
    return World(transition, reward, np.array([1.0, 0.0, 0.0]), np.array([False, True, False]))


def sequences(world: World, policy):
    """Every way of an episode: its probability, return and states, by loops."""
    horizon, states, actions = policy.shape
    for first in range(states):
        for moves in product(range(actions), repeat=horizon):
            for then in product(range(states), repeat=horizon):
                path, weight, earned = (first, *then), world.start[first], 0.0
                for t, action in enumerate(moves):
                    weight *= policy[t, path[t], action] * world.transition[path[t], action, path[t + 1]]
                    earned += world.reward[path[t], action]
                if weight > 0:
                    yield weight, earned, path


def random_world(seed: int) -> World:
    random = np.random.default_rng(seed)
    transition = random.dirichlet(np.ones(3), size=(3, 2))
    return World(transition, random.normal(size=(3, 2)), np.array([0.5, 0.3, 0.2]), np.array([False, True, False]))


def test_a_world_has_rows_that_sum_to_one_and_knows_what_absorbs_and_what_is_barred():
    world, _ = grid(slip=0.3)
    np.testing.assert_allclose(world.transition.sum(axis=-1), 1.0, rtol=1e-14)
    assert np.flatnonzero(world.absorbing).tolist() == [8]
    assert {tuple(one) for one in np.argwhere(world.barred).tolist()} == {(1, DOWN), (3, RIGHT), (5, LEFT), (7, UP)}


def test_a_table_in_float32_is_read_as_the_decimals_it_was_made_of():
    world, _ = grid(slip=0.01)
    assert world.transition[0, RIGHT, 1] == 0.9925
    assert world.reward[0, RIGHT] == 5 * (0.9925 + 0.0025)


def test_a_greedy_plan_takes_the_best_and_shares_ties():
    world = corridor()
    # To the end through the middle: 0 + 1 + 2; barred from the middle both actions of state 0 earn nothing, but one is barred.
    plan = exact.hard_plan(world.transition, world.reward, 3)
    np.testing.assert_array_equal(plan[0, 0], [0.0, 1.0])
    np.testing.assert_array_equal(plan[:, 2], np.full((3, 2), 0.5))
    np.testing.assert_array_equal(plan[2, 0], [0.5, 0.5])  # the last step's successor is worth nothing
    np.testing.assert_array_equal(exact.hard_plan(world.transition, world.reward, 3, world.barred)[:, 0], [[1.0, 0.0]] * 3)


@pytest.mark.parametrize("forbid", [True, False])
@pytest.mark.parametrize("temperature", [1.0, 2.0])
def test_a_soft_plan_is_that_of_the_expert(forbid, temperature):
    table, (world, horizon) = table_of(tiny_grid(slip=0.1)), grid(slip=0.1)
    barred = world.barred if forbid else None
    plan = exact.soft_plan(world.transition, world.reward, horizon, barred, temperature)
    expected = soft_value_iteration(table, table.reward, horizon, temperature, forbid).log_policy
    np.testing.assert_allclose(plan, np.exp(expected), atol=1e-5)


@pytest.mark.parametrize("seed", [0, 1])
def test_evaluation_is_the_sum_over_every_episode(seed):
    world = random_world(seed)
    policy = np.random.default_rng(9).dirichlet(np.ones(2), size=(2, 3))
    every = list(sequences(world, policy))
    found = exact.evaluate(*world, policy)
    np.testing.assert_allclose(sum(weight for weight, _, _ in every), 1.0, rtol=1e-12)
    np.testing.assert_allclose(found.expected_return, sum(weight * earned for weight, earned, _ in every), rtol=1e-12)
    np.testing.assert_allclose(found.violating_episodes, sum(weight for weight, _, path in every if 1 in path), rtol=1e-12)
    steps = sum(weight * path[1:].count(1) / 2 for weight, _, path in every)
    np.testing.assert_allclose(found.violating_steps, steps, rtol=1e-12)


def test_uniform_steps_in_the_corridor_by_hand():
    # Two steps from the left end: right (½) enters the middle, from where right (½) ends; left again may enter with the second.
    world = corridor()
    found = exact.evaluate(*world, exact.uniform_policy(2, 3, 2))
    assert found == exact.Outcome(expected_return=0.5, violating_episodes=0.75, violating_steps=0.375)


def test_the_uniform_advantage_by_hand():
    # Last step: no action matters. The one before: from the middle, right leads to 2 and left to 0: ±1.
    advantage = exact.uniform_advantage(corridor().transition, corridor().reward, 2)
    np.testing.assert_array_equal(advantage[1], np.zeros((3, 2)))
    np.testing.assert_array_equal(advantage[0], [[-0.5, 0.5], [-1.0, 1.0], [0.0, 0.0]])


def test_states_are_reachable_by_clean_moves_step_by_step():
    world, horizon = grid(slip=0.1)
    rows = [np.flatnonzero(row).tolist() for row in exact.reachable(world, horizon)]
    assert rows == [[0], [0, 1, 3], [0, 1, 2, 3, 6], [0, 1, 2, 3, 5, 6, 7]]


def test_the_distance_is_zero_for_scale_and_for_shaping_that_ends_at_zero_and_one_for_the_opposite():
    world, horizon = grid(slip=0.1)
    r = world.reward
    assert exact.reward_distance(world, 3.0 * r, r, horizon) < 1e-6
    np.testing.assert_allclose(exact.reward_distance(world, -r, r, horizon), 1.0, rtol=1e-6)
    np.testing.assert_allclose(exact.reward_distance(world, np.zeros_like(r), r, horizon), np.sqrt(0.5), rtol=1e-9)
    potential = np.random.default_rng(0).normal(size=9)
    shaped = r + world.transition @ potential - potential[:, None]
    assert exact.reward_distance(world, shaped, r, horizon) > 0.05  # E h(s_T) remains: on a finite horizon it is a reward
    ends = world._replace(transition=np.tile(np.eye(9)[8], (9, 4, 1)))  # every move leads to the end, where h is 0
    assert exact.reward_distance(ends, r - (potential - potential[8])[:, None], r, horizon) < 1e-6


def test_the_distance_does_not_see_what_is_forbidden():
    world, horizon = grid(slip=0.0)
    elsewhere = world.reward.copy()
    elsewhere[4] += 7.0  # of steps taken in the obstacle; what leads there is barred, what passes it is compared elsewhere
    naive = _naive_distance(world, elsewhere, world.reward, horizon)
    np.testing.assert_allclose(exact.reward_distance(world, elsewhere, world.reward, horizon), naive, rtol=1e-9)
    random = np.random.default_rng(1).normal(size=(9, 4))
    naive = _naive_distance(world, random, world.reward, horizon)
    np.testing.assert_allclose(exact.reward_distance(world, random, world.reward, horizon), naive, rtol=1e-9)


def _naive_distance(world: World, f, r, horizon):
    reached, vectors = exact.reachable(world, horizon), []
    for reward in (f, r):
        advantage, parts = exact.uniform_advantage(world.transition, reward, horizon), []
        for t, x in product(range(horizon), range(9)):
            if reached[t, x] and x not in (4, 8):
                kept = [advantage[t, x, a] for a in range(4) if world.intended[x, a] != 4]
                parts += [value - sum(kept) / len(kept) for value in kept]
        vectors.append(np.array(parts))
    one, other = vectors
    return np.sqrt((1 - one @ other / np.linalg.norm(one) / np.linalg.norm(other)) / 2)


def test_temptation_of_an_obstacle_is_how_often_the_plan_would_enter_it_if_that_one_choice_were_free():
    world, horizon = grid(slip=0.0)
    # All four shortest ways without the obstacle count; by hand, in the last step from [0, 1]: r(down) = 5, r(right) = 5,
    # r(left) = −5, r(up) = 0, all followed by nothing.
    weights = np.exp([0.0, 5.0, 5.0, -5.0])
    states = np.full((1, 4), 8)
    states[0, 3] = 1
    found = exact.true_temptation(world, horizon, states)
    np.testing.assert_allclose(found[4], weights[DOWN] / weights.sum(), rtol=1e-6)
    np.testing.assert_allclose(found[2], weights[RIGHT] / weights[[UP, RIGHT, LEFT]].sum(), rtol=1e-6)  # allowed: the expert's
    assert found[8] == 0.0  # who stays does not enter


def test_temptation_grows_with_the_demonstrations_and_counts_every_state_shown():
    world, horizon = grid(slip=0.1)
    policy = exact.soft_plan(world.transition, world.reward, horizon, world.barred)
    states = np.array([[0, 1, 2, 5], [0, 3, 6, 7]])
    found = exact.true_temptation(world, horizon, states)
    np.testing.assert_allclose(exact.true_temptation(world, horizon, np.tile(states, (3, 1))), 3 * found, rtol=1e-12)
    expected = sum(policy[t, x, RIGHT] * (world.intended[x, RIGHT] == 1) for row in states for t, x in enumerate(row))
    expected += sum(policy[t, x, LEFT] * (world.intended[x, LEFT] == 1) for row in states for t, x in enumerate(row))
    np.testing.assert_allclose(found[1], expected, rtol=1e-9)  # nothing enters [0, 1] from below: that is the obstacle
    assert found[4] > 0.1


def test_no_way_through_the_default_grid_is_better_than_its_greedy_plan():
    world = exact.world_of(table_of(make_env("gridworld", slip=0.0)))
    found = exact.evaluate(*world, exact.hard_plan(world.transition, world.reward, 10, world.barred))
    np.testing.assert_allclose(found, (50.0, 0.0, 0.0), atol=1e-9)
