"""From untyped settings (command line, YAML, keywords) to frozen dataclasses, with names, types and choices checked."""

import math
from collections.abc import Mapping
from dataclasses import is_dataclass, replace
from types import UnionType
from typing import Any, Literal, TypeVar, Union, get_args, get_origin, get_type_hints

T = TypeVar("T")

_PLAIN = {bool: "true or false", int: "an integer", float: "a number", str: "a text", dict: "a group as in {NAME: VALUE}"}


def updated(default: T, values: Mapping[str, Any], prefix: str = "") -> T:
    """The frozen dataclass with these values in place of its own, groups within groups.

    Raises ValueError that names the setting, the value and the choices.
    """
    hints = get_type_hints(type(default))
    for name in values:
        if name not in hints:
            raise ValueError(f"unknown setting {_join(prefix, name)}; choose from {', '.join(hints)}")
    return replace(
        default,  # pyright: ignore[reportArgumentType]
        **{name: _converted(getattr(default, name), hints[name], value, _join(prefix, name)) for name, value in values.items()},
    )


def flatten(values: Mapping[str, Any], prefix: str = "") -> dict[str, Any]:
    """{"a": {"b": 1}} as {"a.b": 1}; lists and tuples compare equal."""
    flat: dict[str, Any] = {}
    for name, value in values.items():
        if isinstance(value, Mapping):
            flat |= flatten(value, _join(prefix, name))
        else:
            flat[_join(prefix, name)] = plain(value)
    return flat


def plain(value: Any) -> Any:
    """Tuples and arrays as lists, through and through, as YAML and JSON keep them."""
    value = of_python(value)
    if isinstance(value, Mapping):
        return {name: plain(item) for name, item in value.items()}
    return [plain(item) for item in value] if isinstance(value, (list, tuple)) else value


def _join(prefix: str, name: str) -> str:
    return f"{prefix}.{name}" if prefix else str(name)


def _converted(default: Any, annotation: Any, value: Any, name: str) -> Any:
    if is_dataclass(annotation):
        if isinstance(value, type(default)):
            return value
        if not isinstance(value, Mapping):
            raise ValueError(f"{name}={_shown(value)} is not a group of settings; set its fields, as in {name}.FIELD=…")
        return updated(default, value, name)
    converted = _match(annotation, value)
    if converted is None:
        raise ValueError(f"{name}={_shown(value)} is not {_describe(annotation)}")
    return converted


def _match(annotation: Any, value: Any) -> Any:
    """The value as that type, or None where it is none of it."""
    value = of_python(value)
    origin, args = get_origin(annotation), get_args(annotation)
    if origin is Literal:
        return value if any(value == choice and type(value) is type(choice) for choice in args) else None
    if origin in (Union, UnionType):
        return next((match for arg in args if (match := _match(arg, value)) is not None), None)
    if origin is tuple:
        return _match_tuple(args, value)
    if annotation is float and isinstance(value, (int, float)) and not isinstance(value, bool):
        return float(value) if math.isfinite(value) else None
    return value if type(value) is annotation else None


def _match_tuple(args: tuple[Any, ...], value: Any) -> tuple[Any, ...] | None:
    if not isinstance(value, (list, tuple)):
        return None
    types = (args[0],) * len(value) if args[-1] is Ellipsis else args
    if len(types) != len(value):
        return None
    items = tuple(_match(kind, item) for kind, item in zip(types, value, strict=True))
    return None if None in items else items


def _describe(annotation: Any) -> str:
    origin, args = get_origin(annotation), get_args(annotation)
    if origin is Literal:
        return f"one of {', '.join(map(str, args))}" if len(args) > 1 else repr(*args)
    if origin in (Union, UnionType):
        return " or ".join(_describe(arg) for arg in args if not hasattr(arg, "array_type"))  # which nobody can type
    if origin is tuple and args[-1] is Ellipsis:
        return f"a list, each item {_describe(args[0])}"
    if origin is tuple:
        return f"[{', '.join(_describe(arg) for arg in args)}]"
    return _PLAIN[annotation]


def _shown(value: Any) -> str:
    """As one would type it on the command line."""
    written = {"True": "true", "False": "false", "None": "null"}
    return written.get(str(value), str(plain(value)))


def of_python(value: Any) -> Any:
    """Scalars and arrays of NumPy and jax as the numbers and lists that they hold; anything else as it is."""
    return value.tolist() if hasattr(value, "tolist") and hasattr(value, "dtype") else value


def at_least(name: str, value: Any, smallest: int) -> int:
    """The value, which is an integer of at least that. Raises ValueError where it is not."""
    value = of_python(value)
    if type(value) is not int or value < smallest:
        raise ValueError(f"{name}={value} is not an integer of at least {smallest}")
    return value
