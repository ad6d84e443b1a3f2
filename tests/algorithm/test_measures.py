from dataclasses import replace

import jax.numpy as jnp
import numpy as np
import pytest

from aircl_jax.algorithm.measures import (
    auroc,
    correlation,
    feasible_return,
    goal_rate,
    infeasible,
    step_metrics,
    undiscounted_return,
    violation_rate,
)
from aircl_jax.types import Trajectory
from tests.worlds import one_state_env

# Two episodes; the second ends after its first step, and what follows is to be ignored.
COST = jnp.asarray([[0.0, 1.0, 0.0, 1.0], [0.0, 1.0, 1.0, 1.0]])
REWARD = jnp.asarray([[1.0, 2.0, 4.0, 8.0], [3.0, 90.0, 90.0, 90.0]])
MASK = jnp.asarray([[1.0, 1.0, 1.0, 1.0], [1.0, 0.0, 0.0, 0.0]])
TRAJECTORIES = Trajectory(jnp.zeros((2, 4, 1)), COST, COST, COST, REWARD, COST, MASK, jnp.zeros(2))


def test_violation_rate_is_the_share_of_unmasked_steps():
    np.testing.assert_allclose(violation_rate(TRAJECTORIES), 2 / 5)


def test_a_trajectory_is_infeasible_with_one_unmasked_violation():
    np.testing.assert_array_equal(infeasible(TRAJECTORIES), [1.0, 0.0])


def test_return_is_the_mean_sum_over_unmasked_steps():
    assert undiscounted_return(TRAJECTORIES) == (15 + 3) / 2


def test_feasible_return_stops_before_the_first_violation():
    assert feasible_return(TRAJECTORIES) == (1 + 3) / 2


def test_a_return_is_undefined_where_no_reward_is_known_though_a_row_assumes_one():
    env = one_state_env(lambda t, action: jnp.zeros(()))
    for has_reward, expected in ((True, 9.0), (False, np.nan)):
        found = step_metrics(replace(env, has_reward=has_reward), TRAJECTORIES, TRAJECTORIES, jnp.zeros(2), jnp.zeros(2))
        np.testing.assert_array_equal([found["return"], found["return_sampled"]], expected)


@pytest.mark.parametrize(("success", "expected"), [(15.0, 0.5), (3.0, 1.0), (16.0, 0.0)])
def test_goal_rate_is_the_share_of_episodes_with_the_whole_return(success, expected):
    assert goal_rate(TRAJECTORIES, success) == expected


def test_goal_rate_is_undefined_without_a_goal():
    assert jnp.isnan(goal_rate(TRAJECTORIES, None))


def test_goal_rate_is_undefined_where_one_return_is_unknown():
    assert jnp.isnan(goal_rate(TRAJECTORIES._replace(reward=REWARD.at[0, 2].set(jnp.nan)), 3.0))


@pytest.mark.parametrize(
    ("score", "expected"),
    [
        ([4.0, 3.0, 2.0, 1.0], 1.0),
        ([1.0, 2.0, 3.0, 4.0], 0.0),
        ([1.0, 1.0, 1.0, 1.0], 0.5),  # ties count half
        ([3.0, 1.0, 2.0, 0.0], 0.75),
    ],
)
def test_auroc_is_the_chance_that_a_positive_scores_above_a_negative(score, expected):
    positive = jnp.asarray([1.0, 1.0, 0.0, 0.0])
    assert auroc(jnp.asarray(score), positive, 1.0 - positive) == expected


def test_auroc_is_never_above_1_whatever_its_sums_are_rounded_to():
    for number in (3, 17, 66, 199):
        positive = jnp.arange(2 * number) >= number
        found = auroc(jnp.arange(2.0 * number), positive.astype(jnp.float32), 1.0 - positive)
        assert 1.0 - 1e-5 < found <= 1.0


def test_auroc_is_undefined_where_one_label_is_missing():
    assert jnp.isnan(auroc(jnp.arange(3.0), jnp.ones(3), jnp.zeros(3)))


def test_auroc_equals_the_count_over_weighted_pairs():
    random = np.random.default_rng(0)
    score, positive, mask = random.integers(8, size=60), random.integers(2, size=60), random.integers(2, size=60)
    pairs = [(a, b) for a in range(60) for b in range(60) if mask[a] * mask[b] and positive[a] > positive[b]]
    wins = [(score[a] > score[b]) + 0.5 * (score[a] == score[b]) for a, b in pairs]
    found = auroc(*(jnp.asarray(x, jnp.float32) for x in (score, mask * positive, mask * (1 - positive))))
    np.testing.assert_allclose(found, np.mean(wins), rtol=1e-5)


def test_correlation_is_pearsons_over_weighted_steps():
    x, y = np.array([1.0, 2.0, 4.0, 70.0]), np.array([2.0, 1.0, 5.0, -9.0])
    found = correlation(jnp.asarray(x), jnp.asarray(y), jnp.asarray([1.0, 1.0, 1.0, 0.0]))
    np.testing.assert_allclose(found, np.corrcoef(x[:3], y[:3])[0, 1], rtol=1e-5)
