"""Times of a table: seconds, times of day, dates and bouts are read, or refused by name with what step means."""

import numpy as np
import pytest

from envs.animals.columns import load_mapping
from envs.animals.spacing import one_step
from envs.animals.tracks import read_folder
from tests.envs.test_tables import ACTS, HEADER, YAML, herd, refused, rows, text

BOUTS = YAML.replace("act}", "act, stop: end}")


def tracks_of(folder, content: str, mapping: str = YAML):
    (folder / "herd.csv").write_text(content, encoding="utf-8")
    (folder / "goats.yaml").write_text(mapping, encoding="utf-8")
    return read_folder(folder, load_mapping(str(folder / "goats.yaml"))).tracks


def written(times: list[str], goat: str = "a") -> str:
    return text(HEADER, [(time, goat, ACTS[index % 4]) for index, time in enumerate(times)])


def test_epoch_seconds_at_100_hz_have_no_gap(tmp_path):
    content = written([f"{1_700_000_000 + index / 100:.2f}" for index in range(400)])
    report = herd(tmp_path, content, YAML + "step: 0.01\n").windows.report
    assert (report.segments, report.rows_used) == (1, 391)


def test_times_rounded_to_milliseconds_have_no_gap_and_a_missing_row_is_one(tmp_path):
    times = [f"{index / 30:.3f}" for index in range(40) if index != 20]
    assert herd(tmp_path, written(times), YAML + "step: 0.0333333\n").windows.report.segments == 2


def test_a_step_is_known_at_the_size_of_the_times():
    far = 2.0**60  # where neighbouring floats are 256 apart
    assert one_step(np.array([far, far + 256.0, far + 768.0]), 100.0).tolist() == [True, False]
    assert one_step(np.array([0.0, 1.05, 2.2, 4.2]), 1.0).tolist() == [True, False, False]


@pytest.mark.parametrize(
    ("times", "seconds"),
    [
        (["00:00:00", "00:00:01", "00:00:02.5"], [0.0, 1.0, 2.5]),
        (["9:59:59", "10:00:00", "10:00:01"], [35_999.0, 36_000.0, 36_001.0]),
        (["1970-01-01", "1970-01-02", "1970-01-03"], [0.0, 86_400.0, 172_800.0]),
        (["1970-01-01 00:00:59.500", "1970-01-01T00:01:00.500", "1970-01-01 00:01"], [59.5, 60.0, 60.5]),
        (["1970-01-01T01:00:00+01:00", "1970-01-01T00:00:01Z", "1970-01-01T00:00:02+0000"], [0.0, 1.0, 2.0]),
        (["1.5e0", "+2.5", "3.5"], [1.5, 2.5, 3.5]),
    ],
)
def test_times_of_day_and_dates_become_seconds(tmp_path, times, seconds):
    step = np.median(np.diff(seconds))
    assert tracks_of(tmp_path, written(times), YAML + f"step: {step}\n").time.tolist() == seconds


@pytest.mark.parametrize(
    ("times", "words"),
    [
        (["0", "1", "00:00:02"], r"row 4, column 't': '00:00:02' is HH:MM:SS where the rows before have a number; choose one"),
        (["00:01", "00:02"], r"row 2, column 't': '00:01' is hours and minutes or minutes and seconds; choose HH:MM:SS"),
        (
            ["01/05/2024 10:00"],
            r"row 2, column 't': '01/05/2024 10:00' is not a number, HH:MM:SS or an ISO date such as",
        ),
        (["2024-02-30", "2024-03-01"], r"row 2, column 't': '2024-02-30' is no date of the calendar"),
        (["2024-02-01 10:00:00", "2024-02-01 10:00:01Z"], "is an ISO date with a zone where the rows before have an ISO date;"),
        (["23:59:58", "23:59:59", "00:00:00"], r"row 4, column 't': '00:00:00' passes midnight; choose dates"),
        (["1_0", "1_1"], "'1_0' is not a number"),
        (["1e999", "2"], "'1e999' is not a finite number"),
        (["NaN", "2"], "'NaN' is not a number"),
    ],
)
def test_other_times_are_refused_by_name(tmp_path, times, words):
    refused(tmp_path, written(times), words)


