"""Fresh policies: of a seed's candidates the best by its own pay goes on, and episodes are of the world that is asked for."""

from dataclasses import replace
from functools import cache, partial

import jax
import jax.numpy as jnp
import numpy as np
from jax.tree_util import Partial

from aircl_jax.transfer import fresh as fresh_policies
from aircl_jax.transfer.fresh import BATCH, CANDIDATE, Fresh, acting, episodes, train_fresh
from tests.algorithm.learners.test_scale_free import CONFIG, counting_world
from tests.worlds import poisoned

SEEDS = (0, 1, 2)
TRIAL = 4  # of eight iterations
SETTINGS = replace(
    CONFIG, iterations=2 * TRIAL, trial=0.5, num_trajectories=2, candidates=2, ppo=replace(CONFIG.ppo, num_epochs=1)
)
SIGNS = jnp.asarray([1.0, -1.0, 1.0])  # the second seed is paid the opposite


def signed(signs):
    return Partial(partial(_signed), signs)


def _signed(sign, trajectory):
    return sign * trajectory.reward, trajectory.cost


@cache
def chosen() -> Fresh:
    return train_fresh(counting_world(), SEEDS, SETTINGS, signed(SIGNS))


@cache
def alone() -> Fresh:
    """Every candidate as a seed of its own to the end: those of seed 0, then of 1, then of 2."""
    crowd = [seed + CANDIDATE * k for seed in SEEDS for k in range(2)]
    return train_fresh(counting_world(), crowd, replace(SETTINGS, candidates=1), signed(jnp.repeat(SIGNS, 2)))


def best() -> np.ndarray:
    """The place in the crowd of each seed's candidate with the greatest return at the end of the trial, by a loop."""
    returns = alone().history["return"][:TRIAL].mean(axis=0)
    return np.array([2 * seed + (returns[2 * seed + 1] > returns[2 * seed]) for seed in range(3)])


def test_the_candidate_with_the_greatest_return_of_its_own_goes_on_to_the_end():
    assert set(best() % 2) == {0, 1}  # neither always the first nor always the second
    for name, values in chosen().history.items():
        assert values.shape == (2 * TRIAL, 3)
        np.testing.assert_allclose(values, alone().history[name][:, best()], rtol=1e-3, atol=1e-5, err_msg=name)


def test_the_policy_that_is_kept_is_that_of_the_last_iteration():
    for one, two in zip(jax.tree.leaves(chosen().states.trained), jax.tree.leaves(alone().states.trained), strict=True):
        np.testing.assert_allclose(one, two[best()], rtol=1e-3, atol=1e-5)
    np.testing.assert_array_equal(chosen().states.step, np.full(3, 2 * TRIAL))


def test_candidates_have_other_keys_than_any_seed_nearby():
    first, second = alone().history["return"][0, :2]
    assert first != second


def test_a_trial_of_less_than_one_iteration_is_one(monkeypatch):
    lengths = []

    def train(learner, states, tasks, length):
        lengths.append(length)
        return states, {"return": np.zeros((length, len(states.step)))}

    monkeypatch.setattr(fresh_policies, "_train", train)
    found = train_fresh(counting_world(), SEEDS, replace(SETTINGS, iterations=1), signed(SIGNS))
    assert lengths == [1, 0]
    assert found.history["return"].shape == (1, 3)


def test_episodes_are_of_every_seeds_policy_with_the_same_keys_in_the_world_asked_for():
    fresh, number = chosen(), BATCH + 4
    world = poisoned(counting_world(), jnp.asarray(10.0), jnp.zeros(()))
    twice = fresh._replace(states=jax.tree.map(lambda leaf: leaf[np.array([0, 1, 0])], fresh.states))
    drawn = episodes(twice, world, number, jax.random.key(3))
    assert drawn.mask.shape == (3, number, 4)
    np.testing.assert_array_equal(drawn.action[0], drawn.action[2])
    np.testing.assert_allclose(drawn.reward, np.asarray(drawn.action)[..., 0] + 10.0, rtol=1e-6)
    assert len(np.unique(drawn.action[0, :, 0])) == number  # no episode is drawn twice
    assert not np.allclose(drawn.action[0], drawn.action[1])


def test_a_constrained_policy_draws_nothing_beyond_its_own_seeds_motors_and_a_free_one_whatever_it_likes():
    low, high = jnp.asarray([[-0.01], [0.2], [-1.0]]), jnp.asarray([[0.01], [0.3], [1.0]])
    for constrained in (True, False):
        fresh = train_fresh(
            counting_world(),
            SEEDS,
            replace(SETTINGS, candidates=1, iterations=1),
            signed(SIGNS),
            constrained=constrained,
            motors=(low, high),
        )
        drawn = episodes(fresh, counting_world(), 8, jax.random.key(3)).action[..., 0]  # [S, N, T]
        within = (drawn >= low[:, :, None]) & (drawn <= high[:, :, None])
        assert bool(within.all()) is constrained
        state, motors = jax.tree.map(lambda leaf: leaf[1], (fresh.states, fresh.motors))
        mean = float(acting(fresh, state, motors).policy(jnp.zeros(1), jnp.asarray(0)).sample(seed=jax.random.key(0))[0])
        assert (0.199 <= mean <= 0.301) or not constrained
