"""Print to people: what a full or closed stream, or one of few letters, does not take is lost and never ends a run."""

import os
import sys
from contextlib import suppress
from typing import Any


def say(text: str) -> None:
    """Print on standard output."""
    _print(text, sys.stdout)


def warn(line: str) -> None:
    """Print one line on standard error, for what is wrong but ends nothing."""
    tell(f"warning: {line}")


def tell(line: str) -> None:
    """Print one line on standard error."""
    _print(" ".join(line.split()), sys.stderr)


def forgiving_streams() -> None:
    """Let standard output and error write letters that their encoding lacks as escapes, as in Python texts."""
    streams: tuple[Any, ...] = (sys.stdout, sys.stderr)
    for stream in streams:
        if hasattr(stream, "reconfigure"):
            stream.reconfigure(errors="backslashreplace")


def _print(text: str, stream: Any) -> None:
    if stream is None:  # closed before Python started
        return
    try:
        encoding = stream.encoding or "utf-8"
        print(text.encode(encoding, "backslashreplace").decode(encoding), file=stream, flush=True)
    except (OSError, ValueError):  # full, a pipe that nobody reads, or closed since
        _abandon(stream)


def _abandon(stream: Any) -> None:
    """Send what a process's own stream still holds, and all that follows, to nowhere: Python flushes it again at the end."""
    if not any(stream is own for own in (sys.__stdout__, sys.__stderr__)):
        return
    with suppress(OSError, ValueError):
        nowhere = os.open(os.devnull, os.O_WRONLY)
        os.dup2(nowhere, stream.fileno())
        os.close(nowhere)
