"""Symmetric matrices over a planar body's joints: only entries between joints of one branch can differ from 0.

The last axis of every array is that of N environments.
"""

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from envs.robots.planar.chain import Chain

Joints = Float[Array, "V N"]
Entries = Float[Array, "P N"]  # those of `Chain.pairs`


def diagonal(chain: Chain, values: Float[Array | np.ndarray, "V #N"]) -> Float[Array, "P #N"]:
    """Make the matrix with these values on its diagonal."""
    on = [[float(j == i == joint) for joint in range(chain.turn.size)] for j, i in chain.pairs]
    return jnp.array(on) @ values


def times(chain: Chain, matrix: Entries, vector: Joints) -> Joints:
    """Multiply a matrix and a vector."""
    joints = range(chain.turn.size)
    lower = jnp.array([[float(j == joint) for j, _ in chain.pairs] for joint in joints])
    upper = jnp.array([[float(i == joint != j) for j, i in chain.pairs] for joint in joints])
    below, above = np.array(chain.pairs).T
    return lower @ (matrix * vector[above]) + upper @ (matrix * vector[below])


def solve(chain: Chain, matrix: Entries, vector: Joints) -> Joints:
    """Solve matrix · x = vector. Elimination starts at the leaves, so that no zero fills in (Featherstone, section 6.5)."""
    left, right = dict(zip(chain.pairs, matrix, strict=True)), list(vector)
    above = [[i for j, i in chain.pairs if j == k != i] for k in range(len(right))]
    inverse = {}
    for k in reversed(range(len(right))):
        inverse[k] = 1 / left[k, k]
        for i in above[k]:
            ratio = left[k, i] * inverse[k]
            for j in [*above[i], i]:
                left[i, j] = left[i, j] - ratio * left[k, j]
            right[i] = right[i] - ratio * right[k]
    answer: list[Float[Array, " N"]] = []
    for k, known in enumerate(right):
        answer.append((known - sum(left[k, i] * answer[i] for i in above[k])) * inverse[k])
    return jnp.stack(answer)
