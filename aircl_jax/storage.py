"""Files that are written whole or not at all and reach the disk; one lock; errors of the disk in one line."""

import errno
import importlib.util
import os
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager, nullcontext, suppress
from pathlib import Path
from typing import Any

LOCK = ".lock"  # file within a folder, on systems that cannot lock the folder itself

# Errors of the disk itself, not of the name that was chosen.
DISK_ERRORS = tuple(getattr(errno, name) for name in ("ENOSPC", "EDQUOT", "EIO", "EROFS", "EFBIG") if hasattr(errno, name))

# What `flock` says where another process holds the folder. Any other error means that the file system knows no locks.
_HELD = (errno.EWOULDBLOCK, errno.EACCES, errno.EDEADLK)


class DiskError(OSError):
    """What the disk refused, in one line that says how to go on."""


@contextmanager
def disk(path: Path, then: str) -> Iterator[None]:
    """Raise DiskError in place of any OSError of the block, naming the path, the reason and what to do `then`."""
    try:
        yield
    except DiskError:
        raise
    except OSError as error:
        raise DiskError(f"{path} cannot be written: {reason(error)}; {then}") from error


def reason(error: OSError) -> str:
    """Return what the system says of an error, or its own words where the system says nothing."""
    return error.strerror or " ".join(str(error).split()) or type(error).__name__


@contextmanager
def replacing(path: Path) -> Iterator[Path]:
    """Yield a path beside `path` to write to; it takes the place of `path` at the end, and is removed after an error.

    After a kill or a power cut at any moment `path` is the old file or the new one, never a part of either.
    """
    beside = path.with_name(f".{path.name}.new")
    try:
        yield beside
        sync(beside)
        beside.replace(path)
        sync(path.parent)
    finally:
        with suppress(OSError):
            beside.unlink(missing_ok=True)


def write_whole(path: Path, text: str) -> None:
    """Write a text, in UTF-8, in place of what the file holds."""
    with replacing(path) as beside:
        beside.write_bytes(text.encode())  # as bytes: a newline is one byte on every system


def append(path: Path, text: str) -> None:
    """Append a text, in UTF-8, to a file and wait until the disk has it."""
    with path.open("ab") as file:
        file.write(text.encode())
        file.flush()
        os.fsync(file.fileno())


def sync(path: Path) -> None:
    """Wait until the disk has a file, or a folder's list of names where the system can wait for that."""
    folder = path.is_dir()
    try:
        handle = os.open(path, os.O_RDONLY if folder else os.O_RDWR)
    except OSError:
        if folder:  # Windows opens no folders
            return
        raise
    try:
        with suppress(OSError) if folder else nullcontext():
            os.fsync(handle)
    finally:
        os.close(handle)


def sync_tree(folder: Path) -> None:
    """Wait until the disk has every file below a folder; asked for all at once, it takes a tenth of the time."""
    with ThreadPoolExecutor(8) as pool:
        list(pool.map(sync, [*folder.rglob("*"), folder]))


@contextmanager
def locked(folder: Path) -> Iterator[bool]:
    """Lock a folder until the block ends; yield False where another process holds it.

    A file system or a system without locks yields True.
    """
    handle = _lock_handle(folder)
    try:
        yield handle is None or _take(handle)
    finally:
        if handle is not None:
            os.close(handle)


def _lock_handle(folder: Path) -> int | None:
    """Open what is locked: the folder itself, on Windows a file within it; None where a system has neither lock."""
    if importlib.util.find_spec("fcntl"):
        return os.open(folder, os.O_RDONLY)
    return os.open(folder / LOCK, os.O_RDWR | os.O_CREAT) if importlib.util.find_spec("msvcrt") else None


def _take(handle: int) -> bool:
    """Lock an open file or folder, on any system; return False where another process holds it."""
    try:
        if importlib.util.find_spec("fcntl"):
            fcntl: Any = importlib.import_module("fcntl")
            fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
        else:
            msvcrt: Any = importlib.import_module("msvcrt")
            msvcrt.locking(handle, msvcrt.LK_NBLCK, 1)
    except OSError as error:
        return error.errno not in _HELD
    return True
