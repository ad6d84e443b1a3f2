"""Tables of tracks to windows: validation in one line, codings worked by hand, another format, the published counts."""

import os
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from envs.animals.columns import load_mapping
from envs.animals.tracks import read_folder
from envs.animals.windows import code_rows, cut_windows, transitions

HEADER = "Time,ID,Behaviour,Zone,Meerkat type,Close_neighbours,Distant_neighbours,Coordinates"
ROWS = [
    "0,7,Foraging,Foraging,Adult,{},{1;2},[1.5;2;3]",
    "1,7,Moving,Foraging,Adult,{1},{},[2;2;3]",
    "2,7,Moving,Foraging,Adult,{},{},[0;0;0]",
    "3,7,Dig burrow,Door,Adult,{},{},[4;2;-3e1]",
    "0,8,None,Door,Pup,{},{},[4;2;3]",
]
MEERKAT = load_mapping("meerkat")
REAL = Path(os.environ.get("AIRCL_DATA", "absent")) / "meerkat"
needs_data = pytest.mark.skipif(not REAL.is_dir(), reason="AIRCL_DATA names no folder with meerkat/ in it")


def write(folder: Path, rows: list[str], header: str = HEADER, end: str = "\n") -> Path:
    (folder / "22-01-01_C2_01.csv").write_bytes((end.join([header, *rows]) + end).encode())
    return folder


def changed(row: int, old: str, new: str) -> list[str]:
    assert old in ROWS[row]
    return [text.replace(old, new, 1) if index == row else text for index, text in enumerate(ROWS)]


@pytest.mark.parametrize("end", ["\n", "\r\n"])
def test_a_good_table_is_read_whole_with_either_line_end(tmp_path, end):
    tracks = read_folder(write(tmp_path, ROWS, end=end), MEERKAT).tracks
    assert tracks.time.tolist() == [0, 1, 2, 3, 0]
    assert tracks.site.texts().tolist() == ["C2"] * 5
    assert tracks.close.tolist() == [0, 1, 0, 0, 0]
    assert tracks.distant.tolist() == [2, 0, 0, 0, 0]
    assert tracks.position[0].tolist() == [1.5, 2.0, 3.0]
    assert np.isnan(tracks.position[2]).all()


@pytest.mark.parametrize(
    ("rows", "header", "words"),
    [
        (
            ROWS,
            HEADER.replace("Zone", "Area"),
            r"22-01-01_C2_01\.csv: row 1, column 'Zone': missing; the file has Time",
        ),
        (
            changed(3, "Dig burrow", "Dancing"),
            HEADER,
            r"row 5, column 'Behaviour': 'Dancing' is unknown; choose from",
        ),
        (changed(3, "Dig burrow", "None"), HEADER, r"row 5, column 'Behaviour': 'None' is unknown"),
        (changed(1, "1,7", "one,7"), HEADER, r"row 3, column 'Time': 'one' is not a number"),
        (changed(1, "1,7", "inf,7"), HEADER, r"row 3, column 'Time': 'inf' is not a number"),
        (changed(1, "1,7", "1,"), HEADER, r"row 3, column 'ID': '' is empty"),
        (changed(3, "3,7", "1,7"), HEADER, r"row 5, column 'Time': '1' repeats a time of its track"),
        (changed(0, "Foraging,Adult", "Pond,Adult"), HEADER, r"row 2, column 'Zone': 'Pond' is unknown"),
        (changed(4, "Pup", "Dog"), HEADER, r"row 6, column 'Meerkat type': 'Dog' is unknown; choose from Adult, Pup"),
        (changed(0, "{1;2}", "{1;2"), HEADER, r"row 2, column 'Distant_neighbours': '{1;2' is not {a;b;…}"),
        (changed(0, "[1.5;2;3]", "[1.5;2]"), HEADER, r"row 2, column 'Coordinates': '\[1.5;2\]' is not \[x;y;z\]"),
        (changed(2, "{},{},", "{},{},9,"), HEADER, r"row 4: 9 fields where the header has 8"),
        ([], HEADER, r"row 2: no rows below the header"),
        ([*ROWS, "4,7,Foraging"], HEADER, r"row 7, column 'Zone': '' is empty"),
        ([*ROWS, '4,7,"Foraging'], HEADER, r"row 7: a quote is opened and never closed"),
    ],
)
def test_a_malformed_table_is_refused_with_file_row_and_column(tmp_path, rows, header, words):
    with pytest.raises(ValueError, match=words) as caught:
        read_folder(write(tmp_path, rows, header), MEERKAT)
    assert "\n" not in str(caught.value)
    assert "22-01-01_C2_01.csv" in str(caught.value)


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (b"", r"row 1: the file is empty"),
        (
            (HEADER + "\n" + ROWS[0] + "\n1,7,For").encode() + b"\xe4ging",
            r"row 3, column 3: not UTF-8.*0xe4",
        ),
        (HEADER.encode("utf-16"), r"row 1, column 1: not UTF-8 text \(byte 0xff\)"),
    ],
)
def test_an_empty_file_and_a_wrong_encoding_are_refused(tmp_path, content, words):
    (tmp_path / "a.csv").write_bytes(content)
    with pytest.raises(ValueError, match=words):
        read_folder(tmp_path, MEERKAT)


