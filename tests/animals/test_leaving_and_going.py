"""The likelihoods of leaving and of where to go equal naive float64 numpy, in value and in gradient, and fits end at rest."""

from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from aircl_jax.animals.features import named
from aircl_jax.animals.going import MODEL, ORDINARY, Choices, Weights, choices_of, fit_going, going_loss, log_going
from aircl_jax.animals.leaving import Known, fit_leaving, leaving_loss, log_leaving
from aircl_jax.animals.minimise import minimise
from aircl_jax.animals.shards import sharded
from tests.animals.herds import goat_recordings


@pytest.fixture(scope="module")
def choices() -> Choices:
    return choices_of(goat_recordings(recordings=3, animals=2, rows=60), MODEL)


def some_weights(choices: Choices, seed: int = 0) -> Weights:
    draws, size = np.random.default_rng(seed), choices.possible.shape[1]
    shapes = ((choices.situation.shape[1], size), (choices.field.shape[2],), (size,), (size,))
    return Weights(*(draws.normal(size=shape) for shape in shapes))


def data_of(choices: Choices, weight: np.ndarray) -> dict[str, Any]:
    names = ("situation", "field", "returning", "joining", "left", "chosen", "possible")
    ridge = {f"ridge_{name}": value for name, value in choices.ridge._asdict().items()}
    return {"rows": sharded({name: getattr(choices, name) for name in names}, weight), **ridge}


def naive_going(choices: Choices, weights: Weights, weight: np.ndarray) -> tuple[float, Weights]:
    """The loss and its gradient, one change and one activity at a time."""
    size = choices.possible.shape[1]
    loss, slope = 0.0, Weights(*(np.zeros_like(part) for part in weights))
    for n in range(len(choices.chosen)):
        utility = np.full(size, -np.inf)
        for code in np.flatnonzero(choices.possible[n]):
            utility[code] = sum(choices.situation[n, j] * weights.table[j, code] for j in range(len(weights.table)))
            utility[code] += sum(choices.field[n, code, k] * weights.shared[k] for k in range(len(weights.shared)))
            utility[code] += choices.returning[n, code] * weights.back[choices.left[n]]
            utility[code] += choices.joining[n, code] * weights.join[code]
        share = np.exp(utility) / np.exp(utility).sum()
        loss -= weight[n] * np.log(share[choices.chosen[n]])
        apart = weight[n] * (share - np.eye(size)[choices.chosen[n]])
        for code in range(size):
            slope.table[:, code] += apart[code] * choices.situation[n]
            slope.shared[:] += apart[code] * choices.field[n, code]
            slope.back[choices.left[n]] += apart[code] * choices.returning[n, code]
            slope.join[code] += apart[code] * choices.joining[n, code]
    loss += 0.5 * sum(float((ridge * part**2).sum()) for part, ridge in zip(weights, choices.ridge, strict=True))
    return loss, Weights(*(one + ridge * part for one, ridge, part in zip(slope, choices.ridge, weights, strict=True)))


def test_likelihood_and_gradient_of_where_to_go_are_those_of_naive_numpy(choices):
    weights, weight = some_weights(choices), np.random.default_rng(1).random(len(choices.chosen))
    expected, slope = naive_going(choices, weights, weight)
    with jax.enable_x64(True):
        loss, gradient = jax.value_and_grad(going_loss)(weights, jax.tree.map(jnp.asarray, data_of(choices, weight)))
    assert float(loss) == pytest.approx(expected, rel=1e-12)
    for found, by_hand in zip(gradient, slope, strict=True):
        np.testing.assert_allclose(found, by_hand, rtol=1e-9, atol=1e-10)


def test_a_fit_of_where_to_go_ends_where_the_naive_gradient_vanishes(choices):
    weight = np.ones(len(choices.chosen))
    _, slope = naive_going(choices, fit_going(choices, weight), weight)
    assert max(np.abs(part).max(initial=0.0) for part in slope) < 1e-3


