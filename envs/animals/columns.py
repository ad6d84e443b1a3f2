"""Read the names of the columns in a table of tracks from a YAML file, one for every kind of animal and format.

Every scalar of the file is read as text, so that labels such as `no`, `on` and `01` stay what they are.
"""

import math
import re
import reprlib
from collections.abc import Callable, Hashable
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any

import yaml

MAPPINGS = Path(__file__).parent / "mappings"
REQUIRED = ("time", "individual", "behaviour")
OPTIONAL = ("stop", "place", "coordinates", "group", "close", "distant")
GROUND = 3  # coordinates of a position, at most
NUMBER = re.compile(r"[+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?", re.ASCII)


@dataclass(frozen=True)
class ColumnMapping:
    """Names of the columns and their allowed values. Empty `behaviours` or `places` allow whatever the tables hold."""

    name: str
    columns: dict[str, Any]  # our name → the table's; `coordinates` is one column "[x;y;z]" or a list of columns
    recording: str = "file"  # one recording per file, or the column that names it
    site: str = ""  # regular expression whose first group, in the recording's name, is the camera
    step: float = 1.0  # time between two rows of a track; a longer one is a gap. With `stop`, time between two samples
    behaviours: tuple[str, ...] = ()
    places: tuple[str, ...] = ()
    groups: tuple[str, ...] = ()  # groups whose rows are used
    other_groups: tuple[str, ...] = ()  # groups whose rows are used only if asked for
    no_behaviour: str = ""  # label of animals of the other groups, whose behaviour was not annotated
    moving: str = ""  # the behaviour that becomes "moving to PLACE"
    missing_coordinates: tuple[float, ...] = ()  # coordinates that stand for an unknown position, beside empty ones
    map_axes: tuple[int, int] = (0, 1)  # the two coordinates that span the ground
    coordinate_scale: float = 1.0  # figures show coordinates divided by this
    coordinate_unit: str = "unknown unit"  # unit of the scaled coordinates, in words


def mapping_file(name: str) -> Path:
    """Find a shipped mapping by name, or a YAML file. Raises ValueError naming the unknown name."""
    path = Path(name) if name.endswith((".yaml", ".yml")) else MAPPINGS / f"{name}.yaml"
    if not path.is_file():
        shipped = ", ".join(sorted(file.stem for file in MAPPINGS.glob("*.yaml")))
        raise ValueError(f"unknown mapping {name!r}; choose from {shipped}, or give a YAML file")
    return path


def load_mapping(name: str) -> ColumnMapping:
    """Load a shipped mapping by name, or a YAML file. Raises ValueError naming file, key, value and what the key takes."""
    path = mapping_file(name)
    try:
        entries = _read(path)
        _check_keys(entries, [field.name for field in fields(ColumnMapping)])
        if "columns" not in entries:
            known = ", ".join(field.name for field in fields(ColumnMapping))
            raise ValueError(f"a mapping needs the key 'columns'; its keys are {known}")
        given: dict[str, Any] = {key: _converted(key, value) for key, value in entries.items()}
        mapping = ColumnMapping(**{"name": path.stem, **given})
        _check_together(mapping, set(given))
    except ValueError as error:
        raise ValueError(f"{path}: {error}") from None
    return mapping


class _Texts(yaml.BaseLoader):
    """Read every scalar as text, and refuse a key that comes twice."""

    def construct_mapping(self, node: Any, deep: bool = False) -> dict[Hashable, Any]:
        keys = [key.value for key, _ in node.value if isinstance(key.value, str)]
        for key in keys:
            if keys.count(key) > 1:
                raise yaml.constructor.ConstructorError(None, None, f"the key {key!r} comes twice", node.start_mark)
        return super().construct_mapping(node, deep)


def _read(path: Path) -> dict[str, Any]:
    try:
        entries = yaml.load(path.read_text(encoding="utf-8-sig"), _Texts)  # noqa: S506
    except (yaml.YAMLError, UnicodeDecodeError, RecursionError) as error:
        raise ValueError(f"no YAML: {' '.join(str(error).split())}") from None
    except OSError as error:
        raise ValueError(f"cannot be read: {error.strerror}") from None
    if not isinstance(entries, dict):
        known = ", ".join(field.name for field in fields(ColumnMapping))
        raise ValueError(f"a mapping needs the key 'columns'; its keys are {known}")
    return entries


def _check_keys(entries: dict[str, Any], known: list[str]) -> None:
    for key in entries:
        if key not in known:
            raise ValueError(f"unknown key {_shown(key)}; choose from {', '.join(known)}")


def _text(value: Any) -> str:
    if not isinstance(value, str) or not value.strip():
        raise ValueError
    return value


def _number(value: Any) -> float:
    number = float(value) if isinstance(value, str) and NUMBER.fullmatch(value) else math.nan
    if not math.isfinite(number):
        raise ValueError
    return number


def _positive(value: Any) -> float:
    number = _number(value)
    if number <= 0:
        raise ValueError
    return number


