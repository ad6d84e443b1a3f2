"""Read the names of the columns in a table of tracks from a YAML file, one for every kind of animal and format."""

from collections.abc import Callable
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any

import yaml

MAPPINGS = Path(__file__).parent / "mappings"
REQUIRED = ("time", "individual", "behaviour")
OPTIONAL = ("place", "coordinates", "group", "close", "distant")


@dataclass(frozen=True)
class ColumnMapping:
    """Names of the columns and their allowed values. Empty `behaviours` or `places` allow whatever the tables hold."""

    name: str
    columns: dict[str, Any]  # our name → the table's; `coordinates` is one column "[x;y;z]" or a list of columns
    recording: str = "file"  # one recording per file, or the column that names it
    site: str = ""  # regular expression whose first group, in the recording's name, is the camera
    step: float = 1.0  # time between two rows of a track; a longer one is a gap
    behaviours: tuple[str, ...] = ()
    places: tuple[str, ...] = ()
    groups: tuple[str, ...] = ()  # groups whose rows are used
    other_groups: tuple[str, ...] = ()  # groups whose rows are used only if asked for
    no_behaviour: str = ""  # label of animals of the other groups, whose behaviour was not annotated
    moving: str = ""  # the behaviour that becomes "moving to PLACE"
    missing_coordinates: tuple[float, ...] = ()  # coordinates that stand for an unknown position
    map_axes: tuple[int, int] = (0, 1)  # the two coordinates that span the ground
    coordinate_scale: float = 1.0  # figures show coordinates divided by this
    coordinate_unit: str = "unknown unit"  # unit of the scaled coordinates, in words


def load_mapping(name: str) -> ColumnMapping:
    """Load a shipped mapping by name, or a YAML file. Raises ValueError naming the unknown name or key."""
    path = Path(name) if name.endswith((".yaml", ".yml")) else MAPPINGS / f"{name}.yaml"
    if not path.is_file():
        shipped = ", ".join(sorted(file.stem for file in MAPPINGS.glob("*.yaml")))
        raise ValueError(f"unknown mapping {name!r}; choose from {shipped}, or give a YAML file")
    try:
        entries = yaml.safe_load(path.read_text(encoding="utf-8"))
    except (yaml.YAMLError, UnicodeDecodeError) as error:
        raise ValueError(f"{path}: no YAML: {' '.join(str(error).split())}") from None
    known = [field.name for field in fields(ColumnMapping)]
    if not isinstance(entries, dict) or not isinstance(entries.get("columns"), dict):
        raise ValueError(f"{path}: a mapping needs the key 'columns'; its keys are {', '.join(known)}")
    entries.setdefault("name", path.stem)
    _check_keys(path, entries, known)
    _check_keys(path, entries["columns"], [*REQUIRED, *OPTIONAL])
    for column in REQUIRED:
        if column not in entries["columns"]:
            raise ValueError(f"{path}: columns lacks {column!r}; it needs {', '.join(REQUIRED)}")
    return ColumnMapping(**{key: _converted(path, key, value) for key, value in entries.items()})


def _labels(value: Any) -> tuple[str, ...]:
    if not isinstance(value, list):
        raise TypeError
    return tuple(str(label) for label in value)


_CONVERTERS: dict[str, Callable[[Any], Any]] = {
    "columns": dict,
    "step": float,
    "coordinate_scale": float,
    "behaviours": _labels,
    "places": _labels,
    "groups": _labels,
    "other_groups": _labels,
    "missing_coordinates": lambda value: tuple(float(number) for number in value),
    "map_axes": lambda value: (int(value[0]), int(value[1])),
}


def _converted(path: Path, key: str, value: Any) -> Any:
    try:
        return _CONVERTERS.get(key, str)(value)
    except (TypeError, ValueError, IndexError):
        raise ValueError(f"{path}: {key}: {value!r} is not what this key takes; see docs/animals.md") from None


def _check_keys(path: Path, entries: dict[str, Any], known: list[str]) -> None:
    for key in entries:
        if key not in known:
            raise ValueError(f"{path}: unknown key {key!r}; choose from {', '.join(known)}")
