"""Gather a robot's episodes for a picture: poses, violations and δ₁ by step, of demonstrations and of the learned policy."""

from collections.abc import Callable
from functools import partial
from typing import NamedTuple

import jax
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from aircl_jax.algorithm.rollout import rollouts
from aircl_jax.analysis.episodes import KEY_FIGURES
from aircl_jax.analysis.robot_poses import Body, Stage, joint_label, links, make_body, positions, unobserved
from aircl_jax.model.networks import Networks
from aircl_jax.runs.result import Result
from aircl_jax.types import TrainState, Trajectory
from envs import Limit


class Side(NamedTuple):
    """Episodes of one origin. Entry t belongs to the pose at step t."""

    name: str
    links: Float[np.ndarray, "E T G 2 2"]  # m
    across: Float[np.ndarray, "E T"]  # x, as the constraint means it, m
    violating: Bool[np.ndarray, "E T"]
    level: Float[np.ndarray, "E T"] | None  # value of the quantity that the constraint bounds
    delta: Float[np.ndarray, "E T"] | None  # δ₁; None where the method has no per-step factor
    feasibility: Float[np.ndarray, " E"] | None  # δ̄(τ); None where the method has none
    returns: Float[np.ndarray, " E"]  # true, undiscounted; NaN where unknown
    violation_rate: Float[np.ndarray, " E"]  # NaN where the cost is unknown
    length: Int[np.ndarray, " E"]  # unmasked steps


class Scene(NamedTuple):
    """The content of a picture of a run's behaviour."""

    title: str
    stage: Stage
    expert: Side
    learned: Side
    quantity: str  # name of what the constraint bounds; empty where no line can be drawn
    limits: tuple[float, ...]  # limits of the quantity
    wall: float | None  # the limit, where it is a place along x
    note: str  # says which positions were reconstructed; empty where none was


class Quantity(NamedTuple):
    """What the constraint bounds: its name, its limits, and its value from qpos [N, T, V] and the clipped action [N, T, A]."""

    label: str
    limits: tuple[float, ...]
    value: Callable[[np.ndarray, np.ndarray], np.ndarray]
    wall: bool  # the limit is a place across


def gather(result: Result, index: int = 0, episodes: int = 3) -> Scene:
    """Gather the first demonstrations and as many fresh episodes of the policy; `index` is the seed's place in the summary.

    With fewer demonstrations than `episodes`, both have fewer. Raises ValueError where the world is not a robot.
    """
    env, settings = result.spec.env, result.spec.env_settings
    body, state = make_body(env.name, settings), result.state(index)
    quantity = _quantity(env.limit, body)
    demonstrations = jax.tree.map(lambda leaf: leaf[index, :episodes], result.expert)
    fresh = jax.jit(partial(_roll_out, result.networks, len(demonstrations.mask)))(state)
    judge = jax.jit(jax.vmap(lambda one: (result.step_feasibility(one, index), result.feasibility(one, index))))
    expert, learned = (
        _side(name, result, body, quantity, trajectories, judge(trajectories))
        for name, trajectories in (("expert", demonstrations), ("learned", fresh))
    )
    return Scene(
        title=f"{result.summary['method']} on {env.name}, seed {result.summary['seeds'][index]}, iteration {int(state.step)}",
        stage=body.stage,
        expert=expert,
        learned=learned,
        quantity=quantity.label if quantity else "",
        limits=quantity.limits if quantity else (),
        wall=quantity.limits[0] if quantity and quantity.wall else None,
        note=_note(body),
    )


def _roll_out(nets: Networks, number: int, state: TrainState) -> Trajectory:
    key = jax.random.fold_in(jax.random.fold_in(state.key, KEY_FIGURES), state.step)
    return rollouts(nets.bind(state.params, state.obs_stats), key, number)


def _side(
    name: str,
    result: Result,
    body: Body,
    quantity: Quantity | None,
    trajectories: Trajectory,
    deltas: tuple[Array, Array],
) -> Side:
    method, space = result.spec.method, result.spec.env.action_space
    obs, mask, reward, cost = (
        np.asarray(leaf) for leaf in (trajectories.obs, trajectories.mask, trajectories.reward, trajectories.cost)
    )
    action = np.asarray(jax.vmap(jax.vmap(space.features))(trajectories.action))  # as clipped
    qpos, length = positions(body, obs), mask.sum(axis=1).astype(int)
    violating = np.nan_to_num(cost * mask) > 0
    if result.spec.env.constraint_input == "state":  # a step's cost is of the state after it, which the next pose shows
        violating = np.pad(violating, [(0, 0), (1, 0)])[:, :-1] & (mask > 0)
    return Side(
        name=name,
        links=links(body, qpos),
        across=qpos[..., 0],
        violating=violating,
        level=quantity.value(qpos, action) if quantity else None,
        delta=np.asarray(deltas[0]) if method.tests_steps else None,
        feasibility=np.asarray(deltas[1]) if method.learns_feasibility else None,
        returns=(reward * mask).sum(axis=1),
        violation_rate=(cost * mask).sum(axis=1) / length,
        length=length,
    )


def _quantity(limit: Limit | None, body: Body) -> Quantity | None:
    """What a line can be drawn for; None where there is no constraint, or it bounds no pose that is observed."""
    if limit is None or limit.bounds is None:
        return None
    if limit.bounds == "actions":
        return Quantity("largest |action|", (limit.value,), lambda qpos, action: np.abs(action).max(axis=-1), wall=False)
    hidden = len(unobserved(body))
    joint = hidden + limit.bounds  # the hidden joints are the first ones
    if joint >= body.model.njnt:
        return None
    return Quantity(joint_label(body, joint), limit.lines, lambda qpos, action: qpos[..., joint], wall=joint == 0)


def _note(body: Body) -> str:
    hidden = " and ".join(unobserved(body))
    return f"{hidden} not observed: summed from the velocities, from the rest pose on" if hidden else ""
