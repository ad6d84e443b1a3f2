"""Write every iteration's metrics as JSON lines, and read them into arrays."""

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from aircl_jax.storage import write_whole

METRICS = "metrics.jsonl"  # file in a run's directory


def read_metrics(path: Path) -> dict[str, np.ndarray]:
    """Read a run's metrics.jsonl as {metric: [iterations, S]}."""
    return stack([json.loads(line) for line in complete_lines(path / METRICS)])


def stack(rows: Sequence[Mapping[str, Any]]) -> dict[str, np.ndarray]:
    """Stack rows as {metric: [iterations, S]}; undefined values, and iterations without the metric, are NaN."""
    names = sorted({name for row in rows for name in row})
    missing = [None] * len(next(iter(rows[0].values()))) if rows else []
    return {name: np.array([row.get(name, missing) for row in rows], float) for name in names}


def to_json(values: Mapping[str, Sequence[Any] | np.ndarray]) -> str:
    """Format as one line of strict JSON; each number is the shortest that reads back to the same float32, null undefined."""
    return json.dumps({name: numbers(value) for name, value in values.items()}, allow_nan=False)


def numbers(values: Sequence[Any] | np.ndarray) -> list[float | None]:
    """Convert to floats as JSON keeps them, with None for values that are not finite."""
    array = np.asarray(values, np.float32)
    return [float(str(value)) if np.isfinite(value) else None for value in array]


def complete_lines(path: Path) -> list[str]:
    """Return the lines of a file, without the last one where a kill has cut it."""
    return [line for line in path.read_text().splitlines(keepends=True) if line.endswith("\n")]


def cut(path: Path, lines: int) -> None:
    """Cut the file to its first lines; create it empty where it is missing."""
    first = complete_lines(path)[:lines] if path.exists() else []
    write_whole(path, "".join(first))