def test_another_step_is_refused_with_the_medians_of_the_times(tmp_path):
    words = r"two rows of a track are 5 apart in the median, 5 to 5 in nine cases of ten, and step is 1; set step"
    refused(tmp_path, text(HEADER, rows(step=5.0)), words, horizon=1)
    assert herd(tmp_path, text(HEADER, rows(step=5.0)), YAML + "step: 5\n").windows.report.segments == 2


def test_animals_that_are_seen_once_are_no_tracks(tmp_path):
    content = text(HEADER, [(index, f"goat {index}", ACTS[index % 4]) for index in range(20)])
    refused(tmp_path, content, "no track has two rows; choose columns of time and individual")


# Bouts: a row has a start and a stop.


def bouts(*lines: tuple[object, ...]) -> str:
    return text(("t", "goat", "act", "end"), list(lines))


def test_bouts_are_refused_with_their_medians_where_no_column_ends_them(tmp_path):
    lines = [(4.0 * index, "a", ACTS[index % 4], 4.0 * index + 4.0) for index in range(30)]
    found = refused(tmp_path, bouts(*lines), "two rows of a track are 4 apart in the median, .*, and step is 1")
    assert found.endswith("name the column of its end, as in columns: {stop: 'end'}")


def test_bouts_become_a_row_for_each_step_within_them(tmp_path):
    content = bouts((0.0, "a", "eat", 1.25), (1.25, "a", "rest", 4.0), (4.0, "a", "nod", 4.0), (6, "a", "eat", 7.5))
    tracks = tracks_of(tmp_path, content, BOUTS)
    assert tracks.time.tolist() == [0.0, 1.0, 2.0, 3.0, 6.0, 7.0]
    assert tracks.behaviour.texts().tolist() == ["eat", "eat", "rest", "rest", "eat", "eat"]


def test_a_finer_step_takes_more_samples_and_loses_no_bout(tmp_path):
    content = bouts((0.1, "a", "eat", 0.3), (0.3, "a", "rest", 0.7))
    tracks = tracks_of(tmp_path, content, BOUTS + "step: 0.1\n")
    assert tracks.behaviour.texts().tolist() == ["eat", "eat", "rest", "rest", "rest", "rest"]
    assert one_step(tracks.time, 0.1).all()


def test_bouts_make_a_world_and_the_events_among_them_are_said(tmp_path):
    lines = [(3.0 * index, "a", ACTS[index % 3], 3.0 * index + 3.0) for index in range(20)] + [(5.5, "a", "nod", 5.5)]
    found = herd(tmp_path, bouts(*lines), BOUTS)
    assert found.windows.report.rows == 60
    assert "bouts: 21, of which a row is made every 1" in found.account.lines
    assert "left out: 1 bout between two samples: events, or shorter than a step" in found.account.lines


@pytest.mark.parametrize(
    ("lines", "words"),
    [
        (
            [(0, "a", "eat", 3), (2, "a", "rest", 4)],
            r"row 3, column 't': '2' begins before the bout of row 2 has ended",
        ),
        ([(0, "a", "eat", 3), (5, "a", "rest", 4)], r"row 3, column 'end': '4' is before the bout's start"),
        ([(0, "a", "eat", "NA")], r"row 2, column 'end': 'NA' is not a number"),
        ([("00:00:00", "a", "eat", 3)], r"row 2, column 'end': '3' is a number, and 't' is not"),
        ([(0, "a", "eat", 1e12)], r"1e\+12 samples with step 1; the longest bout lasts 1e\+12: choose a longer step"),
    ],
)
def test_bouts_that_make_no_sense_are_refused(tmp_path, lines, words):
    refused(tmp_path, bouts(*lines), words, BOUTS)
