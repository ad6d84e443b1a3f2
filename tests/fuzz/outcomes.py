"""What a function did with an odd input: its result, or the line in which it was refused."""

from collections.abc import Callable
from typing import NamedTuple, TypeVar

T = TypeVar("T")


class Refused(NamedTuple):
    """The message of a ValueError."""

    line: str

    def names(self, place: object) -> bool:
        """Whether it is one line that begins with the place of the mistake."""
        return self.line.startswith(str(place)) and "\n" not in self.line


def outcome(of: Callable[[], T]) -> T | Refused:
    """Call it; whatever it raises but ValueError is a failure of the test."""
    try:
        return of()
    except ValueError as error:
        return Refused(str(error))
