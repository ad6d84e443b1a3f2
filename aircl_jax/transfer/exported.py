"""State a run's learned functions for export: a function of a batch each, its inputs and outputs with names and units."""

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from aircl_jax.algorithm.scoring import trajectory_feasibility
from aircl_jax.model.networks import BoundNetworks
from aircl_jax.runs.result import Result
from aircl_jax.transfer.judges import step_delta
from aircl_jax.types import Trajectory
from envs import Box, Coordinates

BATCH = "b"  # the symbolic size of every first axis
_LEARNED = "of the learned reward; its constant, and where docs/equations.md says so its shaping, are free"


class Slot(NamedTuple):
    """One input or output: its axes after the batch, its type, what it is and in which unit."""

    name: str
    shape: tuple[int, ...]
    dtype: str
    unit: str


class Exportable(NamedTuple):
    """A function of batches [b, …] of its inputs."""

    name: str
    call: Callable[..., Any]
    about: str
    inputs: tuple[Slot, ...]
    outputs: tuple[Slot, ...]


def exportables(result: Result, index: int) -> list[Exportable]:
    """List what one seed of a run has learned: policy, reward, δ₁ and δ̄, as far as its method learns them."""
    nets, horizon = result.bound(index), result.spec.env.horizon
    method = nets.method
    obs, action = _observed(result), _acted(result)
    found = [_policy(nets, obs, action)]
    if method.learns_reward:
        one = Slot("reward", (), "float32", _LEARNED)
        found.append(Exportable("reward", jax.vmap(nets.reward), "f(s, a)", (obs, action), (one,)))
    if method.tests_steps:
        of_entries = method.tests_entries
        about = "δ₁ of entering s, whatever the action" if of_entries else "δ₁(s, a); below ½ counts as forbidden"
        one = Slot("step_feasibility", (), "float32", "between 0 and 1")
        found.append(Exportable("step_feasibility", jax.vmap(step_delta(nets)), about, (obs, action), (one,)))
    if method.learns_feasibility:
        whole = (
            *(_along(slot, horizon) for slot in (obs, action)),
            Slot("mask", (horizon,), "float32", "1 up to the last step"),
        )
        one = Slot("feasibility", (), "float32", "between 0 and 1")
        about = "δ̄(τ) of whole trajectories of the world's horizon"
        found.append(Exportable("feasibility", _feasibility(nets), about, whole, (one,)))
    return found


def fresh_inputs(result: Result, function: Exportable, number: int, seed: int) -> tuple[np.ndarray, ...]:
    """Draw inputs around the demonstrations, some far from them, and actions all over their space."""
    random, space = np.random.default_rng(seed), result.spec.env.action_space
    steps = np.asarray(result.expert.obs[0]).reshape(-1, result.spec.env.obs_size)
    drawn = []
    for slot in function.inputs:
        shape = (number, *slot.shape)
        if slot.name == "obs":
            seen = steps[random.integers(len(steps), size=shape[:-1])]
            drawn.append(seen + random.normal(size=shape) * steps.std(axis=0) * _is_measured(steps))
        elif slot.name == "action" and isinstance(space, Box):
            low, high = (space.low, space.high) if space.is_bounded else (-2.0, 2.0)
            drawn.append(random.uniform(low, high, size=shape))
        elif slot.name == "mask":
            drawn.append(np.arange(slot.shape[0]) < random.integers(1, slot.shape[0] + 1, size=(number, 1)))
        else:
            drawn.append(random.integers(result.spec.env.horizon if slot.name == "t" else space.feature_size, size=shape))
    return tuple(values.astype(slot.dtype) for values, slot in zip(drawn, function.inputs, strict=True))


def _is_measured(steps: np.ndarray) -> bool:
    """Whether observations are numbers, and not one-hot of cells or codes."""
    return not np.isin(steps, (0.0, 1.0)).all()


def _policy(nets: BoundNetworks, obs: Slot, action: Slot) -> Exportable:
    """π(·|s): mean and standard deviation in a Box, log-probabilities of numbered actions."""
    timed = nets.env.finite_horizon or nets.networks.plans
    inputs = (obs, Slot("t", (), "int32", "steps since the reset")) if timed else (obs,)
    if isinstance(nets.env.action_space, Box):
        outputs: Sequence[Slot] = (action._replace(name="mean"), action._replace(name="std"))
        about = f"π(·|s), a Gaussian; {_clipping(nets)}"
    else:
        outputs = (Slot("log_prob", (nets.env.action_space.n,), "float32", "natural logarithm of a probability"),)
        about = "log π(a|s) of every action"

    def one(seen: Array, t: Array) -> Any:
        policy: Any = nets.policy(seen, t)
        if isinstance(nets.env.action_space, Box):
            return policy.mean(), policy.stddev()
        return jax.nn.log_softmax(policy.logits)

    call = jax.vmap(one) if timed else jax.vmap(lambda seen: one(seen, jnp.asarray(0)))
    return Exportable("policy", call, about, inputs, tuple(outputs))


def _clipping(nets: BoundNetworks) -> str:
    """Say to what a draw is clipped: by the world, or to learned limits of actions."""
    own, space = nets.params.policy["params"], nets.env.action_space
    if "lower" not in own or not isinstance(space, Box):
        return "the world clips what is drawn"
    ends = (np.clip(space.from_half_widths(own[side]), space.low, space.high) for side in ("lower", "upper"))
    low, high = ([round(float(limit), 6) for limit in end] for end in ends)
    return f"clip what is drawn to the learned limits, from {low} to {high}; the mean is clipped"


def _feasibility(nets: BoundNetworks) -> Callable[[Array, Array, Array], Array]:
    def of(obs: Array, action: Array, mask: Array) -> Array:
        nothing = jnp.zeros_like(mask)
        trajectories = Trajectory(obs, action, nothing, nothing, nothing, nothing, mask, nothing[:, 0])
        return jnp.exp(trajectory_feasibility(nets, trajectories))

    return of


def _observed(result: Result) -> Slot:
    env = result.spec.env
    units = env.view.units if isinstance(env.view, Coordinates) else ()
    named = [f"{name}, {unit}" for name, unit in zip(env.coordinate_names, units, strict=True)] if units else []
    return Slot("obs", (env.obs_size,), "float32", "; ".join(named) or "as the world shows it, not normalised")


def _acted(result: Result) -> Slot:
    env = result.spec.env
    if isinstance(env.action_space, Box):
        low, high = env.action_space.low, env.action_space.high
        return Slot("action", env.action_space.shape, "float32", f"{', '.join(env.motor_names)}, each from {low:g} to {high:g}")
    return Slot("action", (), "int32", f"0 to {env.action_space.n - 1}")


def _along(slot: Slot, horizon: int) -> Slot:
    return slot._replace(shape=(horizon, *slot.shape))
