"""Limits that δ₁ draws: by hand on a line, and by a loop over the steps that are moved."""

from dataclasses import replace
from functools import partial

import jax
import jax.numpy as jnp
import numpy as np

from aircl_jax.analysis import recovered_limits as limits
from aircl_jax.analysis.recovered_limits import beyond, limits_of, mean_delta, recovered_limits
from aircl_jax.types import Trajectory
from tests.finished_runs import untrained, untrained_robot
from tests.worlds import UNOPTIMISED

GRID = np.array([-2.0, -1.0, 0.0, 1.0, 2.0])


def test_a_limit_is_where_the_line_between_two_values_crosses_one_half():
    # Between 0.1 at −2 and 0.9 at −1 it is ½ in the middle; between 0.8 at 0 and 0.4 at 1 after three quarters.
    lower, upper = limits_of(GRID, np.array([0.1, 0.9, 0.8, 0.4, 0.9]), 0.0)
    np.testing.assert_allclose([lower, upper], [-1.5, 0.75])


def test_the_first_crossing_counts_going_out_from_the_middle():
    lower, upper = limits_of(GRID, np.array([0.9, 0.3, 0.7, 0.9, 0.0]), 0.4)
    np.testing.assert_allclose([lower, upper], [-0.5, 1 + 4 / 9])


def test_without_a_crossing_there_is_no_limit():
    assert np.isnan(limits_of(GRID, np.array([0.5, 1.0, 1.0, 1.0, 0.5]), 0.0)).all()
    lower, upper = limits_of(GRID, np.array([1.0, 1.0, 1.0, 1.0, 0.0]), 0.0)
    assert np.isnan(lower) and upper == 1.5


def test_what_is_infeasible_at_the_middle_has_its_limits_there():
    assert limits_of(GRID, np.array([1.0, 1.0, 0.2, 1.0, 1.0]), 0.0) == (0.0, 0.0)


def test_one_coordinate_alone_is_moved_at_a_time():
    result = untrained_robot("aircl_corrected")
    random, state = np.random.default_rng(0), result.state(1)
    steps, grid = random.normal(size=(3, 10)), random.normal(size=(2, 10)) * 2.0
    given = jnp.asarray(grid, jnp.float32), jnp.asarray(steps, jnp.float32)
    found = jax.jit(partial(mean_delta, result.networks), compiler_options=UNOPTIMISED)(state, *given)
    moved = np.array([[[np.where(np.arange(10) == i, grid[k], step) for step in steps] for i in range(10)] for k in range(2)])
    flat = jnp.asarray(moved.reshape(1, -1, 10), jnp.float32)
    zeros = jnp.zeros(flat.shape[:2])
    along = Trajectory(flat[..., :8], flat[..., 8:], zeros, zeros, zeros, zeros, zeros + 1.0, jnp.zeros(1))
    delta = result.step_feasibility(jax.tree.map(lambda leaf: leaf[0], along), 1)
    np.testing.assert_allclose(found, np.asarray(delta).reshape(2, 10, 3).mean(axis=-1), rtol=1e-4)
    assert np.asarray(found).std(axis=1).min() > 0.01


def test_every_seed_has_its_own_limits_and_coordinates_go_as_far_again_as_the_first_seeds_demonstrations(monkeypatch):
    tried = []

    def walls(nets, state, grid, steps):
        """δ₁ is 0 above 1 for the first seed, above 2 for the second."""
        tried.append((grid, steps))
        return jnp.where(grid > 1.0 + state.step, 0.0, 1.0)

    monkeypatch.setattr(limits, "mean_delta", walls)
    monkeypatch.setattr(limits, "LAPSES", 1.0)
    result = untrained_robot("aircl_corrected")
    found = recovered_limits(replace(result, states=result.states._replace(step=jnp.arange(2.0))))
    assert found is not None
    [(grid, steps)] = tried  # once for all seeds
    kept = np.asarray(result.expert.mask[0]) > 0
    obs, action = np.asarray(result.expert.obs[0])[kept], np.asarray(result.expert.action[0])[kept]
    np.testing.assert_array_equal(steps, np.concatenate([obs, action.clip(-1, 1)], axis=1))
    least, greatest = obs.min(axis=0), obs.max(axis=0)
    np.testing.assert_allclose(found.least, [*least, -1.0, -1.0], rtol=1e-6)
    np.testing.assert_allclose(found.greatest, [*greatest, 1.0, 1.0], rtol=1e-6)
    np.testing.assert_allclose(grid[0], [*(2 * least - greatest), -1.0, -1.0], rtol=1e-5)
    np.testing.assert_allclose(grid[-1], [*(2 * greatest - least), 1.0, 1.0], rtol=1e-5)
    assert found.names == (*result.spec.env.coordinate_names, "motor front", "motor rear")
    assert np.isnan(found.lower).all()
    assert np.isnan(found.upper[:, 8:]).all()  # motors are moved within the box, where nothing is above 1
    np.testing.assert_allclose(found.upper[:, :8], [[1.0] * 8, [2.0] * 8], atol=3 * (greatest - least).max() / 80)


def test_coordinates_that_the_constraint_does_not_see_have_none(monkeypatch):
    monkeypatch.setattr(limits, "mean_delta", lambda nets, state, grid, steps: jnp.where(grid > 0.5, 0.0, 1.0))
    result = untrained_robot("aircl_corrected")
    config = replace(result.networks.config, constraint_input="action")
    run = replace(result, networks=replace(result.networks, config=config))
    often = recovered_limits(run)
    assert often is not None and np.isnan(often.upper).all()  # these demonstrations go beyond 0.5 in more than 1 % of steps
    monkeypatch.setattr(limits, "LAPSES", 1.0)
    found = recovered_limits(run)
    assert found is not None
    assert (found.names, found.upper.shape) == (("motor front", "motor rear"), (2, 2))
    np.testing.assert_allclose(found.upper, 0.5, atol=2 / 80)
    np.testing.assert_array_equal(found.greatest, [1.0, 1.0])


def test_a_grid_and_a_method_without_a_test_of_steps_have_no_limits():
    assert recovered_limits(untrained("aircl_corrected")) is None
    assert recovered_limits(untrained_robot("airl_centred")) is None


def test_what_is_often_done_lies_beyond_no_limit():
    seen = np.array([[0.0, 1.0], [1.0, 2.0], [2.0, 3.0], [3.0, 4.0]])
    limits = np.array([[1.5, 9.0], [np.nan, 0.5]])
    np.testing.assert_array_equal(beyond(seen, limits, 0), [[0.5, 1.0], [0.0, 0.0]])
    np.testing.assert_array_equal(beyond(seen, limits, 1), [[0.5, 0.0], [0.0, 1.0]])
