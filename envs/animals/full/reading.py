"""Read the steps of whole segments from a folder of tables or from simulated meerkats, with an account of what was read."""

from functools import lru_cache
from pathlib import Path

from envs.animals import simulated_meerkats
from envs.animals.account import account_of_steps
from envs.animals.data_folder import data_folder
from envs.animals.full.steps import LACKS, Recordings, recordings_of
from envs.animals.herd import digest, reading_of
from envs.animals.neighbours import read_neighbours
from envs.animals.windows import Coding, code_rows


def read_recordings(data: str = "default", mapping: str = "meerkat", coding: Coding = "bout", horizon: int = 30) -> Recordings:
    """Read and code the tables, or simulate them. Raises ValueError as `envs.animals.tracks` does."""
    return read_with_account(data, mapping, coding, horizon)[0]


def read_with_account(data: str, mapping: str, coding: Coding, horizon: int = 30) -> tuple[Recordings, tuple[str, ...]]:
    """Read and code the tables, and say what was read, what was left out and why; of simulated animals nothing is said."""
    folder = data_folder(data, "meerkat")
    return _read(folder, mapping, coding, horizon, "" if folder is None else digest(folder, mapping))


@lru_cache(maxsize=4)
def _read(folder: Path | None, mapping: str, coding: Coding, horizon: int, read: str) -> tuple[Recordings, tuple[str, ...]]:
    reading, columns = reading_of(folder, mapping, read)
    coded = code_rows(reading.tracks, columns, coding)
    if folder is None:
        return recordings_of(coded, simulated_meerkats.MAPPING, coding, horizon=horizon, simulated=True), ()
    behaviours = coded.names[: len(coded.names) - (len(coded.places) if columns.moving else 0)]
    found = read_neighbours(folder, columns, reading.tracks, coded.tracks, behaviours)
    doing = (found.close, found.distant) if found else None
    recordings = recordings_of(coded, columns, coding, doing=doing, horizon=horizon)
    lines = account_of_steps(folder, reading, coded, columns, len(recordings.steps.code))
    return recordings, (*lines, *(LACKS[name] for name in recordings.lacks))
