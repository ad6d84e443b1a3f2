"""The nearest action that passes: against every combination of values, and by hand."""

import itertools

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from aircl_jax.transfer.projections import closer, first_of, nearest_by_sum, nearest_of


@pytest.mark.parametrize("seed", range(4))
def test_the_projection_by_a_concave_sum_is_the_best_of_all_combinations(seed):
    random = np.random.default_rng(seed)
    values = np.tile(np.linspace(-1, 1, 41), (3, 1))
    centre, steep = random.uniform(-0.5, 0.5, (3, 1)), random.uniform(1.0, 6.0, (3, 1))
    gain, wanted, least = 1.0 - steep * (values - centre) ** 2, random.uniform(-1, 1, 3), 1.5
    found = np.asarray(jax.jit(nearest_by_sum)(*(jnp.asarray(x, jnp.float32) for x in (wanted, values, gain, least))))
    places = np.abs(values - found[:, None]).argmin(axis=1)
    assert gain[np.arange(3), places].sum() >= least - 1e-4
    passing = [
        ((values[0, list(each)] - wanted) ** 2).sum()
        for each in itertools.product(range(41), repeat=3)
        if gain[np.arange(3), list(each)].sum() >= least
    ]
    # On a grid a multiplier alone can leave up to one step of one coordinate to the exact optimum.
    assert np.sqrt(((found - wanted) ** 2).sum()) <= np.sqrt(min(passing)) + 0.05


def test_where_no_combination_passes_the_greatest_sum_is_taken():
    values, gain = jnp.array([[0.0, 1.0, 2.0]] * 2), jnp.array([[0.0, 3.0, 1.0], [2.0, 0.0, 1.0]])
    np.testing.assert_array_equal(nearest_by_sum(jnp.array([2.0, 2.0]), values, gain, jnp.asarray(9.0)), [1.0, 0.0])


def test_the_nearest_feasible_candidate_is_taken_and_else_the_best():
    candidates = jnp.array([[0.0, 0.0], [1.0, 0.0], [0.4, 0.4]])
    wanted, score = jnp.array([1.0, 0.1]), jnp.array([0.2, 0.1, 0.4])
    found = nearest_of(wanted, candidates, jnp.array([True, False, True]), score)
    np.testing.assert_allclose(found, [0.4, 0.4])
    np.testing.assert_allclose(nearest_of(wanted, candidates, jnp.zeros(3, bool), score), [0.4, 0.4])
    np.testing.assert_array_equal(nearest_of(jnp.array(2), jnp.array([0, 1, 3]), jnp.array([True, True, False]), score), 1)


def test_a_feasible_action_moves_to_the_edge_of_what_passes_and_an_infeasible_one_stays():
    wanted, other = jnp.array([1.0, 0.0]), jnp.array([0.0, 0.0])
    np.testing.assert_allclose(closer(wanted, other, lambda action: action[0] <= 0.7), [0.7, 0.0], atol=0.001)
    np.testing.assert_array_equal(closer(wanted, other, lambda action: action[0] < -1.0), other)


def test_the_first_feasible_draw_is_taken_and_else_the_best():
    draws, best = jnp.array([3, 1, 2]), jnp.array(0)
    assert first_of(draws, jnp.array([False, True, True]), best) == 1
    assert first_of(draws, jnp.zeros(3, bool), best) == 0
