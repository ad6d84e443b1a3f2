"""What is seen, rewarded and healthy in each robot's tasks (Gymnasium v4/v5; ICRL benchmark where there is a wall)."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import NamedTuple

import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from envs.base import Box
from envs.robots.bodies import HALFCHEETAH, HOPPER, PENDULUM, SWIMMER, WALKER, Body


class RobotState(NamedTuple):
    """All that an episode carries: generalised positions and velocities (m, rad, m/s, rad/s)."""

    qpos: Float[Array, " V"]
    qvel: Float[Array, " V"]


@dataclass(frozen=True)
class Task:
    """`observe(state)`, `reward(before, after, clipped action, dt)`, `healthy(state)`."""

    observe: Callable[[RobotState], Float[Array, " O"]]
    reward: Callable[[RobotState, RobotState, Float[Array, " A"], float], Float[Array, ""]]
    healthy: Callable[[RobotState], Bool[Array, ""]]


@dataclass(frozen=True)
class Robot:
    body: Body
    action_space: Box
    tasks: dict[str, Task]  # by the task that a constraint asks for (envs.robots.constraints.Constraint.task)
    height: int | None = None  # which coordinate of qpos is a height that health is a matter of


def everything(state: RobotState) -> Float[Array, " O"]:
    return jnp.concatenate([state.qpos, state.qvel])


def swimmer_view(state: RobotState) -> Float[Array, " O"]:
    """All but x and y, so that the policy cannot know where it is (Gymnasium, Swimmer)."""
    return jnp.concatenate([state.qpos[2:], state.qvel])


def all_but_x(state: RobotState) -> Float[Array, " O"]:
    """All but x (Gymnasium, HalfCheetah)."""
    return jnp.concatenate([state.qpos[1:], state.qvel])


def legged_view(state: RobotState) -> Float[Array, " O"]:
    """All but x, velocities clipped to ±10 (Gymnasium, Walker2d and Hopper)."""
    return jnp.concatenate([state.qpos[1:], jnp.clip(state.qvel, -10.0, 10.0)])


def always(state: RobotState) -> Bool[Array, ""]:
    return jnp.ones((), bool)


def upright(state: RobotState) -> Bool[Array, ""]:
    """0.8 < z < 2 m and |pitch| < 1 rad (Gymnasium, Walker2d)."""
    return (state.qpos[1] > 0.8) & (state.qpos[1] < 2.0) & (jnp.abs(state.qpos[2]) < 1.0)


def hopping(state: RobotState) -> Bool[Array, ""]:
    """z > 0.7 m, |pitch| < 0.2 rad, and all but x and z within ±100 (Gymnasium, Hopper)."""
    sane = (jnp.abs(jnp.concatenate([state.qpos[2:], state.qvel])) < 100.0).all()
    return (state.qpos[1] > 0.7) & (jnp.abs(state.qpos[2]) < 0.2) & sane


def balanced(state: RobotState) -> Bool[Array, ""]:
    """|tilt| ≤ 0.2 rad (Gymnasium, InvertedPendulum)."""
    return jnp.abs(state.qpos[1]) <= 0.2


def swim(before: RobotState, after: RobotState, action: Float[Array, " A"], dt: float) -> Float[Array, ""]:
    """Δx/dt − 1e-4‖a‖² (Gymnasium, Swimmer)."""
    return gained(before, after) / dt - 1e-4 * (action**2).sum()


def swim_either_way(before: RobotState, after: RobotState, action: Float[Array, " A"], dt: float) -> Float[Array, ""]:
    """|Δx|/dt − 1e-4‖a‖² (ICRL benchmark, the blocked swimmer)."""
    return jnp.abs(gained(before, after)) / dt - 1e-4 * (action**2).sum()


def run(before: RobotState, after: RobotState, action: Float[Array, " A"], dt: float) -> Float[Array, ""]:
    """Δx/dt − 0.1‖a‖² (Gymnasium, HalfCheetah)."""
    return gained(before, after) / dt - 0.1 * (action**2).sum()


def run_either_way(before: RobotState, after: RobotState, action: Float[Array, " A"], dt: float) -> Float[Array, ""]:
    """|Δx|/dt − 0.1‖a‖² (ICRL benchmark, the blocked half-cheetah)."""
    return jnp.abs(gained(before, after)) / dt - 0.1 * (action**2).sum()


def walk(before: RobotState, after: RobotState, action: Float[Array, " A"], dt: float) -> Float[Array, ""]:
    """Δx/dt + 1 while upright − 1e-3‖a‖² (Gymnasium, Walker2d)."""
    return gained(before, after) / dt + upright(after) - 1e-3 * (action**2).sum()


def walk_either_way(before: RobotState, after: RobotState, action: Float[Array, " A"], dt: float) -> Float[Array, ""]:
    """|Δx|/dt + 1 while upright − 1e-3‖a‖² (ICRL benchmark, the blocked walker)."""
    return jnp.abs(gained(before, after)) / dt + upright(after) - 1e-3 * (action**2).sum()


def hop(before: RobotState, after: RobotState, action: Float[Array, " A"], dt: float) -> Float[Array, ""]:
    """Δx/dt + 1 while hopping − 1e-3‖a‖² (Gymnasium, Hopper)."""
    return gained(before, after) / dt + hopping(after) - 1e-3 * (action**2).sum()


def hop_either_way(before: RobotState, after: RobotState, action: Float[Array, " A"], dt: float) -> Float[Array, ""]:
    """|Δx|/dt + 1 while hopping − 1e-3‖a‖²."""
    return jnp.abs(gained(before, after)) / dt + hopping(after) - 1e-3 * (action**2).sum()


def gained(before: RobotState, after: RobotState) -> Float[Array, ""]:
    """Δx in metres."""
    return after.qpos[0] - before.qpos[0]


def stay_left(before: RobotState, after: RobotState, action: Float[Array, " A"], dt: float) -> Float[Array, ""]:
    """1 where x ≤ −0.01, 0.1 where x ≥ 0, linear between (ICRL benchmark); 0 once fallen, as there is no early end."""
    return balanced(after) * jnp.interp(after.qpos[0], jnp.array([-0.01, 0.0]), jnp.array([1.0, 0.1]))


def sized(task: Task, height: int, length: float) -> Task:
    """Judge health, in the reward too, by the height of a body of `length` 1: height/length."""

    def at(state: RobotState) -> RobotState:
        return state._replace(qpos=state.qpos.at[height].divide(length))

    return replace(
        task,
        reward=lambda before, after, action, dt: task.reward(before, at(after), action, dt),
        healthy=lambda state: task.healthy(at(state)),
    )


_STAY_LEFT = Task(everything, stay_left, balanced)

ROBOTS: dict[str, Robot] = {
    "swimmer": Robot(
        SWIMMER,
        Box(2),
        {"forward": Task(swimmer_view, swim, always), "wall": Task(everything, swim_either_way, always)},
    ),
    "walker": Robot(
        WALKER,
        Box(6),
        {"forward": Task(legged_view, walk, upright), "wall": Task(everything, walk_either_way, upright)},
        height=1,
    ),
    "halfcheetah": Robot(
        HALFCHEETAH,
        Box(6),
        {"forward": Task(all_but_x, run, always), "wall": Task(everything, run_either_way, always)},
    ),
    "hopper": Robot(
        HOPPER,
        Box(3),
        {"forward": Task(legged_view, hop, hopping), "wall": Task(everything, hop_either_way, hopping)},
        height=1,
    ),
    "pendulum": Robot(PENDULUM, Box(1, -3.0, 3.0), {"forward": _STAY_LEFT, "wall": _STAY_LEFT}),
}
