"""Run a command's task: exit codes, mistakes and faults in one line on standard error, signals."""

import errno
import sys
from collections.abc import Callable, Sequence
from typing import TypeVar

from aircl_jax import defects
from aircl_jax.messages import forgiving_streams, tell
from aircl_jax.runs.stopping import Terminated, termination_raised
from aircl_jax.storage import DiskError, reason
from experiments.cli.words import parse

T = TypeVar("T")
DONE, DEFECT, BAD_INPUT, DISK, INTERRUPTED = 0, 1, 2, 74, 130


def run_command(
    task: Callable[[T, list[str]], int | None], argv: Sequence[str] | None, defaults: T, about: str | None, then: str = ""
) -> int:
    """Run `task(settings, words)` and return the exit code.

    The words are those of `argv`, or of the command line where it is None. The task may return its own code. A ValueError
    of settings or task counts as bad input. `then` says what to do after an interrupt.
    """
    words = sys.argv[1:] if argv is None else list(argv)
    return ending(lambda: task(parse(words, defaults, about), words), then)


def ending(task: Callable[[], int | None], then: str = "") -> int:
    """Run a task and return its exit code; each way to end early is one line on standard error."""
    forgiving_streams()
    try:
        with termination_raised():
            return task() or DONE
    except Terminated as signal:
        return interrupted(then, f"ended by {signal.name}", int(str(signal.code)))
    except KeyboardInterrupt:
        return interrupted(then)
    except Exception as error:
        return ended(error)


def ended(error: Exception) -> int:
    """Print what ended a command as one line on standard error; return the code for it."""
    if isinstance(error, ValueError):
        return complain(str(error))
    if isinstance(error, DiskError):
        return complain(str(error), DISK)
    if isinstance(error, OSError):
        name = "" if error.filename is None else f"{error.filename}: "
        return complain(name + reason(error), BAD_INPUT if error.errno == errno.ENAMETOOLONG else DISK)
    return complain(defects.reported(error), DEFECT)


def complain(message: str, code: int = BAD_INPUT) -> int:
    """Print a mistake as one line on standard error; return its code."""
    tell(f"error: {message}")
    return code


def interrupted(then: str = "", how: str = "interrupted", code: int = INTERRUPTED) -> int:
    """Print that the command was interrupted, and what to do `then`; return the code of the signal."""
    tell(f"{how}; {then}" if then else how)
    return code
