"""Write and read JSON files of results, whole or not at all, with a digest of what they hold."""

import hashlib
import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from aircl_jax.storage import write_whole

DIGEST = "digest"


def keep(path: Path, cell: Mapping[str, Any]) -> None:
    """Write a cell and its digest, whole or not at all."""
    path.parent.mkdir(parents=True, exist_ok=True)
    read_back = json.loads(_json(cell, levels=2))
    write_whole(path, _json({**cell, DIGEST: _digest(read_back)}, levels=2) + "\n")


def read_kept(path: Path, *names: str) -> dict[str, Any]:
    """Read a kept cell.

    Raises ValueError, in one line with the file, where it is none, has not these names (`group.name` is one within a group),
    or is not what its digest says; cells from before digests have none.
    """
    try:
        cell = json.loads(path.read_bytes())
    except (ValueError, RecursionError):
        cell = None
    if isinstance(cell, dict) and cell.pop(DIGEST, None) in (None, _digest(cell)) and all(_has(cell, name) for name in names):
        return cell
    raise ValueError(f"{path} is damaged; restore or remove it, and the same command makes it anew")


def _digest(cell: Mapping[str, Any]) -> str:
    """Compute the digest of a cell as JSON gives it back, whatever its layout and the order of its names."""
    return hashlib.sha256(json.dumps(cell, sort_keys=True).encode()).hexdigest()[:16]


def _has(cell: Any, name: str) -> bool:
    group, _, rest = name.partition(".")
    return isinstance(cell, dict) and group in cell and (not rest or _has(cell[group], rest))


def _json(value: Any, levels: int, indent: str = "") -> str:
    """Format as JSON with one line for each item of the outer `levels`."""
    if not levels or not isinstance(value, Mapping):
        return json.dumps(value, ensure_ascii=False, allow_nan=False)
    inner = indent + " "
    items = [f"{inner}{json.dumps(name)}: {_json(item, levels - 1, inner)}" for name, item in value.items()]
    return "{\n" + ",\n".join(items) + f"\n{indent}}}"
