"""Write a learned function as an ONNX graph: its jaxpr, primitive by primitive; what no input reaches becomes a constant."""

from collections.abc import Callable, Mapping, Sequence
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import export
from jax.extend.core import Literal

from aircl_jax.transfer.exported import BATCH, Exportable

OPSET, IR_VERSION = 18, 10
MISSING = "this needs the packages onnx and onnxruntime, which are not installed; install aircl-jax[export]"
# fmt: off
_LIKE_OURS = {
    "add": "Add", "sub": "Sub", "mul": "Mul", "div": "Div", "max": "Max", "min": "Min", "pow": "Pow", "neg": "Neg",
    "exp": "Exp", "log": "Log", "tanh": "Tanh", "logistic": "Sigmoid", "abs": "Abs", "sqrt": "Sqrt", "sign": "Sign",
    "eq": "Equal", "gt": "Greater", "lt": "Less", "ge": "GreaterOrEqual", "le": "LessOrEqual",
    "and": "And", "or": "Or", "not": "Not", "stop_gradient": "Identity", "copy": "Identity",
}
# fmt: on
_CALLS = ("jit", "pjit", "closed_call", "custom_jvp_call", "custom_vjp_call", "checkpoint")  # of a function within, once
_REDUCTIONS = {"reduce_sum": "ReduceSum", "reduce_max": "ReduceMax", "reduce_min": "ReduceMin", "reduce_prod": "ReduceProd"}


class Named(NamedTuple):
    """A value that depends on an input: its name in the graph."""

    name: str


def onnx_model(function: Exportable) -> bytes:
    """Write a function of batches of any size as a model of ONNX.

    Raises ValueError, in one line, where onnx is missing, or the function does something that is not written here.
    """
    try:
        import onnx
    except ImportError as error:
        raise ValueError(MISSING) from error
    (size,) = export.symbolic_shape(BATCH)
    shapes = [jax.ShapeDtypeStruct((size, *slot.shape), jnp.dtype(slot.dtype)) for slot in function.inputs]
    closed = jax.jit(function.call).trace(*shapes).jaxpr
    graph = _Graph(onnx.helper, onnx.numpy_helper, function)
    values = graph.through(closed.jaxpr, closed.consts, [Named(slot.name) for slot in function.inputs])
    results = [
        onnx.helper.make_node("Identity", [graph.name(v)], [s.name]) for v, s in zip(values, function.outputs, strict=True)
    ]

    def told(slot: Any) -> Any:
        kind = onnx.helper.np_dtype_to_tensor_dtype(np.dtype(slot.dtype))
        return onnx.helper.make_tensor_value_info(slot.name, kind, [BATCH, *slot.shape])

    made = onnx.helper.make_graph(
        [*graph.nodes, *results], function.name, [*map(told, function.inputs)], [*map(told, function.outputs)], graph.constants
    )
    model = onnx.helper.make_model(
        made, opset_imports=[onnx.helper.make_opsetid("", OPSET)], ir_version=IR_VERSION, producer_name="aircl-jax"
    )
    onnx.checker.check_model(model, full_check=True)
    return model.SerializeToString()


class _Graph:
    """Nodes and constants so far. A value is an array where no input reaches it, else `Named`."""

    def __init__(self, helper: Any, arrays: Any, function: Exportable) -> None:
        self.helper, self.arrays, self.function = helper, arrays, function
        self.nodes: list[Any] = []
        self.constants: list[Any] = []

    def name(self, value: Any) -> str:
        """Name a value in the graph; an array becomes a constant of it."""
        if isinstance(value, Named):
            return value.name
        name = f"constant_{len(self.constants)}"
        self.constants.append(self.arrays.from_array(np.asarray(value), name))
        return name

    def op(self, kind: str, *values: Any, **attributes: Any) -> Named:
        """Append a node of one output."""
        name = f"{kind.lower()}_{len(self.nodes)}"
        self.nodes.append(self.helper.make_node(kind, [self.name(value) for value in values], [name], **attributes))
        return Named(name)

    def through(self, jaxpr: Any, consts: Sequence[Any], inputs: Sequence[Any]) -> list[Any]:
        """Put the equations of a jaxpr, called with these values, into the graph; return its outputs."""
        found = dict(zip([*jaxpr.constvars, *jaxpr.invars], [*consts, *inputs], strict=True))
        needed = _needed(jaxpr)
        for equation in jaxpr.eqns:
            if not needed & set(equation.outvars):
                continue
            values = [_value(one, found) for one in equation.invars]
            outputs = self.of(equation, values)
            found.update(zip(equation.outvars, outputs, strict=True))
        return [_value(one, found) for one in jaxpr.outvars]

    def of(self, equation: Any, values: list[Any]) -> list[Any]:
        """Put one equation into the graph, or work it out where it depends on no input."""
        kind = equation.primitive.name
        if kind in _CALLS:
            inner = equation.params.get("jaxpr", equation.params.get("call_jaxpr"))
            closed = hasattr(inner, "consts")
            return self.through(inner.jaxpr if closed else inner, inner.consts if closed else (), values)
        fixed = all(isinstance(size, int) for out in equation.outvars for size in out.aval.shape)
        if fixed and not any(isinstance(value, Named) for value in values):
            made = equation.primitive.bind(*map(jnp.asarray, values), **equation.params)
            return list(made) if equation.primitive.multiple_results else [made]
        if kind in _LIKE_OURS:
            return [self.op(_LIKE_OURS[kind], *values)]
        if kind in _REDUCTIONS:
            return [self.op(_REDUCTIONS[kind], values[0], _integers(equation.params["axes"]), keepdims=0)]
        if kind not in _OTHERS:
            raise ValueError(f"{self.function.name} uses {kind}, which is not written as ONNX; its StableHLO has it")
        return [_OTHERS[kind](self, equation, values)]

    def shape(self, shape: Sequence[Any]) -> Any:
        """Give a shape, whose sizes may be that of the batch, as a vector."""
        if all(isinstance(size, int) for size in shape):
            return _integers(shape)
        others = [size for size in shape if not isinstance(size, int) and str(size) != BATCH]
        if others:
            raise ValueError(
                f"{self.function.name} has an axis of {others[0]}, which is not written as ONNX; its StableHLO has it"
            )
        first = self.function.inputs[0].name
        batch = self.op("Shape", Named(first), start=0, end=1)
        return self.op("Concat", *(_integers([size]) if isinstance(size, int) else batch for size in shape), axis=0)


