"""Find indices beyond an array's end in traced functions: where NumPy would raise an error, jax takes the nearest entry."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any, SupportsIndex

import jax
import numpy as np
from jax.extend.core import ClosedJaxpr, Jaxpr, Literal

# How constants that become indices are computed, on numbers and arrays of NumPy.
_ARITHMETIC: Mapping[str, Callable[..., Any]] = {
    "add": np.add,
    "sub": np.subtract,
    "mul": np.multiply,
    "lt": np.less,
    "ge": np.greater_equal,
    "max": np.maximum,
    "min": np.minimum,
    "select_n": lambda which, *cases, **_: np.where(which, cases[1], cases[0]),
    "convert_element_type": lambda x, new_dtype, **_: np.asarray(x).astype(new_dtype),
    "broadcast_in_dim": lambda x, shape, broadcast_dimensions, **_: _broadcast(np.asarray(x), shape, broadcast_dimensions),
    "reshape": lambda x, new_sizes, **_: np.reshape(x, new_sizes),
    "squeeze": lambda x, dimensions, **_: np.squeeze(x, tuple(dimensions)),
    "concatenate": lambda *parts, dimension, **_: np.concatenate(parts, dimension),
}


def first_beyond(jaxpr: ClosedJaxpr) -> str | None:
    """Name the first constant index that lies beyond its axis; None where there is none."""
    return next(_beyond(jaxpr.jaxpr, dict(zip(jaxpr.jaxpr.constvars, jaxpr.consts, strict=True))), None)


def _beyond(jaxpr: Jaxpr, known: dict[Any, Any]) -> Iterator[str]:
    """Follow the constants through a program; `known` holds their values, and those that are computed of them."""
    for equation in jaxpr.eqns:
        values = [of.val if isinstance(of, Literal) else known.get(of) for of in equation.invars]
        name = equation.primitive.name
        if name in ("gather", "dynamic_slice"):
            yield from _of_a_read(name, equation, values)
        for inner in _programs(equation.params):
            if len(inner.jaxpr.invars) == len(values):
                inside: dict[Any, Any] = dict(zip(inner.jaxpr.invars, values, strict=True))
                inside |= dict(zip(inner.jaxpr.constvars, inner.consts, strict=True))
                yield from _beyond(inner.jaxpr, inside)
                if len(inner.jaxpr.outvars) == len(equation.outvars):
                    results = [of.val if isinstance(of, Literal) else inside.get(of) for of in inner.jaxpr.outvars]
                    known |= dict(zip(equation.outvars, results, strict=True))
                break
        if name in _ARITHMETIC and all(value is not None for value in values):
            known[equation.outvars[0]] = _computed(name, values, equation.params)


def _of_a_read(name: str, equation: Any, values: Sequence[Any]) -> Iterator[str]:
    shape = equation.invars[0].aval.shape
    sizes = equation.params["slice_sizes"]
    if name == "gather":
        axes, starts = equation.params["dimension_numbers"].start_index_map, values[1]
        starts = None if starts is None else np.moveaxis(np.asarray(starts), -1, 0)
    else:
        axes, starts = range(len(shape)), values[1:]
    if starts is None:
        return
    for axis, start in zip(axes, starts, strict=True):
        last = shape[axis] - sizes[axis]
        if start is not None and (wrong := np.asarray(start)[(np.asarray(start) < 0) | (np.asarray(start) > last)]).size:
            yield f"index {int(wrong.ravel()[0])} of an axis of {shape[axis]}"


def _programs(params: Mapping[str, Any]) -> Iterator[ClosedJaxpr]:
    for value in params.values():
        if isinstance(value, ClosedJaxpr):
            yield value


def _computed(name: str, values: Sequence[Any], params: Mapping[str, Any]) -> Any:
    if any(jax.dtypes.issubdtype(np.asarray(value).dtype, np.floating) for value in values):
        return None  # no index
    compute = _ARITHMETIC[name]
    return compute(*values) if isinstance(compute, np.ufunc) else compute(*values, **params)


def _broadcast(x: np.ndarray, shape: Sequence[int], dimensions: Sequence[SupportsIndex]) -> np.ndarray:
    aligned = np.ones(len(shape), int)
    aligned[[int(dimension) for dimension in dimensions]] = x.shape
    return np.broadcast_to(x.reshape(aligned), shape)
