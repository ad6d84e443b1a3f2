"""Keep a column of a long table in few bytes: labels as the index of their name, one number for what all rows share."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import Bool, Int, Shaped


def small(values: Int[np.ndarray, "*s"]) -> Int[np.ndarray, "*s"]:
    """Keep integers in as few bytes as their largest needs; −1 and 0 are among them."""
    largest = int(values.max(initial=0))
    return values.astype(np.min_scalar_type(-largest - 1))


def constant(value: Any, number: int) -> Shaped[np.ndarray, "..."]:
    """Make a column whose rows are all this value, which is kept once."""
    return np.broadcast_to(value, (number, *np.shape(value)))


def taken(column: Any, rows: Shaped[np.ndarray, " Q"]) -> Any:
    """Take rows, by index or by mask, of a column; one value for all rows stays one value."""
    if isinstance(column, np.ndarray) and len(column) and column.strides[0] == 0:
        return constant(column[0], int(np.count_nonzero(rows)) if rows.dtype == bool else len(rows))
    return column[rows]


def together(parts: Sequence[Any]) -> Any:
    """Join parts of a column, one below the other."""
    if isinstance(parts[0], Labels):
        return Labels.joined(parts)
    filled = [part for part in parts if len(part)] or parts[:1]
    first = filled[0]
    if len(first) and all(part.strides[0] == 0 and np.array_equal(part[:1], first[:1], equal_nan=True) for part in filled):
        return constant(first[0], sum(map(len, filled)))
    return np.concatenate(parts)


@dataclass(frozen=True, eq=False)
class Labels:
    """A column of labels: of each row the index of its name. `names` are in order; these rows need not have all of them."""

    names: tuple[str, ...]
    index: Int[np.ndarray, " R"]

    @classmethod
    def of(cls, texts: Iterable[str]) -> "Labels":
        listed = list(map(str, texts))
        names = sorted(set(listed))
        place = {name: number for number, name in enumerate(names)}
        return cls(tuple(names), small(np.fromiter((place[text] for text in listed), np.int64, len(listed))))

    @classmethod
    def same(cls, name: str, number: int) -> "Labels":
        """Give all rows one label."""
        return cls((name,), constant(np.zeros((), np.int8), number))

    @classmethod
    def joined(cls, parts: Sequence["Labels"]) -> "Labels":
        names = tuple(sorted({name for part in parts for name in part.names}))
        index = {name: number for number, name in enumerate(names)}
        return cls(names, together([part.recoded(index) for part in parts]))

    def __len__(self) -> int:
        return len(self.index)

    def __getitem__(self, rows: Any) -> "Labels":
        return Labels(self.names, taken(self.index, rows) if isinstance(rows, np.ndarray) else self.index[rows])

    def are(self, *names: str) -> Bool[np.ndarray, " R"]:
        """Mark the rows that have one of these labels."""
        return np.isin(np.array(self.names), names)[self.index]

    def differ(self) -> Bool[np.ndarray, " Q"]:
        """Say of each row but the first whether its label is another than that of the row before."""
        return self.index[1:] != self.index[:-1]

    def recoded(self, index: Mapping[str, int], other: int = -1) -> Int[np.ndarray, " R"]:
        """Give each row the number of its label; `other` to a label that has none."""
        codes = small(np.array([index.get(name, other) for name in self.names], np.int64))
        if len(self) and self.index.strides[0] == 0:
            return constant(codes[self.index[0]], len(self))
        return codes[self.index]

    def counts(self) -> dict[str, int]:
        """Count the rows of each label that some row has."""
        number = np.bincount(self.index, minlength=len(self.names)).tolist()
        return {name: count for name, count in zip(self.names, number, strict=True) if count}

    def texts(self) -> Shaped[np.ndarray, " R"]:
        return np.array(self.names, dtype=str)[self.index]