def test_a_broken_parquet_file_is_refused(tmp_path):
    (tmp_path / "a.parquet").write_bytes(b"PAR1 no more")
    with pytest.raises(ValueError, match=r"a\.parquet: no readable Parquet file"):
        read_folder(tmp_path, MEERKAT)


def test_a_folder_without_tables_and_a_recording_in_two_files_are_refused(tmp_path):
    with pytest.raises(ValueError, match="no table of tracks in or below it"):
        read_folder(tmp_path, MEERKAT)
    (tmp_path / "again").mkdir()
    write(tmp_path, ROWS)
    write(tmp_path / "again", ROWS)
    with pytest.raises(ValueError, match="recording '22-01-01_C2_01' is also in"):
        read_folder(tmp_path, MEERKAT)


def test_bout_names_the_whole_move_and_step_only_its_last_row(tmp_path):
    tracks = read_folder(write(tmp_path, ROWS), MEERKAT).tracks
    bout, step = code_rows(tracks, MEERKAT, "bout"), code_rows(tracks, MEERKAT, "step")
    to_door = bout.names.index("moving to Door")
    assert len(bout.names) == 25
    assert bout.code.tolist() == [0, to_door, to_door, 4]
    assert step.code.tolist() == [0, 2, to_door, 4]


def test_moving_that_returns_stays_plain(tmp_path):
    rows = changed(3, "Dig burrow,Door", "Dig burrow,Foraging")
    assert code_rows(read_folder(write(tmp_path, rows), MEERKAT).tracks, MEERKAT).code.tolist() == [0, 2, 2, 4]


def test_pups_come_only_when_asked_for_with_a_code_of_their_own(tmp_path):
    coded = code_rows(read_folder(write(tmp_path, ROWS), MEERKAT).tracks, MEERKAT, other_groups=True)
    assert coded.code.tolist()[-1] == 25
    assert coded.names[25] == "Pup: not annotated"


def test_a_gap_ends_a_segment_and_a_bout(tmp_path):
    rows = changed(3, "3,7", "4,7")
    coded = code_rows(read_folder(write(tmp_path, rows), MEERKAT).tracks, MEERKAT)
    assert coded.segment.tolist() == [0, 0, 0, 1]
    assert coded.code.tolist() == [0, 2, 2, 4]


def test_windows_share_one_row_and_the_report_adds_up(tmp_path):
    rows = [f"{t},7,Foraging,Door,Adult,{{}},{{}},[1;{t};3]" for t in range(12)] + ["20,7,Groom,Door,Adult,{},{},[0;0;0]"]
    tracks = read_folder(write(tmp_path, [*rows, ROWS[4]]), MEERKAT).tracks
    windows = cut_windows(code_rows(tracks, MEERKAT), tracks, horizon=5)
    report = windows.report
    assert windows.code.shape == (2, 6)
    assert (report.rows, report.rows_of_other_groups, report.rows_in_short_segments) == (14, 1, 1)
    assert (report.rows_used, report.rows_after_last_window, report.rows_without_coordinates) == (11, 1, 1)
    assert report.windows == 2
    with pytest.raises(ValueError, match="the longest has 12"):
        cut_windows(code_rows(tracks, MEERKAT), tracks, horizon=12)


