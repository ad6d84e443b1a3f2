"""Note how each job of a sweep ends, whatever process a launcher gives it, and name those that failed."""

import json
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import NamedTuple

from aircl_jax.storage import write_whole


class Job(NamedTuple):
    """A job of a sweep: its number, its NAME=VALUE words, and its exit code, None of one that never came to its end."""

    number: int
    words: tuple[str, ...]
    code: int | None


def note(folder: Path, job: Job) -> None:
    """Write the note of a job, in place of an earlier one."""
    folder.mkdir(parents=True, exist_ok=True)
    write_whole(folder / f"job_{job.number}.json", json.dumps({"words": job.words, "code": job.code}) + "\n")


def notes(folder: Path) -> Iterator[Job]:
    """Read the notes of all jobs."""
    for path in folder.glob("job_*.json"):
        found = json.loads(path.read_bytes())
        yield Job(int(path.stem.removeprefix("job_")), tuple(found["words"]), found["code"])


def forget(folder: Path) -> None:
    """Remove the notes of an earlier sweep."""
    for path in folder.glob("job_*.json"):
        path.unlink()


def failures(jobs: Sequence[Job]) -> list[str]:
    """Name the jobs that did not end with 0, a line each."""
    return [_line(job) for job in sorted(jobs) if job.code != 0]


def _line(job: Job) -> str:
    how = "did not come to its end" if job.code is None else f"ended with exit code {job.code}"
    return f"job {job.number} ({' '.join(job.words)}) {how}"