def test_probabilities_of_where_to_go_are_one_over_the_possible_activities(choices):
    weights, size = some_weights(choices), choices.possible.shape[1]
    total = np.zeros(len(choices.chosen))
    for code in range(size):
        asked = choices._replace(chosen=np.full(len(choices.chosen), code))
        total += np.where(choices.possible[:, code], np.exp(log_going(asked, weights)), 0.0)
    np.testing.assert_allclose(total, 1.0, rtol=1e-12)


def test_weight_zero_is_as_if_a_change_were_not_there(choices):
    kept = np.arange(len(choices.chosen)) % 2 == 0
    columns = ("step", "situation", "field", "returning", "joining", "left", "chosen", "possible")
    half = choices._replace(**{name: getattr(choices, name)[kept] for name in columns})
    weighted, cut = fit_going(choices, kept.astype(float)), fit_going(half, np.ones(int(kept.sum())))
    for one, other in zip(weighted, cut, strict=True):
        np.testing.assert_allclose(one, other, atol=1e-4)


def test_what_the_tables_lack_is_left_out(choices):
    assert choices.situations == ("anywhere", "hill", "shade")
    assert choices.fields == ("moving to where it is", "back to the activity before", "back within 3 rows")
    assert choices_of(goat_recordings(recordings=2, animals=1, rows=40), ORDINARY).fields == ("moving to where it is",)


def naive_leaving(
    x: np.ndarray, left: np.ndarray, weight: np.ndarray, ridge: np.ndarray, w: np.ndarray
) -> tuple[float, np.ndarray]:
    loss, slope = 0.5 * float((ridge * w**2).sum()), ridge * w
    for row, gone, counts in zip(x, left, weight, strict=True):
        chance = 1 / (1 + np.exp(-sum(row * w)))
        loss -= counts * (np.log(chance) if gone else np.log(1 - chance))
        slope = slope + counts * (chance - gone) * row
    return loss, slope


CELL = np.arange(80) % 40  # two rows each


@pytest.fixture(scope="module")
def hazard() -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    draws = np.random.default_rng(0)
    x = np.concatenate([np.ones((80, 1)), draws.normal(size=(80, 2)) * [1, 7]], axis=1)
    x[:, :2] = x[CELL, :2]
    return x, draws.random(80) < 0.3, draws.random(80), np.array([0.01, 1.0, 3.0])


def test_likelihood_and_gradient_of_leaving_are_those_of_naive_numpy(hazard):
    x, left, weight, ridge = hazard
    w = np.array([-1.0, 0.5, 0.1])
    expected, slope = naive_leaving(x, left, weight, ridge, w)
    with jax.enable_x64(True):
        rows = sharded({"cell": CELL, "own": x[:, 2:], "left": left}, weight)
        data = {"cells": x[:40, :2], "ridge": ridge, "rows": rows}
        loss, gradient = jax.value_and_grad(leaving_loss)(jnp.asarray(w), jax.tree.map(jnp.asarray, data))
    assert float(loss) == pytest.approx(expected, rel=1e-12)
    np.testing.assert_allclose(gradient, slope, rtol=1e-9)


def test_a_fit_of_leaving_ends_where_the_naive_gradient_vanishes(hazard):
    x, left, weight, ridge = hazard
    cells = named(x[:40, :2], ["always", "one"], 1.0)._replace(ridge=ridge[:2])
    known = Known(cells, CELL, named(x[:, 2:], ["other"], ridge[2]))
    w = fit_leaving(known, left, weight)
    assert np.abs(naive_leaving(x, left, weight, ridge, w)[1]).max() < 1e-2
    nats, chance = log_leaving(known, w, left)
    np.testing.assert_allclose(np.exp(nats), np.where(left, chance, 1 - chance), rtol=1e-12)


def test_the_minimum_of_a_parabola_is_found():
    found, steepest = minimise(lambda x, data: ((x["a"] - data) ** 2).sum(), {"a": np.zeros(2)}, np.array([3.0, -2.0]))
    np.testing.assert_allclose(found["a"], [3.0, -2.0], atol=1e-6)
    assert steepest < 1e-3
