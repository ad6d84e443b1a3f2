"""End a run by a signal: note it, let the chunk under way be finished and saved, then stop."""

import signal
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

ENDING = tuple(getattr(signal, name) for name in ("SIGINT", "SIGTERM", "SIGHUP") if hasattr(signal, name))


class Terminated(SystemExit):
    """Raised for SIGTERM and SIGHUP, as KeyboardInterrupt is for SIGINT; left alone, it ends the process with its code."""

    def __init__(self, number: int) -> None:
        super().__init__(128 + number)
        self.name = signal.Signals(number).name

    def __reduce__(self) -> tuple[type["Terminated"], tuple[int]]:
        return Terminated, (int(str(self.code)) - 128,)


def terminate(number: int, _: Any) -> None:
    """Handle a signal by raising Terminated at once."""
    raise Terminated(number)


@contextmanager
def termination_raised() -> Iterator[None]:
    """Raise Terminated for SIGTERM and SIGHUP where they would end the process without a word."""
    with _handled(terminate, [number for number in ENDING if number != signal.SIGINT], (signal.SIG_DFL,)):
        yield


@contextmanager
def signals_noted() -> Iterator[Callable[..., None]]:
    """Note SIGINT, SIGTERM and SIGHUP; yield a function that raises what was noted. The next signal acts at once.

    The function may be given another which says of the signal's number, 0 for none, which number to raise for.
    Ignored signals stay ignored, and a handler of the caller's own stays in place. Outside the main thread, which alone
    has signals, nothing is noted.
    """
    noted: list[int] = []

    def stop(agreed: Callable[[int], int] = int) -> None:
        if number := agreed(noted[0] if noted else 0):
            raise KeyboardInterrupt if number == signal.SIGINT else Terminated(number)

    replaced = (signal.SIG_DFL, signal.default_int_handler, terminate)
    with _handled(lambda number, _: noted.append(number), ENDING, replaced, once=True):
        yield stop


@contextmanager
def _handled(
    handler: Callable[[int, Any], None], numbers: Any, replaced: tuple[Any, ...], once: bool = False
) -> Iterator[None]:
    """Handle the signals whose present handler is one of `replaced`, until the block ends or, if `once`, until the first."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    before = {number: signal.getsignal(number) for number in numbers if signal.getsignal(number) in replaced}

    def restore() -> None:
        for number, earlier in before.items():
            signal.signal(number, earlier)

    def first(number: int, frame: Any) -> None:
        restore()
        handler(number, frame)

    for number in before:
        signal.signal(number, first if once else handler)
    try:
        yield
    finally:
        restore()
