"""Run a command's task: exit codes, mistakes in one line on standard error, interrupts."""

import sys
from collections.abc import Callable, Sequence
from typing import TypeVar

from experiments.cli.words import parse

T = TypeVar("T")
DONE, BAD_INPUT, INTERRUPTED = 0, 2, 130


def run_command(
    task: Callable[[T, list[str]], int | None], argv: Sequence[str] | None, defaults: T, about: str | None, then: str = ""
) -> int:
    """Run `task(settings, words)` and return the exit code.

    The words are those of `argv`, or of the command line where it is None. The task may return its own code. A ValueError
    of settings or task counts as bad input. `then` says what to do after an interrupt.
    """
    words = sys.argv[1:] if argv is None else list(argv)
    try:
        return task(parse(words, defaults, about), words) or DONE
    except ValueError as error:
        return complain(str(error))
    except KeyboardInterrupt:
        return interrupted(then)


def complain(message: str) -> int:
    """Print a mistake as one line on standard error; return the code of bad input."""
    print("error: " + " ".join(message.split()), file=sys.stderr)
    return BAD_INPUT


def interrupted(then: str = "") -> int:
    """Print that the command was interrupted, and what to do `then`; return the code of an interrupt."""
    print("interrupted" + (f"; {then}" if then else ""), file=sys.stderr)
    return INTERRUPTED
