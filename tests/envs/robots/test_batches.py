"""Many environments are one computation of the planar engine, however they were batched."""

import jax
import jax.numpy as jnp
import numpy as np

from envs.robots.planar import dynamics


def test_every_axis_of_nested_vmaps_is_environments() -> None:
    """Seeds × rollouts are steps of as many environments, in one call of the engine, in their own order."""
    sizes = []

    def many(qpos: jax.Array, push: jax.Array) -> tuple[jax.Array, jax.Array]:
        sizes.append(qpos.shape)
        return qpos + 10.0 * push, qpos * push[:1]

    qpos, push = jnp.arange(24.0).reshape(2, 4, 3), jnp.arange(2.0).reshape(2, 1) + 1.0  # a push of each seed's own
    one = dynamics._of_one(many)  # pyright: ignore[reportPrivateUsage]
    moved, product = jax.vmap(jax.vmap(one, in_axes=(0, None)), in_axes=(0, 0))(qpos, push)
    assert sizes[-1] == (3, 8)
    np.testing.assert_allclose(moved, qpos + 10.0 * push[:, None])
    np.testing.assert_allclose(product, qpos * push[:, None])
