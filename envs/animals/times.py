"""Read the times of a table: plain numbers, times of day or ISO dates; the latter two become seconds."""

import math
import re
from collections.abc import Callable, Sequence
from datetime import UTC, datetime
from typing import NamedTuple, NoReturn

import numpy as np
from jaxtyping import Float

from envs.animals.columns import NUMBER

CHOICES = "a number, HH:MM:SS or an ISO date such as 2024-05-01 10:00:00"
HALF_A_DAY = 43_200.0  # seconds


class Kind(NamedTuple):
    """One way to write times."""

    words: str
    pattern: re.Pattern[str]
    read: Callable[[str], float]


def _clock(text: str) -> float:
    hours, minutes, seconds = text.split(":")
    return 3600 * int(hours) + 60 * int(minutes) + float(seconds)


def _date(text: str) -> float:
    """Count seconds since 1970, in UTC where the text names no zone."""
    moment = datetime.fromisoformat(text)
    return (moment if moment.tzinfo else moment.replace(tzinfo=UTC)).timestamp()


_DAY = r"\d{4}-\d{2}-\d{2}"
_TIME = r"[T ]\d{2}:\d{2}(?::\d{2}(?:\.\d+)?)?"
CLOCK = Kind("HH:MM:SS", re.compile(r"\d{1,3}:[0-5]\d:[0-5]\d(?:\.\d+)?", re.ASCII), _clock)
KINDS = (
    Kind("a number", NUMBER, float),
    CLOCK,
    Kind("an ISO date", re.compile(rf"{_DAY}(?:{_TIME})?", re.ASCII), _date),
    Kind("an ISO date with a zone", re.compile(rf"{_DAY}{_TIME}(?:Z|[+-]\d{{2}}:?\d{{2}})", re.ASCII), _date),
)
_SHORT_CLOCK = re.compile(r"\d{1,3}:\d{2}(?:\.\d+)?", re.ASCII)


def read_times(
    texts: Sequence[str], fail: Callable[[int, str], NoReturn], kind: Kind | None = None
) -> tuple[Float[np.ndarray, " R"], Kind]:
    """Read a column of times, all of one kind, that of the first unless it is given; `fail(position, what)` refuses a text."""
    kind = kind or _kind(texts[0])
    times = np.empty(len(texts))
    for position, text in enumerate(texts):
        if kind is None or not kind.pattern.fullmatch(text):
            other = _kind(text)
            if other is not None and kind is not None:
                fail(position, f"is {other.words} where the rows before have {kind.words}; choose one")
            if _SHORT_CLOCK.fullmatch(text):
                fail(position, "is hours and minutes or minutes and seconds; choose HH:MM:SS")
            fail(position, f"is not {CHOICES}")
        try:
            times[position] = kind.read(text)
        except (ValueError, OverflowError):
            fail(position, "is no date of the calendar")
        if not math.isfinite(times[position]):
            fail(position, "is not a finite number")
    return times, kind or KINDS[0]


def _kind(text: str) -> Kind | None:
    return next((kind for kind in KINDS if kind.pattern.fullmatch(text)), None)
