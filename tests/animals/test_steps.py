"""What is known at each step: ages, bouts, neighbours by name, windows, and what cannot follow."""

import numpy as np
import pytest

from envs.animals import simulated_meerkats
from envs.animals.columns import load_mapping
from envs.animals.full.reading import read_recordings
from envs.animals.full.steps import NONE, possible_changes, recordings_of
from envs.animals.neighbours import read_neighbours
from envs.animals.tracks import read_folder
from envs.animals.windows import code_rows, cut_windows
from tests.animals.herds import GOATS, tracks_of


def test_ages_and_the_activity_before_are_those_worked_by_hand():
    acts = ["graze", "graze", "rest", "rest", "rest", "watch", "rest"]
    rows = [("day", "a", float(time), act, "hill") for time, act in enumerate(acts)]
    rows += [("day", "a", 20.0, "rest", "hill"), ("day", "a", 21.0, "graze", "hill"), ("day", "b", 0.0, "rest", "hill")]
    herd = recordings_of(code_rows(tracks_of(rows), GOATS), GOATS, horizon=3)
    steps = herd.steps
    np.testing.assert_array_equal(steps.code, [0, 0, 1, 1, 1, 2, 1])  # no step from a segment's last row
    np.testing.assert_array_equal(steps.following, [0, 1, 1, 1, 2, 1, 0])
    np.testing.assert_array_equal(steps.age, [1, 2, 1, 2, 3, 1, 1])
    np.testing.assert_array_equal(steps.unseen, [True, True, False, False, False, False, True])
    np.testing.assert_array_equal(steps.previous, [NONE, NONE, 0, 0, 0, 1, NONE])
    np.testing.assert_array_equal(steps.window, [0, 0, 0, 1, 1, 1, NONE])


def test_the_windows_of_the_steps_are_those_of_the_world():
    tracks = simulated_meerkats.simulated_tracks()
    coded = code_rows(tracks, simulated_meerkats.MAPPING)
    windows, steps = cut_windows(coded, tracks), recordings_of(coded, simulated_meerkats.MAPPING).steps
    order = np.argsort(steps.window[steps.in_window], kind="stable")
    np.testing.assert_array_equal(steps.code[steps.in_window][order].reshape(-1, 30), windows.code[:, :-1])
    np.testing.assert_array_equal(steps.following[steps.in_window][order].reshape(-1, 30), windows.code[:, 1:])


@pytest.mark.parametrize("coding", ["bout", "step"])
def test_every_change_that_was_made_was_possible_and_no_place_of_the_other_camera_is(coding):
    herd = read_recordings("simulated", coding=coding)
    steps, possible = herd.steps, possible_changes(herd)
    changed = np.flatnonzero(steps.code != steps.following)
    assert possible[changed, steps.following[changed]].all()
    assert not possible[np.arange(len(possible)), steps.code].any()
    door = herd.names.index("moving to Door")
    np.testing.assert_array_equal(possible[:, door].any(), True)
    assert not possible[steps.site == herd.sites.index("C3"), door].any()


TABLE = """Time,ID,Behaviour,Zone,Meerkat type,Close_neighbours,Distant_neighbours,Coordinates
0,0,Moving,Foraging,Adult,{1;2},{},[1;2;3]
1,0,Moving,Foraging,Adult,{},{1},[1;2;3]
0,1,Foraging,Foraging,Adult,{0;2},{},[1;2;3]
1,1,Groom,Foraging,Adult,{},{0;7},[1;2;3]
0,2,None,Foraging,Pup,{},{},[1;2;3]
"""


def test_neighbours_are_counted_by_what_they_do_at_the_same_time(tmp_path):
    (tmp_path / "day.csv").write_text(TABLE)
    mapping = load_mapping("meerkat")
    tracks = read_folder(tmp_path, mapping).tracks
    rows = code_rows(tracks, mapping).tracks
    found = read_neighbours(tmp_path, mapping, tracks, rows, mapping.behaviours)
    assert found is not None
    at = {name: number for number, name in enumerate(mapping.behaviours)}
    first = int(np.flatnonzero(rows.individual.are("0") & (rows.time == 0))[0])
    assert found.close[first, at["Foraging"]] == 1
    assert found.close[first, -1] == 1  # the pup
    assert found.close.sum() == 4
    assert found.distant[first + 1, at["Groom"]] == 1
    assert found.distant.sum() == 2  # animal 7 has no row


def test_neighbours_that_name_nobody_are_no_neighbours(tmp_path):
    (tmp_path / "day.csv").write_text(TABLE.replace("{1;2}", "{8;9}").replace("{0;2}", "{8}").replace("{1}", "{9}"))
    mapping = load_mapping("meerkat")
    tracks = read_folder(tmp_path, mapping).tracks
    assert read_neighbours(tmp_path, mapping, tracks, code_rows(tracks, mapping).tracks, mapping.behaviours) is None


@pytest.mark.parametrize(
    ("acts", "words"),
    [(["rest"] * 5, "there is nothing to learn"), (["rest"], "no animal has two rows in a row without a gap")],
)
def test_tables_that_say_nothing_are_refused_in_one_line(acts, words):
    rows = [("day", "a", float(time), act, "hill") for time, act in enumerate(acts)]
    with pytest.raises(ValueError, match=words):
        recordings_of(code_rows(tracks_of(rows), GOATS), GOATS)


def test_neighbours_are_found_by_times_of_day_and_not_in_hidden_tables(tmp_path):
    clock = TABLE.replace("\n0,", "\n12:00:00,").replace("\n1,", "\n12:00:01,")
    (tmp_path / "day.csv").write_text(clock)
    (tmp_path / "._day.csv").write_bytes(b"\x00\x05\x16\x07")
    mapping = load_mapping("meerkat")
    tracks = read_folder(tmp_path, mapping).tracks
    found = read_neighbours(tmp_path, mapping, tracks, code_rows(tracks, mapping).tracks, mapping.behaviours)
    assert found is not None
    assert found.close.sum() == 4
