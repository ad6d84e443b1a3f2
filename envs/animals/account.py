"""Give account of what was read from tables of tracks, of what was left out and why, in sentences."""

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from envs.animals.columns import ColumnMapping
from envs.animals.tracks import Reading, new_track
from envs.animals.windows import Coded, Windows

LEAST_SEEN = 5  # an activity or a change with fewer cases is not ranked
MOST_LEFT_OUT = 0.5  # share of the rows beyond which their loss is a warning
NAMED = 3  # files that a sentence names


class Account(NamedTuple):
    """What was read and left out, and what to know before anything learns from it; empty for simulated animals."""

    lines: tuple[str, ...] = ()
    warnings: tuple[str, ...] = ()


def account(folder: Path, reading: Reading, coded: Coded, windows: Windows, mapping: ColumnMapping) -> Account:
    return Account(
        (*_read(folder, reading, mapping), *_cut(windows, mapping), *_not_read(folder, reading)),
        tuple(_warnings(coded, windows)),
    )


def account_of_steps(folder: Path, reading: Reading, coded: Coded, mapping: ColumnMapping, steps: int) -> tuple[str, ...]:
    """Give account of tables whose gap-free segments are used whole, of which `steps` rows have a next one."""
    return (*_read(folder, reading, mapping), *_whole(reading, coded, mapping, steps), *_not_read(folder, reading))


def _read(folder: Path, reading: Reading, mapping: ColumnMapping) -> Iterator[str]:
    tracks, found = reading.tracks, reading.found
    animals, recordings = (len(column.counts()) for column in (tracks.individual, tracks.recording))
    if found.tables:
        yield f"read: {_counted(len(found.tables), 'table')} ({_named(found.tables, folder)})"
    if reading.bouts:
        yield f"bouts: {reading.bouts:,}, of which a row is made every {mapping.step:g}"
    if reading.bouts_without_sample:
        yield f"left out: {_counted(reading.bouts_without_sample, 'bout')} between two samples: events, or shorter than a step"
    yield f"rows: {len(tracks.time):,} of {_counted(animals, 'animal')} by name, in {_counted(recordings, 'recording')}"
    if reading.row_names:
        yield f"left out: the first column of {_named(reading.row_names, folder)}, which are row names without a name"


def _cut(windows: Windows, mapping: ColumnMapping) -> Iterator[str]:
    report, length = windows.report, windows.code.shape[1]
    yield (
        f"segments: {report.segments:,} without a gap, of {_counted(report.tracks, 'track')} (an animal in a recording); "
        f"the longest has {_counted(report.longest_segment, 'row')} of step {mapping.step:g}"
    )
    yield f"used: {_counted(report.rows_used, 'row')} in {_counted(report.windows, 'window')} of {length - 1} steps"
    left_out = {
        f"of other groups ({', '.join(mapping.other_groups)})": report.rows_of_other_groups,
        f"in segments of fewer than {length} rows": report.rows_in_short_segments,
        "after the last window of a segment": report.rows_after_last_window,
    }
    yield from (f"left out: {_counted(number, 'row')} {why}" for why, number in left_out.items() if number)
    if report.rows_without_coordinates and "coordinates" in mapping.columns:
        yield f"masked: the coordinates of {_counted(report.rows_without_coordinates, 'row')}, which are missing"


def _whole(reading: Reading, coded: Coded, mapping: ColumnMapping, steps: int) -> Iterator[str]:
    size = np.bincount(coded.segment)
    tracks = 1 + int(new_track(coded.tracks).sum())
    yield (
        f"segments: {len(size):,} without a gap, of {_counted(tracks, 'track')} (an animal in a recording); "
        f"the longest has {_counted(int(size.max()), 'row')} of step {mapping.step:g}"
    )
    yield f"used: {_counted(steps, 'row')} that the next row follows, whatever the length of the segment"
    left_out = {
        f"of other groups ({', '.join(mapping.other_groups)}), but as neighbours": len(reading.tracks.time) - len(coded.code),
        "in segments of one row": int((size == 1).sum()),
        "that end a longer segment: they are what comes next alone": int((size > 1).sum()),
    }
    yield from (f"left out: {_counted(number, 'row')} {why}" for why, number in left_out.items() if number)


def _not_read(folder: Path, reading: Reading) -> Iterator[str]:
    found = reading.found
    if found.hidden:
        yield f"not read: {_counted(len(found.hidden), 'hidden table')} ({_named(found.hidden, folder)})"
    if found.others:
        yield f"not read: {_counted(len(found.others), 'file')} of other kinds ({_named(found.others, folder)})"


def _warnings(coded: Coded, windows: Windows) -> Iterator[str]:
    report = windows.report
    left_out = 1.0 - report.rows_used / report.rows
    if left_out > MOST_LEFT_OUT:
        yield f"{left_out:.0%} of the rows are left out; a shorter env.horizon keeps more of the short segments"
    now, after = windows.code[:, :-1], windows.code[:, 1:]
    begun = np.bincount(after[now != after], minlength=len(coded.names))
    if begun.max() < LEAST_SEEN:
        often = f" (most often {coded.names[begun.argmax()]!r}, {begun.max()} times)" if begun.any() else ""
        yield f"no activity begins {LEAST_SEEN} times in the windows{often}, so that none is ranked"


def _counted(number: int, what: str) -> str:
    return f"{number:,} {what}" + ("" if number == 1 else "s")


def _named(files: Sequence[Path], folder: Path) -> str:
    names = ", ".join(str(file.relative_to(folder)) for file in files[:NAMED])
    return names + (", …" if len(files) > NAMED else "")
