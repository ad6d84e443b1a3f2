"""Write and read a run directory: settings, metrics, timing, checkpoints and summary, whole after a kill at any moment.

Each chunk writes metrics.jsonl, then renames the checkpoint into place, then writes timing.jsonl. Resuming cuts off lines
beyond the newest checkpoint, so that a resumed metrics.jsonl has the bytes of the uninterrupted one.
"""

import fcntl
import json
import os
import shutil
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import numpy as np
import yaml

from aircl_jax.runs.metrics_log import METRICS, complete_lines, cut, read_metrics, to_json
from aircl_jax.runs.recorder import Row
from aircl_jax.settings.env_defaults import unnamed_settings
from aircl_jax.settings.renamed import RENAMED, old_name
from aircl_jax.storage import replacing, write_whole
from envs.settings import flatten

CONFIG, TIMING, STATE = "config.yaml", "timing.jsonl", "state"
SUMMARY, REPORT, FIGURES = "summary.json", "report.md", "figures"
CARD, CARD_WORDS, MAPS = "card.json", "card.md", "recovered.npz"
_OWN = (CONFIG, METRICS, TIMING, STATE, SUMMARY, REPORT, FIGURES, CARD, CARD_WORDS, MAPS)
_FREE = ("iterations", "demonstrations.source")  # settings that a resumed run may change: its length, and a file's name

Settings = Mapping[str, Any]  # nested settings of a run, as config.yaml holds them


@dataclass
class RunDirectory:
    """One run's files, which also record its chunks; see `runs.recorder`.

    `chunk` is the number of iterations between two checkpoints, `start` the iteration to continue from, and `finished`
    whether no iteration is left.
    """

    path: Path
    settings: Settings
    chunk: int = 1
    start: int = 0
    finished: bool = False

    @contextmanager
    def held(self) -> Iterator[None]:
        """Lock the directory and prepare it: clear an old run, or cut a resumed one off at its checkpoint."""
        try:
            self.path.mkdir(parents=True, exist_ok=True)
            lock = _lock(self.path)
            self._prepare()
        except OSError as error:
            raise ValueError(f"run_dir={self.path} cannot be written: {error.strerror}; choose another") from error
        try:
            yield
        finally:
            os.close(lock)

    def _prepare(self) -> None:
        if self.start == 0:
            _clear(self.path)
        write_whole(self.path / CONFIG, yaml.safe_dump(dict(self.settings), sort_keys=False, allow_unicode=True))
        for name in (SUMMARY, REPORT, CARD, CARD_WORDS, MAPS):
            (self.path / name).unlink(missing_ok=True)
        for iteration, checkpoint in _checkpoints(self.path).items():
            if iteration > self.start:
                _discard(checkpoint)
        cut(self.path / METRICS, self.start)
        cut(self.path / TIMING, sum(line["iteration"] <= self.start for line in self.timing()))

    def on_chunk(self, iteration: int, states: Any, rows: Sequence[Row], timing: Mapping[str, Any]) -> None:
        """Write the chunk in the order on which a resumed run relies."""
        self.append_metrics(rows)
        self.save(states, iteration)
        self.append_timing(timing)

    def append_metrics(self, rows: Sequence[Row]) -> None:
        """Append one line per iteration, every metric a list over seeds."""
        lines = [to_json({name: row[name] for name in sorted(row)}) + "\n" for row in rows]
        with (self.path / METRICS).open("a") as file:
            file.write("".join(lines))

    def append_timing(self, timing: Mapping[str, Any]) -> None:
        """Append one line per chunk."""
        with (self.path / TIMING).open("a") as file:
            file.write(json.dumps(timing) + "\n")

    def save(self, state: Any, iteration: int) -> None:
        """Save the checkpoint of an iteration and remove older ones.

        The last checkpoint at a multiple of the chunk stays, because a longer run starts there.
        """
        from aircl_jax.runs import checkpoint

        (self.path / STATE).mkdir(exist_ok=True)
        checkpoint.save(_checkpoint(self.path, iteration), state)
        for older, path in _checkpoints(self.path).items():
            if older < iteration - iteration % self.chunk:
                _discard(path)

    def load(self, like: Any) -> Any:
        """Load the state at `start`, shaped and placed as `like`. Raises ValueError where it is damaged."""
        from aircl_jax.runs import checkpoint

        return checkpoint.load(_checkpoint(self.path, self.start), like)

    def history(self) -> dict[str, np.ndarray]:
        """Read the metrics: {metric: [iterations, S]}."""
        return read_metrics(self.path)

    def timing(self) -> list[dict[str, Any]]:
        path = self.path / TIMING
        return [json.loads(line) for line in complete_lines(path)] if path.exists() else []

    def summary(self) -> dict[str, Any]:
        return json.loads((self.path / SUMMARY).read_text())

    def write_summary(self, summary: Mapping[str, Any]) -> None:
        write_whole(self.path / SUMMARY, json.dumps(summary, indent=2, allow_nan=False) + "\n")

    def write_report(self, report: str) -> None:
        write_whole(self.path / REPORT, report)

    def write_maps(self, maps: Mapping[str, np.ndarray]) -> None:
        """Write recovered.npz; no file where there is no map."""
        if maps:
            with replacing(self.path / MAPS) as beside, beside.open("wb") as file:
                np.savez_compressed(file, allow_pickle=False, **maps)

    def write_card(self, as_json: str, in_words: str) -> None:
        write_whole(self.path / CARD, as_json)
        write_whole(self.path / CARD_WORDS, in_words)


