"""Swaps on grids from Python: which reward and constraint the plan is of, and what is refused."""

from dataclasses import replace

import jax.numpy as jnp
import numpy as np
import pytest

from aircl_jax import make_env, swap
from aircl_jax.analysis import exact
from aircl_jax.runs.spec import make_spec
from aircl_jax.transfer import grid
from aircl_jax.transfer.table_tests import Learned, true_reward
from envs import Grid
from envs.layouts import LAYOUTS
from tests.finished_runs import untrained
from tests.worlds import table_of

GRID = make_env("gridworld")
WORLD = exact.world_of(table_of(GRID))


def planned(reward, barred):
    policy = exact.hard_plan(WORLD.transition, reward, GRID.horizon, barred)
    return exact.evaluate(*WORLD, policy)


@pytest.fixture
def run(monkeypatch):
    """A run whose first seed has learned the truth, and whose second has learned to go back and that nothing is forbidden."""
    spec = make_spec(
        "gridworld",
        "aircl_corrected",
        contrast_prior="method",
        seeds=2,
        first_seed=0,
        iterations=1,
        demonstrations="default",
        env_settings={},
        config={},
    )
    result = replace(untrained("aircl_corrected"), spec=spec)
    nothing = np.zeros(len(WORLD.start), bool)
    seeds = [Learned(true_reward, WORLD.forbidden, np.empty(0)), Learned(lambda world: -world.reward, nothing, np.empty(0))]
    monkeypatch.setattr(grid, "learned_tables", lambda networks, states, table: None)
    monkeypatch.setattr(grid, "learned", lambda method, tables: seeds)
    return result


def test_what_was_learned_is_planned_seed_by_seed(run):
    found = swap(run)
    truth, back = planned(WORLD.reward, WORLD.barred), planned(-WORLD.reward, None)
    np.testing.assert_allclose(found.metrics["return"], [truth.expected_return, back.expected_return])
    np.testing.assert_allclose(found.metrics["infeasible_share"], [truth.violating_episodes, back.violating_episodes])
    np.testing.assert_allclose(found.metrics["violation_rate"], [truth.violating_steps, back.violating_steps])


def test_a_known_reward_goes_with_the_learned_constraint(run):
    found = swap(run, reward="world")
    free = planned(WORLD.reward, None)
    np.testing.assert_allclose(found.metrics["infeasible_share"][1], free.violating_episodes)
    assert found.metrics["infeasible_share"][0] < 0.1 < free.violating_episodes


def test_no_constraint_is_judged_by_the_worlds_own(run):
    found = swap(run, reward="world", constraint="none")
    np.testing.assert_allclose(found.metrics["infeasible_share"], [planned(WORLD.reward, None).violating_episodes] * 2)


def test_a_layout_names_its_obstacles_which_are_the_truth_then(run):
    found = swap(run, constraint="second")
    assert isinstance(found.world.view, Grid) and set(found.world.view.zones["obstacle"]) == set(LAYOUTS["second"].obstacles)
    assert found.metrics["infeasible_share"][0] < 0.1


def test_functions_of_cell_and_action_take_either_place(run):
    wanted = jnp.eye(36)[5]  # the upper right corner
    found = swap(run, reward=lambda obs, action: obs @ wanted, constraint=lambda obs, action: obs[1])
    assert found.policy(jnp.eye(36)[0], 0).probs[1] == 0.0  # (0, 1) lies on the way and is barred
    assert found.policy(jnp.eye(36)[6], 1).probs[1] > 0.0


def test_maps_count_what_the_demonstrations_enter_and_what_would_tempt_their_expert():
    result = untrained("aircl_corrected")
    maps = grid.maps_of_a_grid(result.spec, result.networks, result.states, result.expert)
    world = exact.world_of(table_of(result.spec.env))
    cells, actions = np.asarray(result.expert.obs).argmax(axis=-1), np.asarray(result.expert.action)
    entered = np.zeros((2, 9))
    for seed, episode, t in np.ndindex(cells.shape):
        at, to = cells[seed, episode, t], world.intended[cells[seed, episode, t], actions[seed, episode, t]]
        entered[seed, to] += at != to
    np.testing.assert_array_equal(maps["entered"], entered)
    assert maps["entered"][:, 4].sum() == 0 < maps["true_tempted"][0, 4]  # the obstacle in the middle of the 3×3 grid
    assert maps["reward"].shape == maps["delta"].shape == (2, 9, 4)


def test_what_does_not_fit_is_refused_in_one_line(run):
    with pytest.raises(
        ValueError, match="unknown constraint 'wall' of this grid; choose from default, second, third, fourth, none"
    ):
        swap(run, constraint="wall")
    with pytest.raises(ValueError, match=r"wrong env\.reward 'fame'"):
        swap(run, reward="fame")
    with pytest.raises(ValueError, match="have not the same states"):
        swap(run, env=make_env("gridworld", layout="wall"))
