"""Count the arithmetic of a function, its matrix products by shape, and time those products alone."""

from collections import Counter
from collections.abc import Callable, Iterator
from math import prod
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jax.extend.core import ClosedJaxpr, Jaxpr

MOVES = {
    *("broadcast_in_dim", "concatenate", "convert_element_type", "copy", "dynamic_slice", "dynamic_update_slice", "gather"),
    *("iota", "pad", "reshape", "rev", "select_n", "slice", "split", "squeeze", "transpose"),
}
AT_ONCE = 2e7  # operations of a timing, for one small product is faster than the clock


class Product(NamedTuple):
    """A matrix product, as `jax.lax.dot_general` takes it."""

    left: tuple[int, ...]
    right: tuple[int, ...]
    dimensions: Any  # ((contracted of left, of right), (batched of left, of right))

    @property
    def operations(self) -> int:
        """2 × M × N × K × batch: multiplications and additions."""
        (contracted, of_right), (_, batched) = self.dimensions
        columns = prod(size for axis, size in enumerate(self.right) if axis not in (*of_right, *batched))
        return 2 * prod(self.left) * columns if contracted else prod(self.left) * columns


class Arithmetic(NamedTuple):
    """How often each product is computed, and the other operations: one for each number that any other step computes.

    A sum so counts as its result alone; of a robot's step these are few.
    """

    products: Counter[Product]
    others: int

    @property
    def operations(self) -> int:
        return self.others + sum(product.operations * times for product, times in self.products.items())


def arithmetic(function: Callable[..., Any], *inputs: Any) -> Arithmetic:
    """Count the operations of a function as written, loops included; what merely moves numbers is not counted.

    XLA's own `cost_analysis` counts the body of a loop once, however often it runs. Here a `scan` counts as often as it runs,
    the greatest branch of a `cond` once, and a `while` once.
    """
    return _of_program(jax.make_jaxpr(function)(*inputs).jaxpr)


def bare_seconds(products: Counter[Product], timed: Callable[..., tuple[Any, float]]) -> float:
    """Time the products alone, each in a loop over numbers of its own, whose cost the smallest ones feel."""
    seconds = 0.0
    for product, times in products.items():
        count = max(1, int(AT_ONCE / product.operations))
        left, right = (jnp.full((count, *shape), 0.5, jnp.float32) for shape in (product.left, product.right))

        def multiply(pairs: Any, product: Product = product) -> Any:
            return jax.lax.map(lambda pair: jax.lax.dot_general(pair[0], pair[1], product.dimensions), pairs)

        seconds += times * timed(multiply, (left, right))[1] / count
    return seconds


def _of_program(program: Jaxpr) -> Arithmetic:
    products: Counter[Product] = Counter()
    others = 0
    for equation in program.eqns:
        name, params = equation.primitive.name, equation.params
        if name == "dot_general":
            left, right = (_shape(variable) for variable in equation.invars)
            product = Product(left, right, params["dimension_numbers"])
            if product.operations:
                products[product] += 1
            continue
        inner = [_of_program(each) for each in _programs(params)]
        if not inner:
            others += 0 if name in MOVES else sum(prod(_shape(variable)) for variable in equation.outvars)
            continue
        times = params["length"] if name == "scan" else 1
        for part in [max(inner, key=lambda part: part.operations)] if name == "cond" else inner:
            products.update({product: times * number for product, number in part.products.items()})
            others += times * part.others
    return Arithmetic(products, others)


def _programs(params: dict[str, Any]) -> Iterator[Jaxpr]:
    """The programs that an operation calls."""
    for value in params.values():
        for each in value if isinstance(value, tuple | list) else (value,):
            if isinstance(each, ClosedJaxpr):
                yield each.jaxpr
            elif isinstance(each, Jaxpr):
                yield each


def _shape(variable: Any) -> tuple[int, ...]:
    return tuple(getattr(variable.aval, "shape", ()))