def open_run(
    path: Path, settings: Settings, chunk: int, existing: Literal["refuse", "resume", "overwrite"] = "refuse"
) -> RunDirectory:
    """Decide where a run in this directory starts, and write nothing. Raises ValueError where it may not be used."""
    if path.exists() and not path.is_dir():
        raise ValueError(f"run_dir={path} is a file; choose a directory")
    _check_writable(path)
    names = {entry.name for entry in path.iterdir()} if path.exists() else set()
    if CONFIG not in names:
        foreign = sorted(name for name in names if name not in _OWN and not name.startswith(f".{CONFIG}"))
        if foreign:
            raise ValueError(f"run_dir={path} holds other files ({foreign[0]}, …) and no run; choose another directory")
        return RunDirectory(path, settings, chunk)
    if existing == "overwrite":
        return RunDirectory(path, settings, chunk)
    if existing == "refuse":
        raise ValueError(f"run_dir={path} already holds a run; choose resume=true, overwrite=true or another directory")
    return _resumed(path, settings, chunk)


def open_saved(path: Path) -> RunDirectory:
    """Open a run for reading at its newest checkpoint, whether it is finished or still training.

    Raises ValueError where there is no run, or none with a checkpoint.
    """
    if not (path / CONFIG).is_file():
        raise ValueError(f"run_dir={path} holds no run; choose a directory with a {CONFIG}")
    try:
        settings = dict(yaml.safe_load((path / CONFIG).read_text()))
    except (yaml.YAMLError, TypeError, ValueError) as error:
        raise ValueError(f"{path / CONFIG} cannot be read") from error
    newest = max(_checkpoints(path), default=0)
    if newest == 0:
        raise ValueError(f"run_dir={path} has no checkpoint yet; choose a run that has")
    return RunDirectory(path, settings, start=newest, finished=(path / SUMMARY).is_file())


def existing(resume: bool, overwrite: bool) -> Literal["refuse", "resume", "overwrite"]:
    """Return how to treat an existing run. Raises ValueError where both are requested."""
    if resume and overwrite:
        raise ValueError("resume=true and overwrite=true exclude each other; choose one")
    return "resume" if resume else "overwrite" if overwrite else "refuse"


def _resumed(path: Path, settings: Settings, chunk: int) -> RunDirectory:
    _refuse_other_settings(path, settings)
    done, iterations = max(_checkpoints(path), default=0), settings["iterations"]
    if done > iterations:
        raise ValueError(f"run_dir={path} is at iteration {done} already; iterations={iterations} would shorten it")
    if done == iterations and (path / SUMMARY).exists():
        return RunDirectory(path, settings, chunk, done, finished=True)
    whole = [iteration for iteration in _checkpoints(path) if iteration % chunk == 0]
    start = done if done == iterations else max(whole, default=0)
    if start and (not (path / METRICS).exists() or len(complete_lines(path / METRICS)) < start):
        raise ValueError(f"{path / METRICS} is cut short of the checkpoint at {start}; use overwrite=true to start again")
    return RunDirectory(path, settings, chunk, start)


def _refuse_other_settings(path: Path, settings: Settings) -> None:
    try:
        there = flatten(yaml.safe_load((path / CONFIG).read_text()))
    except (yaml.YAMLError, AttributeError, UnicodeDecodeError) as error:
        raise ValueError(f"{path / CONFIG} cannot be read; use overwrite=true to start again") from error
    for name in sorted(there, key=lambda name: RENAMED.get(name) is None):
        if of_before := old_name(name):
            raise ValueError(f"run_dir={path} is of an older version: {of_before}; choose overwrite=true or another directory")
    here = flatten(settings)
    before = unnamed_settings(here.get("env.name", ""))
    there = {name: before[name] for name in here if name in before} | there
    differing = [name for name in there | here if name not in _FREE and there.get(name) != here.get(name)]
    if differing:
        listed = "; ".join(f"{name} is {there.get(name)} there and {here.get(name)} here" for name in differing)
        raise ValueError(
            f"run_dir={path} holds a run with other settings: {listed}; choose overwrite=true or another directory"
        )


def _check_writable(path: Path) -> None:
    nearest = next(parent for parent in (path, *path.absolute().parents) if parent.exists())
    if not nearest.is_dir():
        raise ValueError(f"run_dir={path}: {nearest} is a file; choose a directory")
    if not os.access(nearest, os.W_OK | os.X_OK):
        raise ValueError(f"run_dir={path}: {nearest} is not writable; choose another directory")


def _lock(path: Path) -> int:
    """Lock the directory until the returned handle is closed. Raises ValueError where another process holds it."""
    handle = os.open(path, os.O_RDONLY)
    try:
        fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError as error:
        os.close(handle)
        raise ValueError(f"run_dir={path} is in use by another run; wait for it or choose another directory") from error
    return handle


def _checkpoint(path: Path, iteration: int) -> Path:
    return path / STATE / f"{iteration:08d}"


def _checkpoints(path: Path) -> dict[int, Path]:
    """List the whole checkpoints by iteration."""
    state = path / STATE
    return {int(entry.name): entry for entry in sorted(state.iterdir()) if entry.name.isdigit()} if state.is_dir() else {}


def _discard(checkpoint: Path) -> None:
    """Rename a checkpoint and remove it, so that a kill leaves no part of it under its name."""
    doomed = checkpoint.with_name(".discarded")
    shutil.rmtree(doomed, ignore_errors=True)
    checkpoint.rename(doomed)
    shutil.rmtree(doomed)


def _clear(path: Path) -> None:
    """Remove a run's files, its settings first: without them the rest counts as no run."""
    for name in _OWN:
        entry = path / name
        shutil.rmtree(entry) if entry.is_dir() else entry.unlink(missing_ok=True)
