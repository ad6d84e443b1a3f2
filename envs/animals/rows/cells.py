"""Find the rows of a long table that are the same, so that what depends on nothing else is computed once for all of them."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Int

DENSE = 1 << 24  # keys up to here are renumbered by a table of all, longer ones by sorting


class Cells(NamedTuple):
    """Rows that are the same are of one cell; cells are in the order of their columns' values."""

    first: Int[np.ndarray, " G"]  # a row of each cell
    of: Int[np.ndarray, " N"]  # the cell of each row


def cells_of(columns: Sequence[Int[np.ndarray, "N"]]) -> Cells:
    """Number the combinations of values that these columns show together."""
    number = len(columns[0])
    key, size = np.zeros(number, np.int64), 1
    for column in columns:
        least, most = int(column.min(initial=0)), int(column.max(initial=0))
        if most == least:
            continue
        width = most - least + 1
        if size * width > DENSE:
            key, size = _renumbered(key, size)
        key *= width
        key += column
        key -= least
        size *= width
    key, size = _renumbered(key, size)
    first = np.empty(size, np.int64)
    first[key[::-1]] = np.arange(number)[::-1]
    return Cells(first, key.astype(np.int32))


def _renumbered(key: Int[np.ndarray, " N"], size: int) -> tuple[Int[np.ndarray, " N"], int]:
    """Number the keys that occur from 0 on, in their order."""
    if size > DENSE:
        found, key = np.unique(key, return_inverse=True)
        return key, len(found)
    occurs = np.zeros(size, bool)
    occurs[key] = True
    return (np.cumsum(occurs) - 1)[key], int(occurs.sum())
