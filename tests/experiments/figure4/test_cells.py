"""Cells of Figure 4: q and π, means and maps, chain and chance each in their own place."""

from types import SimpleNamespace
from typing import Any, NamedTuple, cast

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from aircl_jax.algorithm.scoring import Drawn
from aircl_jax.analysis.causal import Links
from experiments.figure4 import cells, held_out
from experiments.figure4.cells import Settings, Study
from tests.worlds import random_trajectories, tiny_grid

REAL = np.array([[0.1, 0.2], [0.3, 0.4]])


def links(values: np.ndarray, lag: int = 1) -> Links:
    """With these strengths at lag 1 and none at the others."""
    lagged = np.zeros((2, 2, lag + 1))
    lagged[:, :, 1] = values
    return Links(lagged, lagged)


def study() -> Study:
    names = SimpleNamespace(names=("a", "b"), code=np.zeros((3, 4), int), recording=np.array(["x"] * 3))
    herd = SimpleNamespace(windows=names, truth=None)
    real = {lag: links(REAL, lag) for lag in cells.LAGS}
    return Study(cast(Any, herd), np.zeros((3, 3), int), real, cast(Any, None), "abc1234")


@pytest.fixture
def by_first_code(monkeypatch):
    """Links of windows: those of the recordings, and a tenth of the first code more in one place."""

    def strengths(codes, number, lag):
        return links(REAL + np.array([[0, codes.ravel()[0] / 10], [0, 0]]), lag)

    monkeypatch.setattr(cells, "link_strengths", strengths)


def windows(*first: int) -> np.ndarray:
    return np.stack([np.full((3, 3), code) for code in first])


def test_a_difference_is_the_mean_size_over_pairs_of_each_seed_and_over_seeds_of_each_pair(by_first_code):
    found = cells._compared(study(), windows(4, -2, 0))["1"]
    assert found["per_seed"] == [0.1, 0.05, 0.0]  # 0.4, 0.2 and 0 over four pairs
    assert found["map"] == [[0.0, 0.2], [0.0, 0.0]]
    assert found["links"] == [[0.1, 0.2667], [0.3, 0.4]]  # 0.2 and a third of 0.4 − 0.2


def test_a_cell_has_the_differences_of_q_and_of_the_policy_and_the_map_of_q(by_first_code, monkeypatch):
    result = SimpleNamespace(
        summary={"method": "airl"},
        alarms=["it rang"],
        spec=SimpleNamespace(env=SimpleNamespace(tabular=None)),
        history={"entropy": np.array([[1.0, 3.0], [5.0, 6.0]])},
    )
    monkeypatch.setattr(cells, "train", lambda *words, **given: result)
    monkeypatch.setattr(cells, "generate", lambda result, number: {"sampled": windows(4, 8), "policy": windows(0, 2)})
    monkeypatch.setattr(cells, "recover", lambda result, table: None)
    monkeypatch.setattr(cells, "as_json", lambda recovered: {})
    cell = cells.method_cell(Settings(seeds=2), study(), "airl")
    assert cell["difference"]["sampled"] == {"1": [0.1, 0.2], "5": [0.1, 0.2]}
    assert cell["difference"]["policy"] == {"1": [0.0, 0.05], "5": [0.0, 0.05]}
    assert cell["difference_map"]["1"] == [[0.0, 0.6], [0.0, 0.0]]
    assert cell["links"]["1"] == [[0.1, 0.8], [0.3, 0.4]]
    assert cell["curves"] == {"entropy": [2.0, 5.5]}  # means over seeds
    assert (cell["windows"], cell["command"].split(" ")[-1]) == (3, "seeds=2")


class State(NamedTuple):
    key: Any
    step: Any
    params: Any = None
    obs_stats: Any = None


