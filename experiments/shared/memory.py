"""Measure the memory of this process."""

import importlib
from typing import Any


def most_memory() -> int:
    """Return the most memory that this process held, in bytes; 0 on systems that do not say."""
    try:
        usage: Any = importlib.import_module("resource")
    except ImportError:
        return 0
    return 1024 * usage.getrusage(usage.RUSAGE_SELF).ru_maxrss
