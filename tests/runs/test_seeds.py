"""Seed s is the integer s: the same run alone or among others, on one device or on two.

The initial state is the same to the bit. A step is the same to rounding: on a CPU a device's seeds go one after another, and
the compiler still treats loops of different lengths differently. Where a gradient is no more than rounding, Adam makes a part
of a whole step of it: after three steps parameters of `airl_centred` differ by 6e-10, of `aircl_corrected` by 2.5e-6.
"""

from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import chex
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from aircl_jax.algorithm.trainer import make_trainer
from aircl_jax.methods import METHODS
from aircl_jax.runs import seeds
from aircl_jax.runs.seeds import make_runner, seed_keys
from tests.worlds import TINY, random_trajectories, tiny_grid

STEPS = 3


same_to_rounding = partial(chex.assert_trees_all_close, rtol=1e-5, atol=5e-6)  # a hundredth of a step of Adam


@pytest.fixture(scope="module", params=["airl_centred", pytest.param("aircl_corrected", marks=pytest.mark.slow)])
def row(request):
    return request.param


@pytest.fixture(scope="module")
def trainer(row):
    return make_trainer(tiny_grid(), METHODS[row], replace(TINY, hidden=(4,)))


@pytest.fixture(scope="module")
def many(row):
    return {"airl_centred": 4}.get(row, 10)


@pytest.fixture(scope="module")
def among_many(trainer, many):
    return run(trainer, range(many))


def run(trainer, chosen, chunks=(STEPS,)):
    """Initial parameters, parameters after the chunks, and metrics [length, S] of the last."""
    one = random_trajectories(tiny_grid(), 0, TINY.num_demonstrations)
    expert = jax.tree.map(lambda leaf: np.broadcast_to(leaf, (len(chosen), *leaf.shape)), one)
    runner = make_runner(trainer, chosen)
    states = runner.init(expert)
    first, metrics = jax.tree.map(np.asarray, states.params), {}
    for length in chunks:
        states, metrics = runner.run_chunk(states, expert, length)
    return first, jax.tree.map(np.asarray, states.params), metrics


def seed_of(tree, index):
    return jax.tree.map(lambda leaf: leaf[index], tree)


def test_key_of_a_seed_is_that_of_the_integer():
    keys = jax.random.key_data(seed_keys([0, 3, 7]))
    np.testing.assert_array_equal(keys[1], jax.random.key_data(jax.random.key(3)))


def test_seed_three_is_the_same_alone_and_among_many(trainer, many, among_many):
    first, last, metrics = among_many
    first_alone, last_alone, metrics_alone = run(trainer, [3])
    chex.assert_trees_all_equal(seed_of(first, 3), seed_of(first_alone, 0))
    same_to_rounding(seed_of(last, 3), seed_of(last_alone, 0))
    assert metrics["return"].shape == (STEPS, many)
    same_to_rounding(metrics["return"][:, 3], metrics_alone["return"][:, 0])


def test_different_seeds_run_differently(many, among_many):
    first, _, _ = among_many
    kernels = jax.tree.leaves(first)[1]
    assert len(np.unique(kernels.reshape(many, -1), axis=0)) == many


def test_one_device_is_two_devices(trainer, many, among_many, monkeypatch):
    assert jax.device_count() == 2
    first, last, _ = among_many
    monkeypatch.setattr(seeds, "_shards", lambda number: 1)
    first_one, last_one, _ = run(trainer, range(many))
    chex.assert_trees_all_equal(first, first_one)
    same_to_rounding(last, last_one)


def test_seeds_that_step_together_are_those_that_step_one_after_another(trainer, many, among_many, monkeypatch):
    one_after_another, parts = seeds.over_seeds, []
    monkeypatch.setattr(seeds, "over_seeds", lambda of: parts.append(of) or one_after_another(of))
    first, last, _ = run(trainer._replace(together=True), range(many))
    assert parts == [trainer.init]
    chex.assert_trees_all_equal(first, among_many[0])
    same_to_rounding(last, among_many[1])


@pytest.mark.slow
def test_two_chunks_are_one_chunk_of_their_length(trainer):
    _, last, _ = run(trainer, [0, 1], chunks=(4,))
    _, last_twice, _ = run(trainer, [0, 1], chunks=(2, 2))
    chex.assert_trees_all_equal(last, last_twice)


def test_seeds_in_groups_are_those_of_one_call_in_their_order_and_few_are_one_call(monkeypatch):
    monkeypatch.setattr(seeds, "GROUP", 3)
    calls = []

    def of(keys, numbers):
        calls.append(len(numbers))
        return {"first": jax.vmap(jax.random.uniform)(keys), "twice": 2 * numbers}

    keys, numbers = seed_keys(range(8)), jnp.arange(8.0)
    found = seeds.in_groups(of, keys, numbers)
    assert calls == [3, 3, 2]
    chex.assert_trees_all_equal(found, jax.device_get(of(keys, numbers)))
    calls.clear()
    seeds.in_groups(of, keys[:3], numbers[:3])
    assert calls == [3]


@pytest.mark.skipif(not Path("/proc/self/maps").exists(), reason="another system than Linux")
def test_what_was_compiled_is_forgotten_where_it_holds_too_many_memory_maps():
    double: Any = jax.jit(lambda x: 2 * x)
    double(jnp.ones(3))
    seeds.relieve(share=1.0)  # a process of many tests may hold a quarter already
    assert double._cache_size() == 1
    seeds.relieve(share=0.0)
    assert double._cache_size() == 0
