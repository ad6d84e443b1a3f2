"""Pool the evidence of tasks that are trained side by side, each with a reward of its own and all under one constraint."""

from dataclasses import dataclass
from typing import TypeVar

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

T = TypeVar("T")
TASKS = "tasks"  # the axis of the vmap over tasks


@dataclass(frozen=True)
class Pool:
    """What the tasks tell each other in a fused step under `vmap(…, axis_name=TASKS)`; alone, a task hears itself.

    Every function is of a tree with the numbers of one task, and returns the same tree in all of them.
    """

    tasks: int = 1

    def total(self, tree: T) -> T:
        """Sum over tasks."""
        return jax.lax.psum(tree, TASKS) if self.tasks > 1 else tree

    def least(self, tree: T) -> T:
        return jax.lax.pmin(tree, TASKS) if self.tasks > 1 else tree

    def greatest(self, tree: T) -> T:
        return jax.lax.pmax(tree, TASKS) if self.tasks > 1 else tree

    def first(self, tree: T) -> T:
        """Return the first task's."""
        return jax.tree.map(lambda leaf: jax.lax.all_gather(leaf, TASKS)[0], tree) if self.tasks > 1 else tree

    def mean(self, values: Float[Array, "*B"], weight: Float[Array, ""]) -> Float[Array, "*B"]:
        """Average over tasks, each with its weight."""
        return self.total(values * (weight / self.total(weight))) if self.tasks > 1 else values

    def every(self, condition: Bool[Array, ""]) -> Bool[Array, ""]:
        """Say whether it holds in all tasks."""
        return self.least(condition.astype(jnp.float32)) > 0 if self.tasks > 1 else condition


ALONE = Pool()
