"""DSRL files: the steps of all episodes one after another, with costs; what does not fit is one line."""

import numpy as np
import pytest

from aircl_jax.demonstrations import files
from tests.demonstrations.test_files import O, T, robot

h5py = pytest.importorskip("h5py", reason="the extra `minari` is not installed")
ROBOT = robot()


def write(path, without=(), **changed):
    """An episode of T steps that times out, one of 2 that ends, and one step more; in all T + 3."""
    number = T + 3
    ends = np.arange(1, number + 1)
    arrays = {
        "observations": np.arange(number, dtype=np.float32)[:, None] * np.ones((1, O), np.float32),
        "actions": np.full((number, 2), 0.5, np.float32),
        "rewards": np.ones(number, np.float32),
        "costs": (ends % 2).astype(np.float32),
        "terminals": ends == T + 2,
        "timeouts": ends == T,
        **changed,
    }
    with h5py.File(path, "w") as file:
        for name, values in arrays.items():
            if name not in without:
                file[name] = values
    return path


def test_episodes_are_cut_at_either_end_and_padded_under_the_mask(tmp_path):
    loaded = files.load(write(tmp_path / "own.hdf5"), ROBOT)
    assert np.asarray(loaded.mask).sum(axis=1).tolist() == [T, 2, 1]
    assert loaded.obs[0, :, 0].tolist() == list(range(T))
    assert loaded.obs[1, :2, 0].tolist() == [T, T + 1] and loaded.obs[2, 0, 0] == T + 2
    assert loaded.cost[0].tolist() == [(t + 1) % 2 for t in range(T)]
    assert (np.asarray(loaded.reward) == np.asarray(loaded.mask)).all()


@pytest.mark.parametrize(
    ("changed", "says"),
    [
        ({"without": ("costs", "timeouts")}, "costs, timeouts missing; it holds actions, observations, rewards, terminals"),
        ({"rewards": np.ones(2)}, f"its arrays have {T + 3} observations"),
        ({"timeouts": np.zeros(T + 3), "terminals": np.zeros(T + 3)}, f"an episode has {T + 3} steps"),
        ({"costs": np.full(T + 3, 0.5)}, "cost must be 0 or 1"),
    ],
)
def test_what_does_not_fit_is_one_line(tmp_path, changed, says):
    with pytest.raises(ValueError, match=says):
        files.load(write(tmp_path / "own.hdf5", **changed), ROBOT)


def test_a_file_that_is_absent_or_none_is_one_line(tmp_path):
    (tmp_path / "none.hdf5").write_text("no")
    for name, says in (("none.hdf5", "it is no HDF5 file"), ("absent.h5", "there is no such file")):
        with pytest.raises(ValueError, match=says):
            files.load(tmp_path / name, ROBOT)