def test_windows_of_q_are_drawn_by_delta_from_a_pool_and_those_of_the_policy_are_its_first_episodes(monkeypatch):
    pool = random_trajectories(tiny_grid(), 0, cells.POOL * 2)
    nets = SimpleNamespace(method=SimpleNamespace(draws=True), bind=lambda params, stats: None)

    def drawn(nets, key_rollout, key_sampler, size, number):
        assert (size, number) == (8, 2)
        return Drawn(pool, jnp.arange(8.0), jnp.asarray([7, 6]))

    monkeypatch.setattr(cells, "roll_out_and_draw", drawn)
    result = SimpleNamespace(
        networks=nets, summary={"seeds": [5]}, state=lambda index: State(jax.random.key(0), jnp.asarray(1))
    )
    found = cells.generate(cast(Any, result), 2)
    codes = np.asarray(pool.obs).argmax(axis=-1)
    assert found["policy"].tolist() == [codes[:2].tolist()]
    assert found["sampled"].tolist() == [codes[[7, 6]].tolist()]
    nets.method.draws = False
    same = cells.generate(cast(Any, result), 2)
    assert same["sampled"].tolist() == same["policy"].tolist() == [codes[:2].tolist()]


def test_the_yardsticks_maps_are_of_the_chain_and_of_chance(by_first_code, monkeypatch):
    monkeypatch.setattr(cells, "sample_chain", lambda start, chain, size, length, seed: np.full((size, length), 1))
    monkeypatch.setattr(cells, "uniform_windows", lambda size, length, number, seed: np.full((size, length), 5))
    monkeypatch.setattr(cells, "yardsticks", lambda codes, number, lag, seed: {"halves": lag + seed / 10})
    cell = cells.yardstick_cell(Settings(seeds=2), study())
    assert cell["1"]["maps"] == {"Markov chain": [[0.0, 0.1], [0.0, 0.0]], "uniform random": [[0.0, 0.5], [0.0, 0.0]]}
    assert cell["5"]["per_seed"] == {"halves": [5.0, 5.1]}


def recordings(**codes: list[list[int]]) -> Study:
    code = np.array([window for windows in codes.values() for window in windows])
    names = np.repeat(list(codes), [len(windows) for windows in codes.values()])
    herd = SimpleNamespace(windows=SimpleNamespace(code=code, recording=names, names=("a", "b")))
    return cast(Study, SimpleNamespace(herd=herd, num_codes=2))


def test_the_pseudo_count_is_small_where_recordings_agree_and_large_where_they_do_not():
    turns, stays = [0, 1, 0, 1, 0, 1], [0, 0, 0, 1, 1, 1]
    agreeing = recordings(one=[turns] * 5, two=[turns] * 5, out=[stays] * 20)
    assert held_out.smoothed_chain(agreeing, ["out"])[0] == min(held_out.SMOOTHINGS)
    apart = recordings(one=[turns] * 5, two=[stays] * 5, out=[turns])
    assert held_out.smoothed_chain(apart, ["out"])[0] == max(held_out.SMOOTHINGS)


def test_a_fold_has_the_mean_log_probability_of_what_followed_under_policy_and_chain(monkeypatch):
    now, after = np.array([[0, 0], [1, 0]]), np.array([[1, 1], [1, 1]])
    log_policy = np.array([[[-1.0, -2.0], [-3.0, -4.0]]])
    chain = np.exp([[-0.5, -1.5], [-2.5, -3.5]])
    result = SimpleNamespace(spec=SimpleNamespace(env=SimpleNamespace(tabular=None)))
    monkeypatch.setattr(held_out, "train", lambda *words, **given: result)
    monkeypatch.setattr(held_out, "recover", lambda result, table: SimpleNamespace(log_policy=log_policy))
    monkeypatch.setattr(held_out, "held_out_recordings", lambda options: [f"fold {options.fold}"])
    monkeypatch.setattr(held_out, "_transitions", lambda options: (now, after))
    monkeypatch.setattr(held_out, "smoothed_chain", lambda study, held_out: (0.3, chain))
    cell = held_out.held_out_cell(Settings(), study(), "airl", 4)
    assert cell["policy"] == pytest.approx((3 * -2.0 + -4.0) / 4)
    assert cell["chain"] == pytest.approx((3 * -1.5 + -3.5) / 4)
    assert (cell["transitions"], cell["recordings"], cell["smoothing"], cell["fold"]) == (4, ["fold 4"], 0.3, 4)
