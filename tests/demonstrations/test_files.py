import pickle
from dataclasses import replace

import numpy as np
import pytest

from aircl_jax import outcome
from aircl_jax.demonstrations import files
from aircl_jax.runs.spec import make_spec
from envs import Box, Env, make_env
from tests.worlds import TINY, tiny_grid

GRID = tiny_grid()
N, T, O = 3, GRID.horizon, GRID.obs_size


def arrays(**changes):
    """A valid set of demonstrations of the tiny grid, with changes; None takes an array away."""
    valid = {"obs": np.eye(O, dtype=np.float32)[np.zeros((N, T), int)], "action": np.zeros((N, T), int)}
    return {name: value for name, value in (valid | changes).items() if value is not None}


def npz(tmp_path, **changes):
    path = tmp_path / "mine.npz"
    np.savez(path, **arrays(**changes))
    return path


def robot() -> Env:
    return Env("robot", T, O, Box(2), reset=lambda key: (None, None), step=lambda *_: (None, None))  # pyright: ignore


def test_what_is_saved_is_loaded(tmp_path):
    path = tmp_path / "saved.npz"
    zeros = np.zeros((N, T))
    first = files.load(npz(tmp_path, reward=zeros + 2, cost=zeros, mask=zeros + 1), GRID)
    files.save(path, first, {"source": "a test"})
    for before, after in zip(first, files.load(path, GRID), strict=True):
        assert np.array_equal(before, after)
    assert files.metadata(path) == {"source": "a test"}


def test_what_a_file_does_not_say_is_undefined_and_not_zero(tmp_path):
    loaded = files.load(npz(tmp_path), GRID)
    assert np.isnan(loaded.reward).all() and np.isnan(loaded.cost).all()
    assert (loaded.mask == 1).all() and (loaded.log_prob == 0).all()


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"obs": np.full((N, T, O), np.nan)}, "obs is not finite in trajectory 0, step 0"),
        ({"obs": np.zeros((N, T, O + 1))}, rf"obs has shape \[3, 4, {O + 1}\]; gridworld needs \[3, 4, {O}\]"),
        ({"obs": np.zeros((N, T + 1, O)), "action": np.zeros((N, T + 1), int)}, "obs has shape .* needs"),
        ({"obs": np.zeros((0, T, O)), "action": np.zeros((0, T), int)}, "it holds no trajectory"),
        ({"action": np.zeros((N, T, 1), int)}, "action has shape"),
        ({"action": np.full((N, T), 4)}, "action runs from 4 to 4; gridworld has integers 0 to 3"),
        ({"action": np.zeros((N, T))}, "action is of type float64; gridworld has integers 0 to 3"),
        ({"action": None}, "action is missing; it holds obs"),
        ({"obs": np.full((N, T, O), "a")}, "obs is of type <U1; numbers are needed"),
        ({"obs": np.full((N, T, O), None)}, "pickled objects"),
        ({"mask": np.tile([0, 1, 1, 1], (N, 1))}, "mask must be 1 up to"),
        ({"cost": np.full((N, T), 0.5)}, "cost must be 0 or 1"),
        ({"reward": np.zeros(N)}, "reward has shape"),
    ],
)
def test_what_does_not_fit_is_refused_in_one_line(changes, message, tmp_path):
    path = npz(tmp_path, **changes)
    with pytest.raises(ValueError, match=message) as caught:
        files.load(path, GRID)
    assert str(caught.value).startswith(f"demonstrations={path}: ")
    assert "\n" not in str(caught.value)


def test_actions_in_another_unit_are_refused(tmp_path):
    path = npz(tmp_path, action=np.full((N, T, 2), 40.0))
    with pytest.raises(ValueError, match=r"far outside \[-1, 1\]"):
        files.load(path, robot())


@pytest.mark.parametrize("content", [b"", b"no archive", pickle.dumps([1, 2]), b"PK\x03\x04cut short"])
def test_a_file_of_another_kind_is_refused(content, tmp_path):
    path = tmp_path / "mine.npz"
    path.write_bytes(content)
    with pytest.raises(ValueError, match=r"no whole \.npz"):
        files.load(path, GRID)


def test_pickled_objects_are_refused(tmp_path):
    np.savez(tmp_path / "mine.npz", obs=np.array([{}], dtype=object))
    with pytest.raises(ValueError, match="holds pickled objects"):
        files.load(tmp_path / "mine.npz", GRID)


def test_a_missing_file_is_named(tmp_path):
    with pytest.raises(ValueError, match="there is no such file"):
        files.load(tmp_path / "none.npz", GRID)


def test_a_folder_without_a_minari_data_set_is_refused(tmp_path):
    with pytest.raises(ValueError, match="no Minari data set"):
        files.load(tmp_path, GRID)


@pytest.mark.parametrize("shipped", [True, False])
def test_the_reference_set_beside_a_file_counts_where_the_world_has_none(shipped, tmp_path):
    mine = npz(tmp_path)
    cost = np.tile([0.0, 1.0, 0.0, 0.0], (2 * N, 1))
    if shipped:
        obs, action = (np.concatenate([array] * 2) for array in (arrays()["obs"], arrays()["action"]))
        np.savez(tmp_path / "mine_reference.npz", obs=obs, action=action, cost=cost)
    spec = make_spec(
        replace(GRID, tabular=None, has_reward=False),
        "aircl_corrected",
        contrast_prior="method",
        seeds=2,
        first_seed=0,
        iterations=1,
        demonstrations=mine,
        env_settings={},
        config=TINY,
    )
    expert, reference = outcome.demonstrations_of(spec)
    assert expert.obs.shape == (2, N, T, O)
    assert len(reference.cost) == (2 * N if shipped else N)
    assert np.array_equal(reference.cost, cost) == shipped


def test_observations_of_a_world_of_codes_must_be_one_hot(tmp_path):
    world = make_env("labyrinth", data="simulated")
    obs = np.eye(world.obs_size)[np.zeros((1, world.horizon), int)]
    mask = np.arange(world.horizon)[None] < 3
    action = np.zeros((1, world.horizon), int)
    padded = npz(tmp_path, obs=obs * mask[..., None], action=action, mask=mask.astype(int))
    assert files.load(padded, world).mask.sum() == 3
    with pytest.raises(ValueError, match=r"obs is not one-hot in trajectory 0, step 3; labyrinth has 127 codes"):
        files.load(npz(tmp_path, obs=obs * mask[..., None], action=action), world)
