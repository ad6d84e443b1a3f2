"""The measures on held-out demonstrations are the numbers by hand, and nothing of the truth enters them."""

from dataclasses import replace
from functools import cache, partial

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from aircl_jax.methods import METHODS
from aircl_jax.tuning.held_out import Weights, gap, measure_seed, split
from aircl_jax.types import TrainState
from tests.worlds import TINY, UNOPTIMISED, random_trajectories, tiny_grid, tiny_networks, unit_stats


@pytest.fixture(scope="module")
def bound():
    env = tiny_grid()
    nets, params = tiny_networks(env, METHODS["aircl_corrected_sa"], replace(TINY, num_evaluation=6))
    return nets, params, nets.bind(params, unit_stats(env)), random_trajectories(env, 0, 5)


def measured(nets, params, held_out):
    state = TrainState(params, None, None, unit_stats(nets.env), held_out, jax.random.key(0), jnp.zeros((), jnp.int32))
    return jax.device_get(compiled(nets)(state, held_out))


@cache
def compiled(nets):
    return jax.jit(partial(measure_seed, nets, 6), compiler_options=UNOPTIMISED)


def test_likelihood_is_of_unmasked_held_out_steps_and_passing_counts_trajectories(bound):
    nets, params, networks, held = bound
    found = measured(nets, params, held)
    log_pi = jax.device_get(jax.jit(jax.vmap(networks.log_pi), compiler_options=UNOPTIMISED)(held))
    total, number = 0.0, 0
    for i, t in np.argwhere(np.asarray(held.mask) > 0):
        total, number = total + float(log_pi[i, t]), number + 1
    assert found["likelihood"] == pytest.approx(total / number, rel=1e-5)
    assert found["passing"] * len(held.mask) == pytest.approx(round(found["passing"] * len(held.mask)))
    assert 0 < found["moments"] <= 2


def test_true_rewards_and_costs_change_nothing(bound):
    nets, params, _, held = bound
    without = held._replace(reward=jnp.full_like(held.reward, jnp.nan), cost=jnp.full_like(held.cost, jnp.nan))
    assert measured(nets, params, without) == measured(nets, params, held)


def between(networks, one, other):
    return float(jax.jit(partial(gap, networks), compiler_options=UNOPTIMISED)(one, other))


def test_the_gap_is_0_for_the_same_steps_and_2_for_two_points(bound):
    _, _, networks, held = bound
    assert between(networks, held, held) == 0
    everywhere = jnp.ones_like(held.mask)
    first, second = (
        held._replace(
            obs=jnp.zeros_like(held.obs).at[..., cell].set(1.0), action=jnp.full_like(held.action, cell), mask=everywhere
        )
        for cell in (0, 1)
    )
    assert between(networks, first, second) == pytest.approx(2 * np.sqrt(8 / 26), rel=1e-5)  # of 2 (9 + 4) moments 8 differ


def test_the_gap_is_by_hand_of_means_and_squares_in_mixed_deviations(bound):
    _, _, networks, held = bound
    other = random_trajectories(networks.env, 3, 4)

    def moments(trajectories):
        keep = np.asarray(trajectories.mask) > 0
        acted = np.eye(4)[np.asarray(trajectories.action)[keep]]
        phi = np.concatenate([np.asarray(trajectories.obs)[keep], acted], axis=1)
        phi = np.concatenate([phi, phi**2], axis=1)
        return phi.mean(axis=0), (phi**2).mean(axis=0)

    (one, square), (two, square_two) = moments(held), moments(other)
    variance = (square + square_two) / 2 - ((one + two) / 2) ** 2
    terms = [(a - b) ** 2 / v if v > 1e-9 else 0.0 for a, b, v in zip(one, two, variance, strict=True)]
    assert between(networks, held, other) == pytest.approx(np.sqrt(np.mean(terms)), rel=1e-4)


def test_parts_are_disjoint_always_alike_and_never_empty(bound):
    _, _, _, held = bound
    numbered = jax.device_get(held)._replace(bootstrap=np.arange(5.0))
    training, out = split(numbered, 0.4)
    assert sorted([*training.bootstrap, *out.bootstrap]) == [0, 1, 2, 3, 4] and len(out.bootstrap) == 2
    np.testing.assert_array_equal(split(numbered, 0.4)[1].bootstrap, out.bootstrap)
    for share in (0.0, 0.05, 0.95):
        with pytest.raises(ValueError, match=f"held_out={share:g} of 5 demonstrations leaves a part empty"):
            split(numbered, share)


def test_a_score_adds_up_what_its_weights_say():
    assert Weights(2.0, 3.0, 0.5).score({"likelihood": -1.0, "moments": 0.25, "passing": 0.8}) == pytest.approx(-2.35)
