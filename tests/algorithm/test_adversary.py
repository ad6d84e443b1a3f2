"""Lines 5 and 6 from outside: which log π, how many steps, on how much of each set."""

from dataclasses import replace
from functools import cache
from typing import Any

import jax
import numpy as np
import pytest

from aircl_jax.algorithm.adversary import make_optimiser, minibatch, score_all, update
from aircl_jax.algorithm.terms.logits import Batches
from aircl_jax.algorithm.terms.table import TERMS
from aircl_jax.model.networks import Networks
from aircl_jax.settings.train_config import AdversaryConfig, TrainConfig
from aircl_jax.types import Metrics, Params
from tests.worlds import TINY, UNOPTIMISED, random_trajectories, tiny_grid, tiny_networks, unit_stats

GRID = tiny_grid()
STATS = unit_stats(GRID)
BATCHES = Batches(*(random_trajectories(GRID, seed, number) for seed, number in enumerate([5, 4, 6, 3])))
KEY = jax.random.key(5)


def config(**adversary: Any) -> TrainConfig:
    return replace(TINY, adversary=AdversaryConfig(**{"learning_rate": 0.01, "num_steps": 1} | adversary))


def networks(**adversary: Any) -> tuple[Networks, Params]:
    return tiny_networks(GRID, "aircl_corrected_sa", config(**adversary))


@cache
def updated(**adversary: Any) -> tuple[Params, Any, Metrics]:
    nets, params = networks(**adversary)
    opt = make_optimiser(nets.method, nets.config).init((params.reward, params.feasibility))
    run = jax.jit(lambda params, opt: update(nets.bind(params, STATS), opt, BATCHES, KEY), compiler_options=UNOPTIMISED)
    return run(params, opt)


def losses(params: Params, batches: Batches = BATCHES) -> Metrics:
    """The row's terms under these parameters, log π being the present policy's."""
    nets, _ = networks()
    present = Batches(*((one, jax.vmap(nets.bind(params, STATS).log_pi)(one)) for one in batches.sets))
    scores = score_all(nets.bind(params, STATS), present)
    return {
        f"loss_{name}": TERMS[name](nets.method, nets.config, nets.config.coefficients, scores) for name in nets.method.terms
    }


def assert_same(found: Metrics, expected: Metrics) -> None:
    assert set(found) == set(expected)
    np.testing.assert_allclose([found[name] for name in expected], list(expected.values()), rtol=1e-4)


def test_the_terms_judge_by_the_present_policy_and_not_by_the_recorded_log_probabilities():
    assert_same(updated()[2], losses(networks()[1]))


def test_the_losses_reported_are_those_of_the_last_step_before_it_is_taken():
    assert_same(updated(num_steps=2)[2], losses(updated()[0]))


def test_an_update_descends_the_sum_of_the_terms():
    before, after = (sum(losses(params).values()) for params in (networks()[1], updated()[0]))
    assert after < before - 1e-3


@pytest.mark.parametrize("rate", [0.01, 0.002])
def test_the_first_step_of_adam_moves_every_weight_by_the_adversarys_own_learning_rate(rate):
    before, after = networks()[1], updated(learning_rate=rate)[0]
    moved = [np.abs(a - b).max() for a, b in zip(jax.tree.leaves(after.reward), jax.tree.leaves(before.reward), strict=True)]
    np.testing.assert_allclose(max(moved), rate, rtol=1e-2)


def test_the_optimisers_state_counts_every_step_of_every_update():
    assert jax.tree.leaves(updated(num_steps=2)[1])[0] == 2


def test_a_minibatch_holds_as_many_transitions_as_the_settings_say_in_whole_trajectories():
    # 11 transitions are 2 trajectories of 4 steps, drawn by the one step's key.
    drawn = minibatch(BATCHES, 2, jax.random.split(KEY, 1)[0])
    assert_same(updated(minibatch_size=11)[2], losses(networks()[1], drawn))


def test_every_step_draws_another_minibatch():
    drawn = minibatch(BATCHES, 2, jax.random.split(KEY, 2)[1])
    assert_same(updated(minibatch_size=8, num_steps=2, learning_rate=0.0)[2], losses(networks()[1], drawn))


def test_the_four_sets_of_a_minibatch_are_drawn_apart():
    many = random_trajectories(GRID, 0, 60)
    drawn = minibatch(Batches(many, many, many, many), 3, KEY)
    assert len({tuple(np.asarray(one.reward[:, 0]).tolist()) for one in drawn.sets}) == 4


def test_the_policy_the_critic_and_the_thresholds_stand_still():
    before, after = networks()[1], updated()[0]
    for name in ("policy", "value", "thresholds"):
        jax.tree.map(np.testing.assert_array_equal, getattr(after, name), getattr(before, name))


def test_a_row_without_terms_is_left_as_it_is():
    nets, params = tiny_networks(GRID, "bc")
    after, _, metrics = update(nets.bind(params, STATS), None, BATCHES, KEY)
    assert metrics == {}
    jax.tree.map(np.testing.assert_array_equal, after, params)
