"""Brax's PPO on a world of ours: the wrapper, two sets of settings, and the episodes of what it trained."""

import importlib
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax.sharding import Mesh, NamedSharding, PartitionSpec
from jaxtyping import Array, Float, PRNGKeyArray

from aircl_jax.console import EXTRA
from envs import Box, Env

# Of Brax's own notebook (notebooks/training.ipynb) for the half-cheetah, where it trains for 50 million steps. There is none
# for the hopper by PPO, so it has the same.
NOTEBOOK: Mapping[str, Any] = {
    "reward_scaling": 1.0,
    "normalize_observations": True,
    "action_repeat": 1,
    "unroll_length": 20,
    "num_minibatches": 32,
    "num_updates_per_batch": 8,
    "discounting": 0.95,
    "learning_rate": 3e-4,
    "entropy_cost": 1e-3,
    "num_envs": 2048,
    "batch_size": 512,
}
# The same with an eighth of the environments and of the batch: eight times as many updates in as many steps.
EIGHTH = {**NOTEBOOK, "num_envs": 256, "batch_size": 64}

Act = Callable[[Float[Array, " O"], PRNGKeyArray], Float[Array, " A"]]  # what is drawn where this is seen


def brax_ppo() -> Any:
    """Import Brax's PPO. Raises ValueError, in one line, where Brax is not installed."""
    try:
        return importlib.import_module("brax.training.agents.ppo.train")
    except ImportError as error:
        raise ValueError(f"beside=brax needs the package brax, which is not installed; {EXTRA}brax]") from error


def train_ppo(world: Env, steps: int, seed: int, settings: Mapping[str, Any]) -> tuple[Act, int]:
    """Train for at least `steps` steps; return the policy, which draws its actions, and the steps that were taken."""
    ppo = brax_ppo()
    with _with_replication():
        make_policy, params, _ = ppo.train(
            wrapped(world), num_timesteps=steps, episode_length=world.horizon, seed=seed, run_evals=False, **settings
        )
    each = settings["batch_size"] * settings["unroll_length"] * settings["num_minibatches"]
    policy = make_policy(jax.device_get(params))
    return lambda seen, key: policy(seen, key)[0], each * -(-steps // each)


@contextmanager
def _with_replication() -> Iterator[None]:
    """Give jax the `device_put_replicated` that Brax 0.14 calls, where, as in jax 0.10, it has none."""
    if hasattr(jax, "device_put_replicated"):
        yield
        return
    setattr(jax, "device_put_replicated", _replicated)  # noqa: B010
    try:
        yield
    finally:
        delattr(jax, "device_put_replicated")


def _replicated(tree: Any, devices: Sequence[Any]) -> Any:
    """Put a copy on each device, with a leading axis of devices."""
    place = NamedSharding(Mesh(np.asarray(devices), ("device",)), PartitionSpec("device"))
    copies = jax.tree.map(lambda leaf: jnp.broadcast_to(jnp.asarray(leaf), (len(devices), *jnp.shape(leaf))), tree)
    return jax.device_put(copies, place)


def wrapped(world: Env) -> Any:
    """Make an environment of Brax of a world whose actions are in [−1, 1]; its reward is the true one, and nothing else counts.

    Raises ValueError for other actions.
    """
    if not (isinstance(world.action_space, Box) and world.action_space.is_unit):
        raise ValueError(f"env={world.name}: Brax draws actions in [-1, 1]; choose a world of such a box")
    size = world.action_space.size
    base: Any = importlib.import_module("brax.envs.base")

    class Wrapped(base.Env):
        """One of ours as one of Brax's."""

        def reset(self, rng: Array) -> Any:
            own, later = jax.random.split(rng)
            state, obs = world.reset(own)
            zero = jnp.zeros(())
            return base.State(pipeline_state=state, obs=obs, reward=zero, done=zero, metrics={}, info={"key": later})

        def step(self, state: Any, action: Array) -> Any:
            own, later = jax.random.split(state.info["key"])
            after, result = world.step(own, state.pipeline_state, action)
            return state.replace(
                pipeline_state=after,
                obs=result.obs,
                reward=jnp.asarray(result.reward),
                done=jnp.asarray(result.terminated),
                info={**state.info, "key": later},
            )

        @property
        def observation_size(self) -> int:
            return world.obs_size

        @property
        def action_size(self) -> int:
            return size

        @property
        def backend(self) -> str:
            return world.name

    return Wrapped()


def returns_of(world: Env, act: Act, number: int, key: PRNGKeyArray) -> Float[Array, " N"]:
    """Play episodes of a policy; return Σ_t r_t of each, until it ends."""

    def one(key: PRNGKeyArray) -> Float[Array, ""]:
        key_reset, key_steps = jax.random.split(key)

        def step(carry: Any, key: PRNGKeyArray) -> tuple[Any, Array]:
            state, seen, alive = carry
            key_action, key_step = jax.random.split(key)
            after, result = world.step(key_step, state, act(seen, key_action))
            return (after, result.obs, alive * (1.0 - result.terminated)), alive * result.reward

        begun = (*world.reset(key_reset), jnp.ones(()))
        return jax.lax.scan(step, begun, jax.random.split(key_steps, world.horizon))[1].sum()

    return jax.jit(jax.vmap(one))(jax.random.split(key, number))
