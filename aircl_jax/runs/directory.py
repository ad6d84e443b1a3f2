"""Write and read a run directory: settings, metrics, timing, checkpoints and summary, whole after a kill at any moment.

Each chunk appends to metrics.jsonl and timing.jsonl, then renames the checkpoint into place. Resuming cuts off lines beyond
the checkpoint that it starts from, so that a resumed metrics.jsonl has the bytes of the uninterrupted one.
"""

import hashlib
import json
import shutil
from collections.abc import Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from aircl_jax.messages import warn
from aircl_jax.runs.metrics_log import METRICS, cut, read_metrics, to_json
from aircl_jax.runs.readers import CONFIG, SUMMARY, TIMING, read_summary, read_timing
from aircl_jax.runs.recorder import Row
from aircl_jax.storage import DISK_ERRORS, DiskError, append, disk, locked, reason, replacing, write_whole

STATE, REPORT, FIGURES, TRACE = "state", "report.md", "figures", "trace.txt"
CARD, CARD_WORDS, MAPS, PAGE, PLANS = "card.json", "card.md", "recovered.npz", "report.html", "plans.json"
_DONE = (SUMMARY, REPORT, PAGE, CARD, CARD_WORDS, MAPS, PLANS, TRACE)  # what a finished run has beside its history
THEN = "once it can be, the same command with resume=true goes on"

Settings = Mapping[str, Any]  # nested settings of a run, as config.yaml holds them
Look = tuple[tuple[str, int, int], ...]  # names, sizes and times of a directory's entries