def _labels(value: Any) -> tuple[str, ...]:
    labels = tuple(_text(label) for label in _list(value))
    if len(set(labels)) != len(labels):
        raise ValueError
    return labels


def _list(value: Any) -> list[Any]:
    if not isinstance(value, list):
        raise ValueError
    return value


def _numbers(value: Any) -> tuple[float, ...]:
    numbers = tuple(_number(number) for number in _list(value))
    if not 1 <= len(numbers) <= GROUND:
        raise ValueError
    return numbers


def _axes(value: Any) -> tuple[int, int]:
    first, second = _list(value)
    axes = int(_text(first)), int(_text(second))
    if axes[0] == axes[1] or not {*axes} <= set(range(GROUND)):
        raise ValueError
    return axes


def _site(value: Any) -> str:
    if value == "":
        return ""
    try:
        expression = re.compile(_text(value))
    except re.error:
        raise ValueError from None
    if not expression.groups:
        raise ValueError
    return expression.pattern


def _columns(value: Any) -> dict[str, Any]:
    if not isinstance(value, dict):
        raise ValueError(f"columns: {_shown(value)} is no list of names; it needs {', '.join(REQUIRED)}")
    for column in REQUIRED:
        if column not in value:
            raise ValueError(f"columns lacks {column!r}; it needs {', '.join(REQUIRED)}")
    _check_keys(value, [*REQUIRED, *OPTIONAL])
    return {ours: _column(ours, name) for ours, name in value.items()}


def _column(ours: str, name: Any) -> Any:
    try:
        if ours != "coordinates" or isinstance(name, str):
            return _text(name)
        names = list(_labels(name))
    except ValueError:
        names = []
    if not 1 <= len(names) <= GROUND:
        takes = (
            f"the name of one column with [x;y;z], or a list of 1 to {GROUND}" if ours == "coordinates" else "a column's name"
        )
        raise ValueError(f"columns: {ours}: {_shown(name)} is not {takes}")
    return names


_LABELS = "a list of labels, each once"
_KEYS: dict[str, tuple[Callable[[Any], Any], str]] = {
    "name": (_text, "a text"),
    "recording": (_text, "file, or the name of a column"),
    "site": (_site, "a regular expression with a group, such as _(C\\d+)_"),
    "step": (_positive, "a number above 0: the time between two rows of a track"),
    "behaviours": (_labels, _LABELS),
    "places": (_labels, _LABELS),
    "groups": (_labels, _LABELS),
    "other_groups": (_labels, _LABELS),
    "no_behaviour": (_text, "a label"),
    "moving": (_text, "a label of the behaviours"),
    "missing_coordinates": (_numbers, f"a list of 1 to {GROUND} numbers"),
    "map_axes": (_axes, f"a list of two different numbers from 0 to {GROUND - 1}"),
    "coordinate_scale": (_positive, "a number above 0"),
    "coordinate_unit": (_text, "a text"),
}


def _converted(key: str, value: Any) -> Any:
    if key == "columns":
        return _columns(value)
    read, takes = _KEYS[key]
    try:
        return read(value)
    except ValueError:
        raise ValueError(f"{key}: {_shown(value)} is not what this key takes: {takes}") from None


def _shown(value: Any) -> str:
    """Write a value shortly: what a file holds may be as long as it likes."""
    return " ".join(reprlib.repr(value).split())


# A key, and the column without which it would say nothing.
_NEEDS = {
    "places": "place",
    "moving": "place",
    "groups": "group",
    "other_groups": "group",
    "missing_coordinates": "coordinates",
    "map_axes": "coordinates",
}


def _check_together(mapping: ColumnMapping, given: set[str]) -> None:
    """Raise ValueError for keys that contradict each other."""
    columns = mapping.columns
    for key, column in _NEEDS.items():
        if key in given and column not in columns:
            raise ValueError(f"{key}: needs the column {column!r}; add {column} to columns, or leave {key} out")
    names = [columns[ours] for ours in REQUIRED]
    if len(set(names)) < len(names):
        raise ValueError(f"columns: {', '.join(REQUIRED)} are {', '.join(map(repr, names))}; choose three columns")
    if mapping.behaviours and mapping.moving and mapping.moving not in mapping.behaviours:
        raise ValueError(f"moving: {mapping.moving!r} is no behaviour; choose from {', '.join(mapping.behaviours)}")
    if both := [label for label in mapping.groups if label in mapping.other_groups]:
        raise ValueError(f"other_groups: {both[0]!r} is also in groups; choose one of them")
    if "no_behaviour" in given and not mapping.other_groups:
        raise ValueError(f"no_behaviour: {mapping.no_behaviour!r} is a label of other_groups; add those, or leave it out")
    number = len(columns["coordinates"]) if isinstance(columns.get("coordinates"), list) else GROUND
    if len(mapping.missing_coordinates) > number:
        raise ValueError(f"missing_coordinates: {list(mapping.missing_coordinates)} are more than the {number} of columns")
    if "map_axes" in given and max(mapping.map_axes) >= number:
        raise ValueError(f"map_axes: {list(mapping.map_axes)}; the coordinates are numbered 0 to {number - 1}")
