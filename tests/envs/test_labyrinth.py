"""The mice's maze: deterministic dynamics that the recordings obey, simulated mice that keep their constraint."""

import os
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from envs import Discrete, make_env
from envs.animals import labyrinth
from envs.animals.data_folder import command_prefix
from envs.options import LabyrinthOptions

SIMULATED = LabyrinthOptions(data="simulated")
DATA = os.environ.get("AIRCL_DATA", "")
needs_data = pytest.mark.skipif(
    not (Path(DATA or "absent") / "labyrinth").is_dir(), reason="AIRCL_DATA names no folder with labyrinth/ in it"
)
SOURCES = ["simulated", pytest.param(DATA, marks=needs_data, id="real")]


@pytest.mark.parametrize("data", SOURCES)
def test_every_step_of_the_recordings_is_a_step_of_the_world(data):
    env, arrays = make_env("labyrinth", data=data), labyrinth.demonstrations(LabyrinthOptions(data=data))
    nodes = arrays["obs"].argmax(axis=-1)
    assert env.action_space == Discrete(4)
    assert env.tabular is not None
    after = env.tabular.transition[nodes[:, :-1], arrays["action"][:, :-1]].argmax(axis=-1)
    np.testing.assert_array_equal(after, nodes[:, 1:])


@pytest.mark.parametrize("data", SOURCES)
def test_step_is_the_table(data):
    env = make_env("labyrinth", data=data)
    assert env.tabular is not None
    states, actions = jnp.divmod(jnp.arange(127 * 4), 4)
    after, step = jax.vmap(env.step, in_axes=(None, 0, 0))(jax.random.key(0), states, actions)
    np.testing.assert_array_equal(env.tabular.transition[states, actions].argmax(axis=-1), after)
    np.testing.assert_allclose(step.cost, env.tabular.cost[states])
    np.testing.assert_allclose(step.reward, env.tabular.reward[states, actions])
    state, obs = env.reset(jax.random.key(0))
    np.testing.assert_array_equal(obs, env.tabular.obs[state])


def test_simulated_mice_keep_the_constraint_and_are_called_simulated():
    env = make_env("labyrinth", data="simulated")
    assert env.title == "labyrinth (simulated)"
    assert env.has_reward
    assert not labyrinth.demonstrations(SIMULATED)["cost"].any()
    assert 0.2 <= labyrinth.reference_set(SIMULATED)["cost"].any(axis=1).mean() <= 0.8


def test_a_fold_holds_out_a_tenth_of_the_recordings():
    train, held_out = (labyrinth.demonstrations(SIMULATED, split) for split in ("train", "held_out"))
    assert (len(train["obs"]), len(held_out["obs"])) == (900, 100)
    with pytest.raises(ValueError, match=r"env\.fold=10: choose 0 to 9"):
        labyrinth.demonstrations(LabyrinthOptions(data="simulated", fold=10))


def test_the_drawing_has_no_two_nodes_in_one_place():
    assert len(np.unique(labyrinth.layout(), axis=0)) == 127


def test_a_command_to_repeat_says_that_the_variable_led_to_recordings():
    assert command_prefix("default", simulated=False) == "AIRCL_DATA=DIR "
    assert command_prefix("default", simulated=True) == command_prefix("folder", simulated=False) == ""


@needs_data
def test_real_mice_have_no_reward_and_no_reference_set():
    env = make_env("labyrinth", data=DATA)
    assert env.title == "labyrinth"
    assert not env.has_reward
    assert labyrinth.demonstrations(LabyrinthOptions(data=DATA))["obs"].shape == (2380, 50, 127)
    with pytest.raises(ValueError, match="only simulated"):
        labyrinth.reference_set(LabyrinthOptions(data=DATA))


def tables() -> dict[str, np.ndarray]:
    maze = labyrinth.load(SIMULATED)
    emissions = np.stack([maze.node, maze.action], axis=-1)[:2, :60]
    return {"emissions": emissions, "trans_probs": np.eye(127)[maze.successor]}


def spoiled(name: str, where: tuple, value: float) -> dict[str, np.ndarray]:
    arrays = tables()
    arrays[name][where] = value
    return arrays


@pytest.mark.parametrize(
    ("arrays", "words"),
    [
        ({}, "no emissions.npy in or below it"),
        (spoiled("emissions", (0, 3, 0), 127), "emissions.npy: node runs from 0 to 127; choose 0 to 126"),
        (spoiled("emissions", (1, 5, 1), -1), "emissions.npy: action runs from -1"),
        (spoiled("trans_probs", (3, 0, 5), 0.5), "trans_probs.npy: zeros and ones"),
        (tables() | {"emissions": tables()["emissions"][:, :, :1]}, "emissions.npy: integers"),
        (
            tables() | {"emissions": tables()["emissions"][:, ::-1]},
            "recording 0, step [0-9]+: the next node is not where",
        ),
    ],
)
def test_malformed_arrays_are_refused_with_the_file(tmp_path, arrays, words):
    for name, values in arrays.items():
        np.save(tmp_path / f"{name}.npy", values)
    with pytest.raises(ValueError, match=words):
        make_env("labyrinth", data=str(tmp_path))


def test_a_broken_file_and_a_long_horizon_are_refused(tmp_path):
    for name in ("emissions.npy", "trans_probs.npy"):
        (tmp_path / name).write_bytes(b"not numpy")
    with pytest.raises(ValueError, match="file of numbers"):
        make_env("labyrinth", data=str(tmp_path))
    with pytest.raises(ValueError, match=r"env\.horizon=501: recordings have 500 steps"):
        make_env("labyrinth", data="simulated", horizon=501)