@dataclass
class RunDirectory:
    """One run's files, which also record its chunks; see `runs.recorder`.

    `chunk` is the number of iterations between two checkpoints, `start` the iteration to continue from, and `finished`
    whether nothing is left to do. `remarks` are lines on what was mended or differs; `seen` is what the directory held
    when this was decided.
    """

    path: Path
    settings: Settings
    chunk: int = 1
    start: int = 0
    finished: bool = False
    remarks: tuple[str, ...] = ()
    seen: Look = ()
    _digest: Any = field(default_factory=hashlib.sha256, init=False, repr=False)  # of metrics.jsonl as it was written
    _rows: int = field(default=0, init=False, repr=False)  # lines of it that belong to the run

    def __post_init__(self) -> None:
        self._rows = self.start

    @contextmanager
    def held(self) -> Iterator[None]:
        """Lock the directory and prepare it: clear an old run, or cut a resumed one off at its checkpoint.

        Raises ValueError where another run holds it or has used it since it was looked at, DiskError where the disk is full.
        """
        with ExitStack() as until_done:
            try:
                self.path.mkdir(parents=True, exist_ok=True)
                ours = until_done.enter_context(locked(self.path))
            except OSError as error:
                if error.errno in DISK_ERRORS:
                    raise DiskError(f"run_dir={self.path} cannot be written: {reason(error)}; {THEN}") from error
                raise ValueError(f"run_dir={self.path} cannot be written: {reason(error)}; choose another") from error
            if not ours:
                raise ValueError(f"run_dir={self.path} is in use by another run; wait for it or choose another directory")
            if look(self.path) != self.seen:
                raise ValueError(f"run_dir={self.path} was used by another run just now; give the command again")
            with disk(self.path, THEN):
                self._prepare()
            for remark in self.remarks:
                warn(remark)
            yield

    def _prepare(self) -> None:
        kept = [] if self.start == 0 else [METRICS, TIMING, STATE, FIGURES]
        for name in (STATE, METRICS, TIMING, FIGURES, *_DONE):
            if name not in kept:
                _remove(self.path / name)
        write_whole(self.path / CONFIG, yaml.safe_dump(dict(self.settings), sort_keys=False, allow_unicode=True))
        for entry in (self.path / STATE).glob(".*"):  # what a kill has left
            shutil.rmtree(entry, ignore_errors=True)
        for iteration, checkpoint in checkpoints(self.path).items():
            if iteration > self.start:
                _remove(checkpoint)
        self._digest = hashlib.sha256(cut(self.path / METRICS, self.start))
        cut(self.path / TIMING, sum(line["iteration"] <= self.start for line in self.timing()))

    def on_chunk(self, iteration: int, states: Any, rows: Sequence[Row], timing: Mapping[str, Any]) -> None:
        """Write the chunk in the order on which a resumed run relies. Raises DiskError where the disk refuses."""
        self.append_metrics(rows)
        self.append_timing(timing)
        self.save(states, iteration)

    def append_metrics(self, rows: Sequence[Row]) -> None:
        """Append one line per iteration, every metric a list over seeds."""
        lines = "".join(to_json({name: row[name] for name in sorted(row)}) + "\n" for row in rows)
        with disk(self.path / METRICS, THEN):
            append(self.path / METRICS, lines)
        self._digest.update(lines.encode())
        self._rows += len(rows)

    def append_timing(self, timing: Mapping[str, Any]) -> None:
        """Append one line per chunk."""
        with disk(self.path / TIMING, THEN):
            append(self.path / TIMING, json.dumps(timing) + "\n")

    def save(self, state: Any, iteration: int) -> None:
        """Save the checkpoint of an iteration, and remove all but two that a longer run could start from.

        Its notes are the digest of the metrics up to it and the devices. Those that go were read back when they were saved.
        """
        from aircl_jax.runs import checkpoint
        from aircl_jax.runs.seeds import devices

        with disk(self.path / STATE, THEN):
            (self.path / STATE).mkdir(exist_ok=True)
            notes = {"metrics": self._digest.hexdigest(), "devices": devices()}
            checkpoint.save(checkpoint_path(self.path, iteration), state, notes)
            last = iteration - iteration % self.chunk
            for older, path in checkpoints(self.path).items():
                if older < last - self.chunk:
                    _remove(path)

    def load(self, like: Any) -> Any:
        """Load the state at `start`, shaped and placed as `like`. Raises ValueError where it is damaged."""
        from aircl_jax.runs import checkpoint

        return checkpoint.load(checkpoint_path(self.path, self.start), like)

    def history(self) -> dict[str, np.ndarray]:
        """Read the metrics: {metric: [iterations, S]}."""
        return read_metrics(self.path, self._rows)

    def timing(self) -> list[dict[str, Any]]:
        return read_timing(self.path)

    def summary(self) -> dict[str, Any] | None:
        """Read the summary; None where there is none that can be read."""
        return read_summary(self.path)

    def write_summary(self, summary: Mapping[str, Any]) -> None:
        self._write(SUMMARY, json.dumps(summary, indent=2, allow_nan=False) + "\n")

    def write_report(self, report: str) -> None:
        """Write the report, with which a run is finished."""
        self._write(REPORT, report)

    def write_page(self, page: str) -> None:
        """Write the report as HTML."""
        self._write(PAGE, page)

    def write_maps(self, maps: Mapping[str, np.ndarray]) -> None:
        """Write recovered.npz; no file where there is no map."""
        if maps:
            with disk(self.path / MAPS, THEN), replacing(self.path / MAPS) as beside, beside.open("wb") as file:
                np.savez_compressed(file, allow_pickle=False, **maps)

    def write_card(self, as_json: str, in_words: str) -> None:
        self._write(CARD, as_json)
        self._write(CARD_WORDS, in_words)

    def write_plans(self, plans: Mapping[str, Any]) -> None:
        """Write what was planned on what was learned, for the page."""
        self._write(PLANS, json.dumps(plans, allow_nan=False) + "\n")

    def _write(self, name: str, text: str) -> None:
        with disk(self.path / name, THEN):
            write_whole(self.path / name, text)


def look(path: Path) -> Look:
    """Note what a directory and its checkpoints are, to see later whether they have changed."""
    entries = [entry for folder in (path, path / STATE) if folder.is_dir() for entry in folder.iterdir()]
    noted = [(entry.name, entry.lstat()) for entry in sorted(entries)]
    return tuple((name, found.st_size, found.st_mtime_ns) for name, found in noted)


def checkpoint_path(path: Path, iteration: int) -> Path:
    return path / STATE / f"{iteration:08d}"


def checkpoints(path: Path) -> dict[int, Path]:
    """List the checkpoints by iteration."""
    state = path / STATE
    names = sorted(entry.name for entry in state.iterdir()) if state.is_dir() else []
    return {int(name): state / name for name in names if name.isascii() and name.isdigit() and int(name) > 0}


def _remove(entry: Path) -> None:
    """Remove a file, a folder at once or not at all, or a link but not what it leads to."""
    doomed = entry.with_name(f".{entry.name}.removed")
    if doomed.is_dir():  # by a kill
        shutil.rmtree(doomed)
    if entry.is_dir() and not entry.is_symlink():
        shutil.rmtree(entry.rename(doomed))
    else:
        entry.unlink(missing_ok=True)