def test_a_transition_runs_from_onset_to_onset(tmp_path):
    found = transitions(code_rows(read_folder(write(tmp_path, ROWS), MEERKAT).tracks, MEERKAT))
    assert found.source.tolist() == [0, 17]
    assert found.target.tolist() == [17, 4]
    np.testing.assert_allclose(found.start, [[1.5, 2, 3], [2, 2, 3]])
    np.testing.assert_allclose(found.end, [[2, 2, 3], [4, 2, -30]])


OTHER_ANIMAL = """
columns: {time: t_s, individual: goat, behaviour: act, place: patch, coordinates: [east, north]}
recording: day
step: 5
moving: walk
coordinate_unit: m
"""


@pytest.mark.parametrize("suffix", [".csv", ".parquet"])
def test_another_animal_in_another_format_needs_only_a_mapping(tmp_path, suffix):
    (tmp_path / "goats.yaml").write_text(OTHER_ANIMAL)
    frame = pd.DataFrame(
        {
            "day": ["mon"] * 4 + ["tue"] * 2,
            "goat": ["bo"] * 6,
            "t_s": [0.0, 5.0, 10.0, 15.0, 0.0, 5.0],
            "act": ["graze", "walk", "walk", "rest", "graze", "graze"],
            "patch": ["hill", "hill", "hill", "barn", "hill", "hill"],
            "east": [0.0, 1.0, 2.0, 3.0, 0.5, 0.5],
            "north": [0.0, 0.0, 0.0, 4.0, 0.5, 0.5],
        }
    )
    file = tmp_path / f"herd{suffix}"
    frame.to_csv(file, index=False) if suffix == ".csv" else frame.to_parquet(file)
    mapping = load_mapping(str(tmp_path / "goats.yaml"))
    coded = code_rows(read_folder(tmp_path, mapping).tracks, mapping)
    assert coded.names == ("graze", "walk", "rest", "moving to barn", "moving to hill")
    assert coded.code.tolist() == [0, 3, 3, 2, 0, 0]
    assert coded.segment.tolist() == [0, 0, 0, 0, 1, 1]
    assert coded.tracks.position[3].tolist() == [3.0, 4.0, 0.0]


def test_without_places_no_code_moves_anywhere(tmp_path):
    mapping = replace(MEERKAT, columns={"time": "Time", "individual": "ID", "behaviour": "Behaviour"}, places=())
    mapping = replace(mapping, moving="", groups=(), other_groups=(), behaviours=())
    coded = code_rows(read_folder(write(tmp_path, ROWS), mapping).tracks, mapping)
    assert coded.names == ("Moving", "Dig burrow", "Foraging", "None")


@needs_data
def test_the_published_tables_have_the_published_counts():
    tracks = read_folder(REAL, MEERKAT).tracks
    coded = code_rows(tracks, MEERKAT)
    report = cut_windows(coded, tracks).report
    assert (report.recordings, report.rows, report.rows_of_other_groups) == (18, 70_565, 8_223)
    assert (report.rows_without_coordinates, report.longest_segment) == (649, 707)
    assert (report.tracks, report.segments, report.windows) == (962, 2_639, 1_289)
    assert report.rows == sum(
        [report.rows_of_other_groups, report.rows_in_short_segments, report.rows_after_last_window, report.rows_used]
    )


@needs_data
def test_no_track_of_the_published_tables_crosses_the_cameras():
    coded = code_rows(read_folder(REAL, MEERKAT).tracks, MEERKAT)
    seen = {site: {coded.places[p] for p in np.unique(coded.place[coded.tracks.site.are(site)])} for site in ("C2", "C3")}
    assert seen["C2"] & seen["C3"] == {"Background"}
    assert seen["C2"] == {"Foraging", "Waiting Area", "Door", "Background"}
