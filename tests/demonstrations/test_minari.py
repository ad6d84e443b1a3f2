"""Minari data sets: read from their id or folder in either format, or refused by the name of their spaces."""

from typing import Any

import numpy as np
import pytest

from aircl_jax.demonstrations import files
from tests.demonstrations.test_files import O, T, robot

pytestmark = pytest.mark.filterwarnings("ignore::UserWarning")  # Minari's, on what a data set does not say of its author
minari = pytest.importorskip("minari")
ROBOT, NAME = robot(), "own/test-v0"


@pytest.fixture(autouse=True)
def sets(tmp_path, monkeypatch):
    monkeypatch.setenv("MINARI_DATASETS_PATH", str(tmp_path))


def make(observations: Any, space: Any, data_format: str) -> None:
    """One episode of T steps, kept under NAME."""
    from gymnasium.spaces import Box
    from minari.data_collector import EpisodeBuffer

    actions = [np.full(2, 0.5, np.float32)] * T
    ends = [False] * (T - 1) + [True]
    episode = EpisodeBuffer(
        id=0, observations=observations, actions=actions, rewards=[1.0] * T, terminations=[False] * T, truncations=ends
    )
    box = Box(-1, 1, (2,))
    minari.create_dataset_from_buffers(NAME, [episode], observation_space=space, action_space=box, data_format=data_format)


@pytest.mark.parametrize("data_format", ["arrow", "hdf5"])
def test_a_set_of_one_array_a_step_is_read_by_id_and_from_its_folder(tmp_path, data_format):
    from gymnasium.spaces import Box

    if data_format == "hdf5":
        pytest.importorskip("h5py")
    make([np.full(O, float(t), np.float32) for t in range(T + 1)], Box(-9, 9, (O,)), data_format)
    for source in (f"minari:{NAME}", tmp_path / NAME):
        loaded = files.load(source, ROBOT)
        assert loaded.obs[0, :, 0].tolist() == list(range(T))
        assert (loaded.action == 0.5).all() and (loaded.reward == 1).all() and (loaded.mask == 1).all()


@pytest.mark.parametrize("kind", ["Dict", "Tuple"])
def test_spaces_of_several_arrays_are_refused_by_name(tmp_path, kind):
    from gymnasium import spaces

    box, whole = spaces.Box(-1, 1, (2,)), [np.zeros(2, np.float32)] * (T + 1)
    if kind == "Dict":
        make({"a": whole}, spaces.Dict({"a": box}), "arrow")
    else:
        make((whole,), spaces.Tuple((box,)), "arrow")
    for source in (f"minari:{NAME}", tmp_path / NAME):
        with pytest.raises(
            ValueError, match=f"its observations are of a {kind} space; choose a data set with one array a step"
        ):
            files.load(source, ROBOT)
