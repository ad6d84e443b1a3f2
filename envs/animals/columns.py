"""Names of the columns in a table of tracks: a YAML file for every kind of animal and format."""

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
    columns: dict[str, Any]  # ours → theirs; `coordinates` is one column "[x;y;z]" or a list of columns
    recording: str = "file"  # one recording per file, or the column that names it
    site: str = ""  # regular expression whose first group, in the recording's name, is the camera
    step: float = 1.0  # time between two rows of a track; a longer one is a gap
    behaviours: tuple[str, ...] = ()
    places: tuple[str, ...] = ()
    groups: tuple[str, ...] = ()  # kept
    other_groups: tuple[str, ...] = ()  # known, and kept only if asked for
    no_behaviour: str = ""  # the label of animals of the other groups, whose behaviour was not annotated
    moving: str = ""  # the behaviour that becomes "moving to PLACE"
    missing_coordinates: tuple[float, ...] = ()  # where these stand, the position is unknown
    map_axes: tuple[int, int] = (0, 1)  # which two coordinates span the ground
    coordinate_scale: float = 1.0  # figures show coordinates divided by this
    coordinate_unit: str = "unknown unit"  # in words, of what figures show


def load_mapping(name: str) -> ColumnMapping:
    """Load a shipped mapping by name, or a YAML file. Raises ValueError naming the unknown name or key."""
    path = Path(name) if name.endswith((".yaml", ".yml")) else MAPPINGS / f"{name}.yaml"
    if not path.is_file():
        shipped = ", ".join(sorted(file.stem for file in MAPPINGS.glob("*.yaml")))
        raise ValueError(f"unknown mapping {name!r}; choose from {shipped}, or give a YAML file")
    try:
        given = yaml.safe_load(path.read_text(encoding="utf-8"))
    except (yaml.YAMLError, UnicodeDecodeError) as error:
        raise ValueError(f"{path}: no YAML: {' '.join(str(error).split())}") from None
    known = [field.name for field in fields(ColumnMapping)]
    if not isinstance(given, dict) or not isinstance(given.get("columns"), dict):
        raise ValueError(f"{path}: a mapping needs the key 'columns'; its keys are {', '.join(known)}")
    given.setdefault("name", path.stem)
    _check_keys(path, given, known)
    _check_keys(path, given["columns"], [*REQUIRED, *OPTIONAL])
    for column in REQUIRED:
        if column not in given["columns"]:
            raise ValueError(f"{path}: columns lacks {column!r}; it needs {', '.join(REQUIRED)}")
    return ColumnMapping(**{key: _converted(path, key, value) for key, value in given.items()})


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


def _check_keys(path: Path, given: dict[str, Any], known: list[str]) -> None:
    for key in given:
        if key not in known:
            raise ValueError(f"{path}: unknown key {key!r}; choose from {', '.join(known)}")
