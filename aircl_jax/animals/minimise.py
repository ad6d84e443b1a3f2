"""Minimise a smooth function by optax's L-BFGS until its gradient vanishes, in double precision."""

from collections.abc import Callable
from functools import partial
from typing import Any, TypeVar

import jax
import jax.numpy as jnp
import optax
from jax.flatten_util import ravel_pytree
from jaxtyping import Array, Float

Parameters = TypeVar("Parameters")

PRECISION = 1e-3  # largest entry of the gradient at the end, in nats per unit of a parameter
MOST_STEPS = 1000
MEMORY = 20  # pairs of steps and gradients that L-BFGS keeps


def minimise(
    loss: Callable[[Any, Any], Float[Array, ""]],
    start: Parameters,
    data: Any,
    precision: float = PRECISION,
    most: int = MOST_STEPS,
) -> tuple[Parameters, float]:
    """Find the parameters of the least loss(parameters, data); return them with the largest entry of the last gradient.

    One function is compiled for each `loss` and each shape of `data`, so subsets are better given as weights.
    """
    with jax.enable_x64(True):
        double = jax.tree.map(partial(jnp.asarray, dtype=jnp.float64), start)
        found, gradient = _descend(loss, double, jax.tree.map(jnp.asarray, data), precision, most)
        return jax.device_get(found), float(gradient)


@partial(jax.jit, static_argnums=0)
def _descend(loss: Callable[..., Any], start: Any, data: Any, precision: Any, most: Any) -> tuple[Any, Float[Array, ""]]:
    flat, unravel = ravel_pytree(start)
    solver = optax.lbfgs(memory_size=MEMORY)

    def of_point(point: Float[Array, " K"]) -> Float[Array, ""]:
        return loss(unravel(point), data)

    value_and_gradient = optax.value_and_grad_from_state(of_point)

    def goes_on(carry: tuple[Any, Any, Any, Any]) -> Any:
        _, _, number, steepest = carry
        return (number == 0) | ((number < most) & (steepest > precision))

    def step(carry: tuple[Any, Any, Any, Any]) -> tuple[Any, Any, Any, Any]:
        point, state, number, _ = carry
        value, gradient = value_and_gradient(point, state=state)
        change, state = solver.update(gradient, state, point, value=value, grad=gradient, value_fn=of_point)
        point = optax.apply_updates(point, change)
        return point, state, number + 1, jnp.abs(optax.tree_utils.tree_get(state, "grad")).max()

    point, _, _, steepest = jax.lax.while_loop(goes_on, step, (flat, solver.init(flat), 0, jnp.inf))
    return unravel(point), steepest
