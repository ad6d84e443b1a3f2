"""Sum a function of rows over shards of them, with its gradient: each device takes its shards one after another, then `psum`.

A sum of few rows is one shard on one device.
"""

from collections.abc import Callable, Mapping
from functools import partial
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax.sharding import NamedSharding, PartitionSpec
from jaxtyping import Array, Float

SHARD = 1 << 19  # rows of the largest shard
_ROWS = PartitionSpec("shard")

Rows = Mapping[str, Any]  # columns [shards, rows of a shard, …]


def sharded(columns: Mapping[str, np.ndarray], weight: Float[np.ndarray, " N"]) -> Rows:
    """Cut columns [N, …] into shards of equal length over the devices; the last is filled with the first row, of weight 0."""
    number = -(-len(weight) // SHARD)
    devices = 1 if number == 1 else jax.local_device_count()
    number = -(-number // devices) * devices
    length = -(-len(weight) // number)
    place = NamedSharding(_mesh(devices), _ROWS)

    def cut(column: np.ndarray, rest: np.ndarray) -> Array:
        filled = np.empty((number * length, *column.shape[1:]), column.dtype)
        filled[: len(column)], filled[len(column) :] = column, rest
        return jax.device_put(filled.reshape(number, length, *column.shape[1:]), place)

    with jax.enable_x64(True):
        rows = {name: cut(column, column[:1]) for name, column in columns.items()}
        return {**rows, "weight": cut(weight, np.zeros(1))}


def summed(term: Callable[[Any, Rows], Float[Array, ""]], parameters: Any, rows: Rows) -> Float[Array, ""]:
    """Σ over the shards of term(parameters, shard). The gradient is of the parameters alone."""
    return jnp.asarray(_summed(term, parameters, rows))


@partial(jax.custom_vjp, nondiff_argnums=(0,))
def _summed(term: Callable[[Any, Rows], Float[Array, ""]], parameters: Any, rows: Rows) -> Float[Array, ""]:
    return _over_shards(term, parameters, rows)


def _with_gradient(term: Callable[[Any, Rows], Float[Array, ""]], parameters: Any, rows: Rows) -> tuple[Array, Any]:
    return _over_shards(jax.value_and_grad(term), parameters, rows)


def _gradient(_: Any, gradient: Any, of_sum: Float[Array, ""]) -> tuple[Any, None]:
    return jax.tree.map(lambda leaf: of_sum * leaf, gradient), None


_summed.defvjp(_with_gradient, _gradient)


def _over_shards(of: Callable[[Any, Rows], Any], parameters: Any, rows: Rows) -> Any:
    def on_device(parameters: Any, rows: Rows) -> Any:
        def add(total: Any, shard: Rows) -> tuple[Any, None]:
            return jax.tree.map(jnp.add, total, of(parameters, shard)), None

        shape = jax.eval_shape(of, parameters, jax.tree.map(lambda leaf: leaf[0], rows))
        zero = jax.tree.map(lambda leaf: jnp.zeros(leaf.shape, leaf.dtype), shape)
        return jax.lax.psum(jax.lax.scan(add, zero, rows)[0], "shard")

    number = len(rows["weight"])
    devices = max(count for count in range(1, jax.local_device_count() + 1) if number % count == 0)
    run = jax.shard_map(
        on_device, mesh=_mesh(devices), in_specs=(PartitionSpec(), _ROWS), out_specs=PartitionSpec(), check_vma=False
    )
    return run(parameters, rows)


def _mesh(devices: int) -> jax.sharding.Mesh:
    return jax.sharding.Mesh(np.array(jax.local_devices()[:devices]), ("shard",))
