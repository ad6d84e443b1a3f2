"""Any Brax or MuJoCo Playground environment with a cost predicate, as an `Env`.

    from brax import envs
    env = adapt(envs.get_environment("hopper"), lambda state, action: jnp.abs(action).max() > 0.5, horizon=500)

Brax's and Playground's states carry different fields, but both have `obs`, `reward` and `done`, and actions in [−1, 1].
"""

from collections.abc import Callable, Iterator, Mapping
from typing import Any, Literal

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, PRNGKeyArray

from envs.base import Box, Env, Step
from envs.checks import check_predicate

# Words in the names of wrappers that reset within an episode, cut it off, or batch it.
WRAPPERS = ("AutoReset", "Episode", "Vmap", "Eval", "DomainRandomization")


def _layers(world: Any) -> Iterator[str]:
    """Name the wrappers around a world, the outermost first."""
    while hasattr(world, "env"):
        yield type(world).__name__
        world = world.env


def adapt(
    world: Any,
    violated: Callable[[Any, Float[Array, " A"]], Bool[Array, ""]],
    horizon: int,
    terminate: bool = False,
    constraint_input: Literal["state", "action", "state_action"] = "state_action",
    observation: str = "",
) -> Env:
    """`violated(state after the step, clipped action)` is the cost; `observation` names which is seen of several by name.

    Raises ValueError for a wrapped world, for observations that are no vector, and for a predicate that gives no true or false.
    """
    if wrapped := [name for name in _layers(world) if any(word in name for word in WRAPPERS)]:
        raise ValueError(
            f"{type(world.unwrapped).__name__} is wrapped in {', '.join(wrapped)}, whose resets and time limits would end "
            "episodes; choose the world itself, as in brax.envs.get_environment(name)"
        )
    box = Box(world.action_size)
    begun = jax.eval_shape(world.reset, jax.random.key(0))
    see = _seeing(type(world).__name__, begun.obs, observation)
    check_predicate("violated", violated, begun, jax.ShapeDtypeStruct((world.action_size,), jnp.float32))

    def reset(key: PRNGKeyArray) -> tuple[Any, Float[Array, " O"]]:
        state = world.reset(key)
        return state, see(state)

    def step(key: PRNGKeyArray, state: Any, action: Float[Array, " A"]) -> tuple[Any, Step]:
        """One step; the key is for worlds with noise of their own making, and Brax's keep theirs in the state."""
        action = box.clip(action)
        after = world.step(state, action)
        sound = jnp.isfinite(see(after)).all() & jnp.isfinite(after.reward)
        after = jax.tree.map(lambda new, old: jnp.where(sound, new, old), after, state)
        fallen = after.done > 0 if terminate else jnp.zeros((), bool)
        return after, Step(
            obs=see(after),
            reward=jnp.where(sound, after.reward, 0.0),
            cost=(sound & violated(after, action)).astype(jnp.float32),
            terminated=(~sound | fallen).astype(jnp.float32),
        )

    return Env(
        name=type(world).__name__.lower(),
        horizon=horizon,
        obs_size=see(begun).size,
        action_space=box,
        reset=reset,
        step=step,
        constraint_input=constraint_input,
    )


def _seeing(whose: str, obs: Any, name: str) -> Callable[[Any], Any]:
    """How to read the one vector that is seen of a state. Raises ValueError where the name is missing, or is none."""
    named = isinstance(obs, Mapping)
    if named and name not in obs:
        raise ValueError(f"observations of {whose} have names; choose observation from {', '.join(obs)}")
    if name and not named:
        raise ValueError(f"observation={name}: those of {whose} have no names; leave it out")
    if len(getattr(obs[name] if named else obs, "shape", ())) != 1:
        raise ValueError(f"observations of {whose} are no vector; choose an env with one")
    return (lambda state: state.obs[name]) if named else (lambda state: state.obs)
