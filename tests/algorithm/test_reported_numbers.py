"""Numbers of an evaluation that a tabular world does not show, each worked by hand: thresholds, and worlds with a box."""

from dataclasses import replace
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from aircl_jax.algorithm.evaluation import evaluate, occupancy_tv
from aircl_jax.analysis import episodes
from aircl_jax.methods import METHODS
from aircl_jax.model.feasibility import log_feasibility, log_step_feasibility
from aircl_jax.settings.train_config import Coefficients
from aircl_jax.types import ObsStats, Thresholds, TrainState
from envs import Box, Env
from tests.worlds import (
    TINY,
    UNOPTIMISED,
    one_state_env,
    random_scores,
    random_trajectories,
    sigmoid,
    tiny_grid,
    tiny_networks,
    unit_stats,
)

COEFFICIENTS = Coefficients(threshold=0.5, sharpness=2.0)


def calibrated(step: float, sequence: float) -> Any:
    scores = random_scores(0, 3)
    return scores._replace(thresholds=Thresholds(jnp.full(3, step), jnp.full(3, sequence)))


def test_feasibility_of_a_step_is_tested_at_the_settings_threshold_wherever_the_calibrated_one_stands():
    scores = calibrated(step=-3.0, sequence=-4.0)
    found = log_step_feasibility(METHODS["aircl_corrected"], COEFFICIENTS, scores)
    expected = sigmoid(2 * (np.asarray(scores.step_logit) - np.log(0.5)))
    np.testing.assert_allclose(np.exp(found)[scores.mask > 0], expected[np.asarray(scores.mask) > 0], rtol=1e-5)


def test_feasibility_of_a_trajectory_is_tested_at_the_calibrated_thresholds_each_at_its_own():
    scores = calibrated(step=-3.0, sequence=-4.0)
    found = log_feasibility(METHODS["aircl_corrected"], COEFFICIENTS, scores)
    least = [min(row[keep > 0]) for row, keep in zip(np.asarray(scores.step_logit), np.asarray(scores.mask), strict=True)]
    expected = sigmoid(2 * (np.array(least) + 3.0)) * sigmoid(2 * (np.asarray(scores.sequence_logit) + 4.0))
    np.testing.assert_allclose(np.exp(found), expected, rtol=1e-5)


def robot(**settings: Any) -> Env:
    """A world with a box, no table and observations of two coordinates."""
    return replace(one_state_env(lambda t, action: action.sum(), action_space=Box(3)), **settings)


def test_occupancy_of_a_world_without_a_table_is_compared_in_sixteenths_of_eight_standard_deviations():
    nets, params = tiny_networks(robot(), "airl")
    stats = ObsStats(jnp.asarray([1.0, 0.0]), jnp.asarray([2.0, 1.0]))
    # First coordinate, s̃ = (s − 1) / 2: the expert half in [0, ½) and half in [½, 1), π half in [0, ½) and half, far out, in
    # the last bin; what stands past π's end would be another. Second coordinate: the same bin for both.
    one, mask = random_trajectories(nets.env, 0, 3), jnp.asarray([[1.0], [1.0], [0.0]])
    expert = one._replace(obs=jnp.asarray([[[1.2, 0.1]], [[2.4, 0.2]], [[1.4, 0.0]]]), mask=mask)
    policy = one._replace(obs=jnp.asarray([[[1.9, 0.3]], [[900.0, 0.4]], [[-5.0, 0.0]]]), mask=mask)
    np.testing.assert_allclose(occupancy_tv(nets.bind(params, stats), expert, policy), (0.5 + 0.0) / 2, rtol=1e-6)


@pytest.fixture(scope="module")
def of_a_robot() -> dict[str, float]:
    """An evaluation where log σ stands at the lower bound, at the upper one, and between them."""
    env = robot(has_reward=False)
    nets, params = tiny_networks(env, "airl", replace(TINY, num_evaluation=4))
    bounds = nets.config.ppo
    inner = {**params.policy["params"], "log_std": jnp.asarray([bounds.log_std_min, bounds.log_std_max, -1.0])}
    params = params._replace(policy={"params": inner})
    expert = random_trajectories(env, 0, 3)._replace(action=jnp.zeros((3, 1, 3)))
    unknown = expert._replace(reward=jnp.full((3, 1), jnp.nan))
    state = TrainState(params, None, None, unit_stats(env), expert, jax.random.key(0), jnp.asarray(0, jnp.int32))
    run = jax.jit(lambda state, expert, reference: evaluate(nets, state, expert, reference), compiler_options=UNOPTIMISED)
    return run(state, unknown, expert)


def test_log_std_at_either_bound_counts(of_a_robot):
    np.testing.assert_allclose(of_a_robot["log_std_at_bound"], 2 / 3, rtol=1e-6)


@pytest.mark.parametrize(
    "name",
    [
        "violation_reward_only",
        "reward_correlation",
        "return",
        "return_sampled",
        "feasible_return",
        "expert_return",
        "goal_rate",
    ],
)
def test_what_a_world_without_a_table_a_goal_or_a_known_reward_cannot_say_is_undefined(of_a_robot, name):
    assert np.isnan(of_a_robot[name])


def test_an_evaluation_of_the_next_iteration_is_on_other_episodes():
    env = tiny_grid()
    nets, params = tiny_networks(env, "airl", replace(TINY, num_evaluation=4))
    expert = random_trajectories(env, 0, 3)
    run = jax.jit(lambda state: evaluate(nets, state, expert, expert)["entropy"], compiler_options=UNOPTIMISED)
    first, again, later = (
        run(TrainState(params, None, None, unit_stats(env), expert, jax.random.key(0), jnp.asarray(step, jnp.int32)))
        for step in (3, 3, 4)
    )
    assert first == again != later


@pytest.mark.parametrize(("costs", "expected"), [([0, 0, 0], False), ([0, 1, 0], True), ([0, 0, 1], False)])
def test_one_violation_before_its_end_is_enough_for_an_episode_to_be_infeasible(costs, expected):
    one = random_trajectories(tiny_grid(horizon=3, goal=[1, 2]), 0, 1)
    one = one._replace(cost=jnp.asarray([costs], jnp.float32), mask=jnp.asarray([[1.0, 1.0, 0.0]]))
    assert episodes.infeasible(one).tolist() == [expected]
