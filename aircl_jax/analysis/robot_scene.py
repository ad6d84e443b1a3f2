"""Episodes of a robot to look at: poses, violations and δ₁ step by step, demonstrations beside the learned policy."""

from collections.abc import Callable
from functools import partial
from typing import NamedTuple

import jax
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from aircl_jax.algorithm.rollout import rollouts
from aircl_jax.analysis.episodes import KEY_FIGURES
from aircl_jax.analysis.robot_poses import Body, Stage, links, make_body, positions, unobserved
from aircl_jax.model.networks import Networks
from aircl_jax.runs.result import Result
from aircl_jax.types import TrainState, Trajectory
from envs.robots.constraints import Constraint, Predicate, find_constraint, limit_of, torque_above, x_above, x_below


class Side(NamedTuple):
    """Episodes of one origin. What stands at step t was true of the pose at step t."""

    name: str
    links: Float[np.ndarray, "E T G 2 2"]  # m
    across: Float[np.ndarray, "E T"]  # x, as the constraint means it, m
    violating: Bool[np.ndarray, "E T"]
    level: Float[np.ndarray, "E T"] | None  # of the quantity that the constraint bounds
    delta: Float[np.ndarray, "E T"] | None  # δ₁; None where the method has no per-step factor
    feasibility: Float[np.ndarray, " E"] | None  # δ̄(τ); None where the method has none
    returns: Float[np.ndarray, " E"]  # true, undiscounted; NaN where unknown
    violation_rate: Float[np.ndarray, " E"]  # NaN where the cost is unknown
    length: Int[np.ndarray, " E"]  # unmasked steps


class Scene(NamedTuple):
    """All that a picture of a run's behaviour needs."""

    title: str
    stage: Stage
    expert: Side
    learned: Side
    quantity: str  # what the constraint bounds; empty where no line can be drawn for it
    limits: tuple[float, ...]  # of it
    wall: float | None  # the limit, where it is a place across
    note: str  # what was reconstructed; empty where nothing was


class Quantity(NamedTuple):
    """What a predicate bounds: its name, and its value from qpos [N, T, V] and the clipped action [N, T, A]."""

    label: str
    value: Callable[[np.ndarray, np.ndarray], np.ndarray]
    wall: bool = False  # the limit is a place across


_ACROSS = Quantity("x (m)", lambda qpos, action: qpos[..., 0], wall=True)
QUANTITIES: dict[Predicate, Quantity] = {
    torque_above: Quantity("largest |action|", lambda qpos, action: np.abs(action).max(axis=-1)),
    x_above: _ACROSS,
    x_below: _ACROSS,
}


def gather(result: Result, index: int = 0, episodes: int = 3) -> Scene:
    """The first demonstrations, and as many fresh episodes of the policy of the seed at this place of the summary.

    There are fewer where there are fewer demonstrations. Raises ValueError where the world is no robot.
    """
    env, settings = result.spec.env, result.spec.env_settings
    body, constraint = make_body(env.name, settings), find_constraint(settings["constraint"], env.name)
    quantity, state = QUANTITIES.get(constraint.violated), result.state(index)
    demonstrations = jax.tree.map(lambda leaf: leaf[index, :episodes], result.expert)
    fresh = jax.jit(partial(_roll_out, result.networks, len(demonstrations.mask)))(state)
    judge = jax.jit(jax.vmap(lambda one: (result.step_feasibility(one, index), result.feasibility(one, index))))
    expert, learned = (
        _side(name, result, body, constraint, trajectories, judge(trajectories))
        for name, trajectories in (("expert", demonstrations), ("learned", fresh))
    )
    limit = limit_of(constraint, settings["limit"])
    return Scene(
        title=f"{result.summary['method']} on {env.name}, seed {result.summary['seeds'][index]}, iteration {int(state.step)}",
        stage=body.stage,
        expert=expert,
        learned=learned,
        quantity=quantity.label if quantity else "",
        limits=(limit,) if quantity else (),
        wall=limit if quantity and quantity.wall else None,
        note=_note(body),
    )


def _roll_out(nets: Networks, number: int, state: TrainState) -> Trajectory:
    key = jax.random.fold_in(jax.random.fold_in(state.key, KEY_FIGURES), state.step)
    return rollouts(nets.env, nets, state.params, state.obs_stats, key, number)


def _side(
    name: str, result: Result, body: Body, constraint: Constraint, trajectories: Trajectory, judged: tuple[Array, Array]
) -> Side:
    method, space = result.spec.method, result.spec.env.action_space
    obs, mask, reward, cost = (
        np.asarray(leaf) for leaf in (trajectories.obs, trajectories.mask, trajectories.reward, trajectories.cost)
    )
    action = np.asarray(jax.vmap(jax.vmap(space.features))(trajectories.action))  # as clipped
    qpos, length, quantity = positions(body, obs), mask.sum(axis=1).astype(int), QUANTITIES.get(constraint.violated)
    violating = np.nan_to_num(cost * mask) > 0
    if constraint.of == "state":  # the cost of a step is that of the state after it, which the next pose shows
        violating = np.pad(violating, [(0, 0), (1, 0)])[:, :-1] & (mask > 0)
    return Side(
        name=name,
        links=links(body, qpos),
        across=qpos[..., 0],
        violating=violating,
        level=quantity.value(qpos, action) if quantity else None,
        delta=np.asarray(judged[0]) if "step" in method.feasibility else None,
        feasibility=np.asarray(judged[1]) if method.feasibility != "none" else None,
        returns=(reward * mask).sum(axis=1),
        violation_rate=(cost * mask).sum(axis=1) / length,
        length=length,
    )


def _note(body: Body) -> str:
    hidden = " and ".join(unobserved(body))
    return f"{hidden} not observed: summed from the velocities, from the rest pose on" if hidden else ""
