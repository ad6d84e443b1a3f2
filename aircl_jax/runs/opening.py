"""Decide where a run in a directory starts, and write nothing: afresh, from a checkpoint that is whole, or not at all."""

import os
from pathlib import Path
from typing import Literal

from aircl_jax.runs import checkpoint
from aircl_jax.runs.directory import REPORT, STATE, RunDirectory, Settings, checkpoint_path, checkpoints, look
from aircl_jax.runs.metrics_log import METRICS, complete_lines, digest
from aircl_jax.runs.readers import CONFIG, SUMMARY, read_config, read_timing
from aircl_jax.runs.seeds import devices
from aircl_jax.settings.env_defaults import unnamed_settings
from aircl_jax.settings.renamed import RENAMED, old_name
from aircl_jax.storage import LOCK, reason
from envs.settings import flatten

LONGEST = 3900  # bytes of an absolute path, of the 4096 of Linux, less those that a checkpoint's files add
_FREE = ("iterations", "demonstrations.source")  # settings that a resumed run may change: its length, and a file's name


def open_run(
    path: Path, settings: Settings, chunk: int, existing: Literal["refuse", "resume", "overwrite"] = "refuse"
) -> RunDirectory:
    """Decide where a run in this directory starts. Raises ValueError where it may not be used."""
    try:
        return _decide(path, settings, chunk, existing)
    except OSError as error:
        raise ValueError(f"run_dir={path} cannot be read: {reason(error)}; choose another directory") from error


def _decide(path: Path, settings: Settings, chunk: int, existing: str) -> RunDirectory:
    if len(os.fsencode(path.absolute())) > LONGEST:
        raise ValueError(f"run_dir={str(path)[:40]}… has {len(str(path))} letters; choose a shorter name")
    if path.exists() and not path.is_dir():
        raise ValueError(f"run_dir={path} is a file; choose a directory")
    _check_writable(path)
    seen = look(path)
    names = sorted(entry.name for entry in path.iterdir()) if path.exists() else []
    if CONFIG not in names:
        foreign = [name for name in names if name not in (LOCK, f".{CONFIG}.new")]
        if foreign:
            raise ValueError(f"run_dir={path} holds files ({foreign[0]}, …) and no {CONFIG}; choose another directory")
        return RunDirectory(path, settings, chunk, seen=seen)
    if existing == "overwrite":
        return RunDirectory(path, settings, chunk, seen=seen)
    if existing == "refuse":
        raise ValueError(f"run_dir={path} already holds a run; choose resume=true, overwrite=true or another directory")
    return _resumed(path, settings, chunk)


def open_saved(path: Path) -> RunDirectory:
    """Open a run for reading at its newest whole checkpoint, whether it is finished or still training.

    Raises ValueError where there is no run, or none with a checkpoint.
    """
    try:
        if not (path / CONFIG).is_file():
            raise ValueError(f"run_dir={path} holds no run; choose a directory with a {CONFIG}")
        settings = read_config(path)
        every = sorted(checkpoints(path), reverse=True)
        if not every:
            raise ValueError(f"run_dir={path} has no checkpoint yet; choose a run that has")
        start, remarks = _newest_whole(path, every)
    except OSError as error:
        raise ValueError(f"run_dir={path} cannot be read: {reason(error)}; choose another directory") from error
    return RunDirectory(path, settings, start=start, finished=start == every[0] and (path / SUMMARY).is_file(), remarks=remarks)


def existing(resume: bool, overwrite: bool) -> Literal["refuse", "resume", "overwrite"]:
    """Return how to treat an existing run. Raises ValueError where both are requested."""
    if resume and overwrite:
        raise ValueError("resume=true and overwrite=true exclude each other; choose one")
    return "resume" if resume else "overwrite" if overwrite else "refuse"


def _resumed(path: Path, settings: Settings, chunk: int) -> RunDirectory:
    seen = look(path)
    _refuse_other_settings(path, settings)
    every, iterations = checkpoints(path), settings["iterations"]
    done = max(every, default=0)
    if not every and (path / SUMMARY).is_file():
        raise ValueError(f"run_dir={path} has lost its checkpoints ({path / STATE}); restore them, or use overwrite=true")
    if done > iterations:
        raise ValueError(f"run_dir={path} is at iteration {done} already; iterations={iterations} would shorten it")
    usable = [iteration for iteration in every if iteration % chunk == 0 or iteration == iterations]
    start, remarks = _newest_whole(path, sorted(usable, reverse=True))
    whole = all((path / name).is_file() for name in (SUMMARY, REPORT))
    finished = start == iterations and whole and len(complete_lines(path / METRICS)) == start
    if start:
        read_timing(path)  # refuses what cannot be read, before anything is cut
    if start and not finished:
        remarks += _other_devices(path, start)
    return RunDirectory(path, settings, chunk, start, finished, remarks, seen)


def _newest_whole(path: Path, newest_first: list[int]) -> tuple[int, tuple[str, ...]]:
    """Return the newest iteration whose checkpoint and rows are whole, 0 without any, and a line where newer ones are not.

    Raises ValueError where there are some and none is whole.
    """
    faults = []
    for iteration in newest_first:
        fault = _fault(path, iteration)
        if not fault:
            return iteration, tuple(f"{each}; going on from iteration {iteration}" for each in faults)
        faults.append(fault)
    if faults:
        raise ValueError(f"{faults[0]}; use overwrite=true to start again")
    return 0, ()


def _fault(path: Path, iteration: int) -> str:
    """Say what is wrong with a checkpoint or with the rows up to it; empty where nothing is."""
    saved = checkpoint_path(path, iteration)
    if not checkpoint.is_whole(saved):
        return f"the checkpoint {saved} is damaged or cut short"
    rows, noted = digest(path / METRICS, iteration), checkpoint.notes_of(saved).get("metrics")
    if not rows:
        return f"{path / METRICS} is cut short of the checkpoint at {iteration}"
    return "" if noted in (None, rows) else f"{path / METRICS} is not what was written up to iteration {iteration}"


def _other_devices(path: Path, start: int) -> tuple[str, ...]:
    before, now = checkpoint.notes_of(checkpoint_path(path, start)).get("devices"), devices()
    if before in (None, now):
        return ()
    return (f"run_dir={path} was computed on {before} and goes on on {now}: its numbers may differ in their last digits",)


def _refuse_other_settings(path: Path, settings: Settings) -> None:
    there = flatten(read_config(path))
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
