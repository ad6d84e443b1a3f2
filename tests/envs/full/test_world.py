"""The world of whole recordings: what is seen at a row, what is replayed, and where a move leads."""

from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from envs import Activities, make_env
from envs.animals.full.observation import coordinates, parts, read
from envs.animals.full.reading import read_recordings
from envs.animals.meerkat import demonstrations
from envs.checks import check_env
from envs.options import MeerkatOptions
from tests.animals.herds import written_goats

HORIZON = 5


@pytest.fixture(scope="module")
def table(tmp_path_factory):
    return written_goats(tmp_path_factory.mktemp("goats"), recordings=4, animals=2, rows=60)


@pytest.fixture(scope="module")
def world(table):
    env: Any = make_env("meerkat", state="full", horizon=HORIZON, **table)
    assert isinstance(env.view, Activities)
    return env, env.view.recordings, env.recorded.demonstrations()


def test_it_fits_the_protocol_and_names_every_coordinate(world):
    env, recordings, _ = world
    check_env(env)
    assert env.coordinate_names == coordinates(recordings)
    assert len(env.coordinate_names) == env.obs_size


def test_what_the_tables_lack_has_no_coordinate_and_is_said(world):
    env, recordings, _ = world
    assert [part.name for part in parts(recordings)] == ["code", "place", "previous", "age", "unseen", "tempo"]
    account = "\n".join(env.recorded.account)
    assert "The tables count no neighbours: nothing is known of company." in account
    assert "used: 472 rows that the next row follows" in account  # 4 recordings of 2 goats with 60 rows, 59 of which go on


def test_every_step_of_every_segment_is_demonstrated_once(world):
    _, recordings, arrays = world
    here = arrays["mask"] > 0
    assert here.sum() == len(recordings.steps.code) == 4 * 2 * 59
    assert here.shape[1] == HORIZON
    seen, _ = read(arrays["obs"][here].astype(float), recordings)
    for name in ("code", "previous", "place", "age", "unseen"):
        np.testing.assert_array_equal(getattr(seen.steps, name), getattr(recordings.steps, name), err_msg=name)
    np.testing.assert_array_equal(arrays["action"][here], recordings.steps.following)


def test_tempo_is_that_of_naive_counting(world):
    _, recordings, arrays = world
    steps, size = recordings.steps, len(recordings.names)
    tempo = arrays["obs"][arrays["mask"] > 0][:, env_column(recordings, "tempo so far")]
    for row in (0, 7, 58, 59, 200, 471):
        others = steps.recording != steps.recording[row]
        left = (steps.code != steps.following)[others]
        everywhere = left.mean()
        rate = [
            (left[steps.code[others] == code].sum() + 10 * everywhere) / ((steps.code[others] == code).sum() + 10)
            for code in range(size)
        ]
        before = [other for other in range(row) if steps.track[other] == steps.track[row]]
        changes = sum(steps.code[other] != steps.following[other] for other in before)
        expected = sum(rate[steps.code[other]] for other in before)
        np.testing.assert_allclose(tempo[row], np.log((changes + 2) / (expected + 2)), rtol=1e-4, atol=1e-5)


def env_column(recordings, name):
    return coordinates(recordings).index(name)


def test_the_recorded_actions_from_a_recorded_start_show_what_was_recorded(world):
    env, _, arrays = world
    step = jax.jit(env.step)
    key = jax.random.key(3)
    state, obs = env.reset(key)
    row = int(state.row)
    rows = arrays["obs"][arrays["mask"] > 0]
    taken = arrays["action"][arrays["mask"] > 0]
    for t in range(HORIZON):
        np.testing.assert_allclose(obs, rows[row + t], atol=1e-5)
        state, after = step(key, state, jnp.asarray(taken[row + t]))
        obs = after.obs


def test_an_animal_arrives_where_it_moves_to_when_it_leaves_the_move_and_its_neighbours_go_on_as_recorded():
    env: Any = make_env("meerkat", data="simulated", state="full")
    recordings = env.view.recordings
    step, key = jax.jit(env.step), jax.random.key(0)
    state, _ = env.reset(key)
    place = recordings.places.index("Mound")
    move, rest = recordings.names.index("moving to Mound"), recordings.names.index("Groom")
    before = int(state.place)
    for action, where in ((move, before), (move, before), (rest, place), (rest, place)):
        state, after = step(key, state, jnp.asarray(action))
        assert int(state.place) == where
        seen, _ = read(after.obs[None], recordings)
        assert int(seen.steps.code[0]) == action
        assert int(seen.steps.close[0]) == recordings.steps.close[int(state.row)]
    assert (int(state.age), int(state.previous)) == (2, move)


def test_a_fold_holds_out_whole_recordings(table):
    options = MeerkatOptions(state="full", horizon=HORIZON, fold=1, **table)
    sizes = [int(demonstrations(options, split)["mask"].sum()) for split in ("all", "train", "held_out")]
    assert sizes == [472, 236, 236]


def test_the_truth_of_the_simulated_mob_is_known_and_its_reference_set_violates():
    env: Any = make_env("meerkat", data="simulated", state="full")
    arrays, reference = env.recorded.demonstrations(), env.recorded.reference()
    assert env.has_reward
    assert arrays["cost"].sum() == 0
    assert 0.2 < (reference["cost"] * reference["mask"]).any(axis=1).mean() < 0.8
    assert read_recordings("simulated").sight.shape == (2, 10)


def test_pups_of_their_own_are_refused_in_one_line():
    with pytest.raises(ValueError, match=r"env\.pups=true: env\.state=full sees pups as neighbours"):
        make_env("meerkat", data="simulated", state="full", pups=True)
