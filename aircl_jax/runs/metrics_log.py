"""Write every iteration's metrics as JSON lines, and read them into arrays."""

import hashlib
import json
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from aircl_jax.storage import replacing

METRICS = "metrics.jsonl"  # file in a run's directory
LARGEST = 1e39  # above every float32


def read_metrics(path: Path, lines: int | None = None) -> dict[str, np.ndarray]:
    """Read a run's metrics.jsonl, or its first `lines`, as {metric: [iterations, S]}.

    Raises ValueError that names the line which is none of metrics.
    """
    rows = read_lines(path / METRICS, _is_row, lines)
    if len({len(values) for row in rows for values in row.values()}) > 1:
        raise ValueError(f"{path / METRICS} has lines of different numbers of seeds; restore the file, or train the run again")
    return stack(rows)


def read_lines(path: Path, fits: Callable[[Any], bool], lines: int | None = None) -> list[dict[str, Any]]:
    """Read a file of JSON lines. Raises ValueError that names the first line which does not fit."""
    rows = []
    for number, line in enumerate(complete_lines(path)[:lines], 1):
        try:
            row = json.loads(line, parse_constant=_refuse_constant)
        except (ValueError, RecursionError):
            row = None
        if not fits(row):
            raise ValueError(f"{path}, line {number}, is not what a run writes there; restore the file, or train the run again")
        rows.append(row)
    return rows


def _refuse_constant(name: str) -> None:
    raise ValueError(name)


def _is_row(row: Any) -> bool:
    return isinstance(row, dict) and all(isinstance(values, list) and all(map(is_number, values)) for values in row.values())


def is_number(value: Any) -> bool:
    """Say whether a value is a number as a run writes it, or null."""
    return value is None or (isinstance(value, int | float) and not isinstance(value, bool) and abs(value) < LARGEST)


def stack(rows: Sequence[Mapping[str, Any]]) -> dict[str, np.ndarray]:
    """Stack rows as {metric: [iterations, S]}; undefined values, and iterations without the metric, are NaN."""
    names = sorted({name for row in rows for name in row})
    missing = [None] * len(next(iter(rows[0].values()))) if names else []
    return {name: np.array([row.get(name, missing) for row in rows], float) for name in names}


def to_json(values: Mapping[str, Sequence[Any] | np.ndarray]) -> str:
    """Format as one line of strict JSON; each number is the shortest that reads back to the same float32, null undefined."""
    return json.dumps({name: numbers(value) for name, value in values.items()}, allow_nan=False)


def numbers(values: Sequence[Any] | np.ndarray) -> list[float | None]:
    """Convert to floats as JSON keeps them, with None for values that are not finite."""
    array = np.asarray(values, np.float32)
    return [float(str(value)) if np.isfinite(value) else None for value in array]


def complete_lines(path: Path) -> list[bytes]:
    """Return the lines of a file, without the last one where a kill has cut it."""
    return [line + b"\n" for line in path.read_bytes().split(b"\n")[:-1]]


def digest(path: Path, lines: int) -> str:
    """Compute the SHA-256 of the first lines of a file; empty where it has fewer."""
    first = complete_lines(path)[:lines] if path.is_file() else []
    return hashlib.sha256(b"".join(first)).hexdigest() if len(first) == lines else ""


def cut(path: Path, lines: int) -> bytes:
    """Cut the file to its first lines, which are returned; create it empty where it is missing."""
    first = b"".join(complete_lines(path)[:lines]) if path.exists() else b""
    with replacing(path) as beside:
        beside.write_bytes(first)
    return first
