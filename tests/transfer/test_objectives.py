"""What a fresh policy is paid and charged: each seed by what the learned seed in its place says of the same steps."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from aircl_jax.transfer import objectives
from tests.finished_runs import random_episodes, untrained_robot
from tests.worlds import UNOPTIMISED

EPISODE = jax.tree.map(lambda leaf: leaf[0], random_episodes(untrained_robot("aircl_corrected").spec.env, 7, 1))


def each_seed(part, number):
    """The numbers of one episode by the part of every fresh seed, which has its leading axis."""
    return np.array([jax.tree.map(lambda leaf, seed=seed: leaf[seed], part)(EPISODE) for seed in range(number)])


def test_the_objective_is_the_reward_and_the_cost_in_that_order():
    joined = objectives.objective(objectives.world_reward(), objectives.world_cost())
    reward, cost = joined(EPISODE)
    np.testing.assert_array_equal(reward, EPISODE.reward)
    np.testing.assert_array_equal(cost, EPISODE.cost)
    _, nothing = objectives.objective(objectives.world_reward(), objectives.no_cost())(EPISODE)
    np.testing.assert_array_equal(nothing, np.zeros(8))


def test_a_function_of_a_step_is_asked_for_each_step_and_may_be_true_or_false():
    part = objectives.of_step(lambda obs, action: (obs[0] > 0) & (action[1] < 0.5))
    expected = (EPISODE.obs[:, 0] > 0) & (EPISODE.action[:, 1] < 0.5)
    np.testing.assert_array_equal(part(EPISODE), expected.astype(float))
    assert part(EPISODE).dtype == jnp.float32


def test_the_learned_reward_is_f_of_the_seed_in_that_place_and_again_from_the_first():
    result = untrained_robot("aircl_corrected")
    found = each_seed(objectives.learned_reward(result, 3), 3)
    f = [result.bound(index).f(EPISODE) for index in (0, 1)]
    np.testing.assert_allclose(found, [f[0], f[1], f[0]], rtol=1e-5)
    assert not np.allclose(f[0], f[1])


def test_the_learned_cost_is_1_exactly_where_a_step_is_less_feasible_than_a_half():
    result = untrained_robot("aircl_corrected")
    found = each_seed(objectives.learned_cost(result, 3), 3)
    delta = np.array([result.step_feasibility(EPISODE, index) for index in (0, 1, 0)])
    kept = np.asarray(EPISODE.mask) > 0
    np.testing.assert_array_equal(found[:, kept], (delta < 0.5)[:, kept])
    assert 0.0 < found[:, kept].mean() < 1.0


def test_a_random_reward_is_drawn_anew_for_each_seed_and_normalised_alike():
    result = untrained_robot("airl_centred")
    keys, stats = jax.random.split(jax.random.key(5), 2), result.state(0).obs_stats
    found = each_seed(objectives.random_reward(result.networks, stats, keys), 2)
    init = jax.jit(jax.vmap(result.networks.init), compiler_options=UNOPTIMISED)(keys)
    expected = [
        result.networks.bind(jax.tree.map(lambda leaf, seed=seed: leaf[seed], init), stats).f(EPISODE) for seed in range(2)
    ]
    np.testing.assert_allclose(found, expected, rtol=1e-5)
    assert not np.allclose(found[0], found[1])


@pytest.mark.parametrize(
    ("part", "method", "said"),
    [
        (objectives.learned_reward, "bc", "method=bc learns no reward to swap"),
        (objectives.learned_reward, "icrl", "method=icrl learns no reward to swap"),
        (objectives.learned_cost, "airl_centred", "method=airl_centred has no δ₁ to swap"),
        (objectives.learned_cost, "aircl", "method=aircl has no δ₁ to swap"),
    ],
)
def test_what_was_not_learned_is_refused_in_one_line(part, method, said):
    with pytest.raises(ValueError, match=said) as error:
        part(untrained_robot(method), 2)
    assert "\n" not in str(error.value)