def _value(variable: Any, found: Mapping[Any, Any]) -> Any:
    """Return what a variable stands for; a literal in its own type, which a plain number of Python does not have."""
    if not isinstance(variable, Literal):
        return found[variable]
    kind: Any = variable.aval
    return np.asarray(variable.val, kind.dtype)


def _needed(jaxpr: Any) -> set[Any]:
    """Collect the variables that an output depends on."""
    needed = {one for one in jaxpr.outvars if not isinstance(one, Literal)}
    for equation in reversed(jaxpr.eqns):
        if needed & set(equation.outvars):
            needed |= {one for one in equation.invars if not isinstance(one, Literal)}
    return needed


def _integers(values: Sequence[Any]) -> np.ndarray:
    return np.array([int(value) for value in values], np.int64)


def _broadcast(graph: _Graph, equation: Any, values: list[Any]) -> Named:
    """Put the axes where they belong, then repeat."""
    shape, places = equation.outvars[0].aval.shape, [int(axis) for axis in equation.params["broadcast_dimensions"]]
    sizes: list[Any] = [1] * len(shape)
    for place, size in zip(places, equation.invars[0].aval.shape, strict=True):
        sizes[place] = size
    placed = graph.op("Reshape", values[0], graph.shape(sizes))
    return placed if sizes == list(shape) else graph.op("Expand", placed, graph.shape(shape))


def _product(graph: _Graph, equation: Any, values: list[Any]) -> Named:
    """Sum over the axes that both share: the batched ones first, then what is left of each."""
    (of_left, of_right), (with_left, with_right) = equation.params["dimension_numbers"]
    ranks = [len(one.aval.shape) for one in equation.invars]
    if ranks == [2, 2] and (tuple(of_left), tuple(of_right), tuple(with_left)) == ((1,), (0,), ()):
        return graph.op("MatMul", *values)
    letters = iter("abcdefghijklmnopqrstuvwxyz")
    left, right = ["" for _ in range(ranks[0])], ["" for _ in range(ranks[1])]
    for one, other in [*zip(with_left, with_right, strict=True), *zip(of_left, of_right, strict=True)]:
        left[one] = right[other] = next(letters)
    left, right = ([letter or next(letters) for letter in side] for side in (left, right))
    shared = [left[one] for one in with_left]
    free = [
        letter
        for side, gone in ((left, (*with_left, *of_left)), (right, (*with_right, *of_right)))
        for letter in _rest(side, gone)
    ]
    return graph.op("Einsum", *values, equation=f"{''.join(left)},{''.join(right)}->{''.join(shared + free)}")


def _rest(letters: Sequence[str], gone: Sequence[int]) -> list[str]:
    return [letter for place, letter in enumerate(letters) if place not in gone]


def _cast(graph: _Graph, equation: Any, values: list[Any]) -> Named:
    return graph.op("Cast", values[0], to=graph.helper.np_dtype_to_tensor_dtype(np.dtype(equation.params["new_dtype"])))


def _slice(graph: _Graph, equation: Any, values: list[Any]) -> Named:
    starts, limits, strides = (equation.params[name] for name in ("start_indices", "limit_indices", "strides"))
    axes = [axis for axis, limit in enumerate(limits) if isinstance(limit, int)]  # never of the batch, which is whole
    cuts = [[whole[axis] for axis in axes] for whole in (starts, limits)]
    steps = [1 if strides is None else strides[axis] for axis in axes]
    return graph.op("Slice", values[0], *map(_integers, (*cuts, axes, steps)))


_OTHERS: dict[str, Callable[[_Graph, Any, list[Any]], Named]] = {
    "broadcast_in_dim": _broadcast,
    "dot_general": _product,
    "convert_element_type": _cast,
    "slice": _slice,
    "ne": lambda graph, _, values: graph.op("Not", graph.op("Equal", *values)),
    "log1p": lambda graph, _, values: graph.op("Log", graph.op("Add", values[0], np.ones((), np.float32))),
    "square": lambda graph, _, values: graph.op("Mul", values[0], values[0]),
    "integer_pow": lambda graph, equation, values: graph.op("Pow", values[0], np.asarray(equation.params["y"], np.float32)),
    "select_n": lambda graph, _, values: graph.op("Where", values[0], values[2], values[1]),
    "clamp": lambda graph, _, values: graph.op("Min", graph.op("Max", values[1], values[0]), values[2]),
    "reshape": lambda graph, equation, values: graph.op("Reshape", values[0], graph.shape(equation.outvars[0].aval.shape)),
    "squeeze": lambda graph, equation, values: graph.op("Squeeze", values[0], _integers(equation.params["dimensions"])),
    "transpose": lambda graph, equation, values: graph.op(
        "Transpose", values[0], perm=[*map(int, equation.params["permutation"])]
    ),
    "concatenate": lambda graph, equation, values: graph.op("Concat", *values, axis=int(equation.params["dimension"])),
}
