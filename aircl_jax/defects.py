"""Faults of this program: one line for people, and the trace in a file for those who mend them."""

import os
import tempfile
import traceback
from collections.abc import Callable
from pathlib import Path
from typing import TypeVar

from aircl_jax.messages import warn

T = TypeVar("T")


def described(error: BaseException) -> str:
    """Return an error's type and words in one line."""
    words = " ".join(str(error).split())
    return f"{type(error).__name__}: {words[:300]}" if words else type(error).__name__


def reported(error: BaseException) -> str:
    """Write an error's trace to a new file among the temporary ones; return a line with the error and that file."""
    try:
        handle, trace = tempfile.mkstemp(prefix="aircl_jax_trace_", suffix=".txt")
        with os.fdopen(handle, "w", encoding="utf-8", errors="backslashreplace") as file:
            file.writelines(traceback.format_exception(error))
    except OSError as refused:
        return f"a fault of this program: {described(error)}; its trace cannot be kept: {refused.strerror}"
    return f"a fault of this program: {described(error)}; its trace is in {trace}"


class Attempts:
    """Do what may fail without costing a run: each failure is a line, and its trace is appended to one file."""

    def __init__(self, trace: Path) -> None:
        self.trace = trace
        self.failed: list[str] = []

    def __call__(self, what: str, make: Callable[[], T], otherwise: T) -> T:
        """Return what `make` does, or `otherwise` where it fails; an error of the disk is no fault and passes."""
        try:
            return make()
        except OSError:
            raise
        except Exception as error:
            self.failed.append(f"{what} failed ({described(error)}); the trace is in {self.trace}")
            warn(self.failed[-1])
            with self.trace.open("a", encoding="utf-8", errors="backslashreplace") as file:
                file.writelines([f"{what}\n", *traceback.format_exception(error), "\n"])
            return otherwise
