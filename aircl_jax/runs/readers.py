"""Read the files of a run, one function a file; what cannot be read is named with its file in one line."""

import json
from pathlib import Path
from typing import Any

import yaml

from aircl_jax.runs.metrics_log import is_number, read_lines

CONFIG, TIMING, SUMMARY = "config.yaml", "timing.jsonl", "summary.json"


def read_config(path: Path) -> dict[str, Any]:
    """Read a run's settings. Raises ValueError where they cannot be read."""
    file = path / CONFIG
    try:
        settings = yaml.safe_load(file.read_text(encoding="utf-8"))
    except (yaml.YAMLError, ValueError, RecursionError) as error:
        raise ValueError(f"{file} cannot be read; restore it, or choose overwrite=true or another directory") from error
    if not isinstance(settings, dict) or not all(isinstance(name, str) for name in settings):
        raise ValueError(f"{file} holds no settings; restore it, or choose overwrite=true or another directory")
    return settings


def read_timing(path: Path) -> list[dict[str, Any]]:
    """Read a run's timing, one line a chunk; none where the file is missing. Raises ValueError that names a wrong line."""
    file = path / TIMING
    return read_lines(file, _is_timing) if file.exists() else []


def _is_timing(line: Any) -> bool:
    if not isinstance(line, dict) or type(line.get("iteration")) is not int:
        return False
    seconds = [line[name] for name in ("seconds", "compile_s", "env_steps") if name in line]
    since = line.get("not_finite", [])
    lists = isinstance(since, list) and all(value is None or type(value) is int for value in since)
    return lists and None not in seconds and all(map(is_number, seconds)) and isinstance(line.get("first", False), bool)


def read_summary(path: Path) -> dict[str, Any] | None:
    """Read a run's summary; None where it is missing or cannot be read, because the checkpoint can make it again."""
    return read_json(path / SUMMARY)


def read_json(file: Path) -> dict[str, Any] | None:
    """Read a JSON file that holds one object; None where it is missing or holds none."""
    try:
        found = json.loads(file.read_bytes())
    except (OSError, ValueError, RecursionError):
        return None
    return found if isinstance(found, dict) else None
