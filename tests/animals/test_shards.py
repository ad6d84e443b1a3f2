"""A sum over shards and devices is the sum over all rows, with its gradient, and no fit depends on how rows are cut."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from aircl_jax.animals import shards
from aircl_jax.animals.behaviour import design, fit
from aircl_jax.animals.shards import sharded, summed
from tests.animals.herds import goat_recordings


def squares(parameters, rows):
    return rows["weight"] @ (rows["x"] @ parameters["a"] + parameters["b"]) ** 2


@pytest.mark.parametrize(("largest", "number"), [(100, 1), (9, 4), (4, 6)])
def test_a_sum_over_shards_and_its_gradient_are_those_over_all_rows(largest, number, monkeypatch):
    monkeypatch.setattr(shards, "SHARD", largest)
    draws = np.random.default_rng(0)
    x, weight = draws.normal(size=(23, 2)), draws.random(23)
    rows = sharded({"x": x}, weight)
    assert rows["x"].shape[0] == number
    assert len(rows["x"].sharding.device_set) == (1 if number == 1 else 2)
    with jax.enable_x64(True):
        parameters = {"a": jnp.asarray([0.5, -1.0]), "b": jnp.asarray(2.0)}
        value, slope = jax.jit(jax.value_and_grad(lambda of: 3 * summed(squares, of, rows)))(parameters)
    residual = x @ [0.5, -1.0] + 2.0
    assert float(value) == pytest.approx(3 * weight @ residual**2, rel=1e-12)
    np.testing.assert_allclose(slope["a"], 6 * (weight * residual) @ x, rtol=1e-12)
    assert float(slope["b"]) == pytest.approx(6 * weight @ residual, rel=1e-12)


def test_the_model_is_the_same_of_one_shard_and_of_many(monkeypatch):
    herd, every = goat_recordings(recordings=3, animals=2, rows=100), np.ones(3, dtype=bool)
    columns = design(herd)
    whole = fit(columns, columns.leaving(every), every)
    monkeypatch.setattr(shards, "SHARD", 40)
    cut = fit(columns, columns.leaving(every), every)
    np.testing.assert_allclose(cut.leaving, whole.leaving, rtol=1e-6, atol=1e-8)
    for one, other in zip(cut.going, whole.going, strict=True):
        np.testing.assert_allclose(one, other, rtol=1e-6, atol=1e-8)


def test_steps_that_look_the_same_are_computed_once():
    herd = goat_recordings()
    columns = design(herd)
    assert len(columns.cells.values) < 0.1 * len(columns.cell) == 0.1 * len(herd.steps.code)
    assert len(columns.choices.step) < 0.6 * len(columns.choices.change)
    assert columns.choices.times.sum() == len(columns.choices.change) == (herd.steps.code != herd.steps.following).sum()
