"""Minari data sets: read from their id or folder in either format, refused by the name of their spaces, and written."""

from typing import Any

import jax
import numpy as np
import pytest

from aircl_jax.demonstrations import files, minari_data
from aircl_jax.demonstrations.sources import demonstrations
from aircl_jax.methods import METHODS
from aircl_jax.settings.env_defaults import default_config
from envs import make_env
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
        with pytest.raises(ValueError, match=f"its observations are of a {kind} space; "):
            files.load(source, ROBOT)


def test_a_part_of_observations_is_read_by_its_key(tmp_path):
    from gymnasium import spaces

    parts = {"a": [np.full(O, float(t), np.float32) for t in range(T + 1)], "b": [np.zeros(1, np.float32)] * (T + 1)}
    make(parts, spaces.Dict({"a": spaces.Box(-9, 9, (O,)), "b": spaces.Box(-9, 9, (1,))}), "arrow")
    for source in (f"minari:{NAME}@a", f"{tmp_path / NAME}@a"):
        assert files.load(source, ROBOT).obs[0, :, 0].tolist() == list(range(T))
    with pytest.raises(ValueError, match=f"no part 'c'; name one of a, b, as in minari:{NAME}@a"):
        files.load(f"minari:{NAME}@c", ROBOT)


@pytest.mark.parametrize("data_format", ["arrow", "hdf5"])
def test_what_is_written_is_read_with_cost_ends_and_unknown_rewards(data_format):
    random = np.random.default_rng(0)
    arrays = {
        "obs": random.normal(size=(3, T, O)).astype(np.float32),
        "action": random.uniform(-1, 1, size=(3, T, 2)).astype(np.float32),
        "cost": random.integers(2, size=(3, T)).astype(np.float32),
        "mask": (np.arange(T) < np.array([[T], [2], [1]])).astype(np.float32),
    }
    shown = arrays["mask"] > 0
    given = files.from_arrays(
        {name: np.where(shown.reshape(3, T, *[1] * (a.ndim - 2)), a, 0) for name, a in arrays.items()}, ROBOT
    )
    minari_data.write_minari(NAME, given, ROBOT, "", data_format)
    back = files.load(f"minari:{NAME}", ROBOT)
    for name in ("obs", "action", "cost", "mask", "reward"):
        np.testing.assert_array_equal(getattr(back, name), getattr(given, name), err_msg=name)
    [first, second, _] = minari.load_dataset(NAME).iterate_episodes()
    assert first.truncations[-1] and not first.terminations.any()
    assert second.terminations[-1] and not second.truncations.any()
    assert len(second.observations) == 3 and len(second.infos["cost"]) == 3


def test_a_name_that_is_none_or_taken_is_one_line():
    given = files.from_arrays({"obs": np.zeros((1, T, O)), "action": np.zeros((1, T, 2))}, ROBOT)
    with pytest.raises(ValueError, match="minari=mine is no id of a data set"):
        minari_data.write_minari("mine", given, ROBOT, "")
    minari_data.write_minari(NAME, given, ROBOT, "")
    with pytest.raises(ValueError, match=f"minari={NAME}: "):
        minari_data.write_minari(NAME, given, ROBOT, "")


@pytest.mark.slow
def test_the_command_writes_what_trains_as_the_npz(tmp_path, monkeypatch):
    from experiments.minari import main as command
    from experiments.run import main as run

    settings = ("env.size=3", "env.goal=[2,2]", "env.obstacles=[[1,1]]", "env.horizon=4")
    env = make_env("gridworld", size=3, goal=(2, 2), obstacles=((1, 1),), horizon=4)
    expert, _ = demonstrations(env, [0], default_config("gridworld", METHODS["airl"].settings))
    files.save(tmp_path / "mine.npz", jax.tree.map(lambda leaf: leaf[0, :8], expert), {})
    world = "env_settings={size: 3, goal: [2, 2], obstacles: [[1, 1]], horizon: 4}"
    assert command(["env=gridworld", world, f"demonstrations={tmp_path / 'mine.npz'}", "minari=own/grid-v0"]) == 0
    words = ["env=gridworld", "method=airl", "scale=smoke", "iterations=2", "seeds=1", "train.hidden=[4]", *settings]
    for place, source in (("a", tmp_path / "mine.npz"), ("b", "minari:own/grid-v0")):
        assert run([*words, f"demonstrations={source}", f"run_dir={tmp_path / place}"]) == 0
    assert (tmp_path / "a" / "metrics.jsonl").read_bytes() == (tmp_path / "b" / "metrics.jsonl").read_bytes()


@pytest.mark.parametrize(
    ("words", "says"),
    [([], "minari is missing"), (["env=gridworld", "minari=a-v0"], "env=gridworld ships no demonstrations")],
)
def test_what_does_not_fit_the_command_is_one_line(words, says, capsys):
    from experiments.minari import main as command

    assert command(words) == 2
    assert says in capsys.readouterr().err
