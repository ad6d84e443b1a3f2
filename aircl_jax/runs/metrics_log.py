"""The log of every iteration's metrics: JSON lines, read into arrays."""

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from aircl_jax.storage import write_whole

METRICS = "metrics.jsonl"  # in a run's directory


def read_metrics(path: Path) -> dict[str, np.ndarray]:
    """A run's metrics.jsonl as {metric: [iterations, S]}."""
    return stack([json.loads(line) for line in complete_lines(path / METRICS)])


def stack(rows: Sequence[Mapping[str, Any]]) -> dict[str, np.ndarray]:
    """{metric: [iterations, S]}; what is undefined, and an iteration without the metric, is NaN."""
    names = sorted({name for row in rows for name in row})
    missing = [None] * len(next(iter(rows[0].values()))) if rows else []
    return {name: np.array([row.get(name, missing) for row in rows], float) for name in names}


def to_json(values: Mapping[str, Sequence[Any] | np.ndarray]) -> str:
    """One line of strict JSON, each number the shortest that reads back to the same float32; undefined is null."""
    return json.dumps({name: numbers(value) for name, value in values.items()}, allow_nan=False)


def numbers(values: Sequence[Any] | np.ndarray) -> list[float | None]:
    """Floats as JSON keeps them: what is not finite is None."""
    array = np.asarray(values, np.float32)
    return [float(str(value)) if np.isfinite(value) else None for value in array]


def complete_lines(path: Path) -> list[str]:
    """The lines of a file, without the last where a kill has cut it."""
    return [line for line in path.read_text().splitlines(keepends=True) if line.endswith("\n")]


def cut(path: Path, lines: int) -> None:
    """Keep the first lines; a file that is not there becomes empty."""
    first = complete_lines(path)[:lines] if path.exists() else []
    write_whole(path, "".join(first))
