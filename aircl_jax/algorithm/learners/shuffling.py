"""Shuffle the steps of an iteration, without the cost of `jax.random.permutation`, which sorts pairs."""

import jax
import jax.numpy as jnp
from jaxtyping import Array, Int, PRNGKeyArray


def shuffled(key: PRNGKeyArray, number: int) -> Int[Array, " number"]:
    """Draw an order of 0, …, number − 1 by one sort of words that hold random bits and, below them, the number itself.

    Where two words have the same random bits, of which there are 32 − log₂ `number`, the smaller number comes first.
    """
    low = (number - 1).bit_length()
    words = (jax.random.bits(key, (number,), jnp.uint32) >> low << low) | jnp.arange(number, dtype=jnp.uint32)
    return (jnp.sort(words) & jnp.uint32((1 << low) - 1)).astype(jnp.int32)
