"""Write and read JSON files of results, whole or not at all."""

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from aircl_jax.storage import write_whole


def keep(path: Path, cell: Mapping[str, Any]) -> None:
    """Write a cell, whole or not at all."""
    path.parent.mkdir(parents=True, exist_ok=True)
    write_whole(path, _json(cell, levels=2) + "\n")


def read_kept(path: Path, *names: str) -> dict[str, Any]:
    """Read a kept cell. Raises ValueError, in one line with the file, where it is none or has not these names."""
    try:
        cell = json.loads(path.read_bytes())
    except (ValueError, RecursionError):
        cell = None
    if isinstance(cell, dict) and all(name in cell for name in names):
        return cell
    raise ValueError(f"{path} is damaged; restore or remove it, and the same command makes it anew")


def _json(value: Any, levels: int, indent: str = "") -> str:
    """Format as JSON with one line for each item of the outer `levels`."""
    if not levels or not isinstance(value, Mapping):
        return json.dumps(value, ensure_ascii=False, allow_nan=False)
    inner = indent + " "
    items = [f"{inner}{json.dumps(name)}: {_json(item, levels - 1, inner)}" for name, item in value.items()]
    return "{\n" + ",\n".join(items) + f"\n{indent}}}"
