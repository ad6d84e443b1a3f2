"""Compute the places of a robot's links in their plane from its observations, by the body's compiled model."""

import importlib
from collections.abc import Mapping
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool, Float, Int

from envs import ENVS
from envs.robots.constraints import task_of
from envs.robots.robot import compile_model
from envs.robots.tasks import ROBOTS, RobotState, Task
from envs.settings import updated

Vectors = Float[np.ndarray, "N T V"]


class Stage(NamedTuple):
    """What stays the same over an episode: the links' radii, the floor, the rail. Lengths in m, time in s."""

    dt: float  # duration of one control step
    axes: tuple[str, str]  # across and up
    radius: Float[np.ndarray, " G"]  # radius of each link, a capsule
    branch: Int[np.ndarray, " G"]  # 1 for the links of a second limb, 0 for all others
    floor: float | None  # height of the floor
    rail: tuple[float, float] | None  # ends of a sliding joint's range


class Body(NamedTuple):
    """A robot's compiled model, the task that says what is observed of it, and the stage."""

    model: Any
    task: Task
    stage: Stage


def make_body(name: str, settings: Mapping[str, Any]) -> Body:
    """Make the body of a run's settings `env`. Raises ValueError where the world is not a robot."""
    if name not in ROBOTS:
        raise ValueError(f"env={name} has no body to draw; choose from {', '.join(ROBOTS)}")
    robot, options = ROBOTS[name], updated(ENVS[name].options(), settings, "env")
    model = compile_model(robot.body, options.integrator, options.body)
    task = robot.tasks[task_of(options.constraint, name)]
    return Body(model, task, _stage(model, float(model.opt.timestep) * robot.body.frame_skip))


def unobserved(body: Body) -> list[str]:
    """Name the joints whose position the task hides."""
    hidden = ~_selection(body).qpos.any(axis=0)
    return [body.model.joint(int(joint)).name for joint in np.flatnonzero(hidden)]


def joint_label(body: Body, joint: int) -> str:
    """Name a joint's coordinate with its unit."""
    mujoco: Any = importlib.import_module("mujoco")
    slides = body.model.jnt_type[joint] == mujoco.mjtJoint.mjJNT_SLIDE
    return f"{body.model.joint(joint).name.replace('_', ' ')} ({'m' if slides else 'rad'})"


def positions(body: Body, obs: Float[np.ndarray, "N T O"]) -> Vectors:
    """Compute qpos of every step; hidden positions are summed from velocities, q_t = q_0 + Σ dt (v_{u−1} + v_u)/2.

    q_0 is then that of the rest pose. Transition noise, and what happens within a control step, make the sum drift.
    """
    selection = _selection(body)
    seen, velocity = obs @ selection.qpos, obs @ selection.qvel
    travelled = np.cumsum((velocity[:, 1:] + velocity[:, :-1]) / 2, axis=1) * body.stage.dt
    summed = body.model.qpos0 + np.pad(travelled, [(0, 0), (1, 0), (0, 0)])
    return np.where(selection.qpos.any(axis=0), seen, summed)


def links(body: Body, qpos: Vectors) -> Float[np.ndarray, "N T G 2 2"]:
    """Compute both ends of every capsule's axis in the body's plane, [episode, step, link, end, coordinate]."""
    mujoco: Any = importlib.import_module("mujoco")
    data, moving, plane = mujoco.MjData(body.model), _moving(body.model), list(_plane(body.model))
    half_length = body.model.geom_size[moving, 1]
    ends = np.empty((*qpos.shape[:2], len(moving), 2, 2))
    for place in np.ndindex(qpos.shape[:2]):
        data.qpos[:] = qpos[place]
        mujoco.mj_kinematics(body.model, data)
        along = data.geom_xmat[moving].reshape(-1, 3, 3)[:, plane, 2] * half_length[:, None]
        middle = data.geom_xpos[moving][:, plane]
        ends[place] = np.stack([middle - along, middle + along], axis=1)
    return ends


def _selection(body: Body) -> RobotState:
    """Compute which coordinate each observation shows: its Jacobian, ones and zeros, [O, V] for qpos and for qvel."""
    rest = RobotState(jnp.array(body.model.qpos0, jnp.float32), jnp.zeros(body.model.nv))
    return RobotState(*(np.asarray(leaf) for leaf in jax.jacobian(body.task.observe)(rest)))  # pyright: ignore[reportArgumentType]


def _stage(model: Any, dt: float) -> Stage:
    mujoco: Any = importlib.import_module("mujoco")
    moving, plane = _moving(model), _plane(model)
    floors = np.flatnonzero(model.geom_type == mujoco.mjtGeom.mjGEOM_PLANE)
    sliding = np.flatnonzero((model.jnt_type == mujoco.mjtJoint.mjJNT_SLIDE) & model.jnt_limited.astype(bool))
    return Stage(
        dt=dt,
        axes=("xyz"[plane[0]], "xyz"[plane[1]]),
        radius=model.geom_size[moving, 0].copy(),
        branch=np.array([_branch(model, int(link)) for link in model.geom_bodyid[moving]]),
        floor=float(model.geom_pos[floors[0], plane[1]]) if len(floors) else None,
        rail=(float(model.jnt_range[sliding[0], 0]), float(model.jnt_range[sliding[0], 1])) if len(sliding) else None,
    )


def _moving(model: Any) -> Int[np.ndarray, " G"]:
    """List the geoms that belong to a body other than the world."""
    return np.flatnonzero(model.geom_bodyid > 0)


def _plane(model: Any) -> tuple[int, int]:
    """Find the two coordinates in which a planar body moves: those that its hinges do not turn about."""
    mujoco: Any = importlib.import_module("mujoco")
    turning: Bool[np.ndarray, " 3"] = model.jnt_axis[model.jnt_type == mujoco.mjtJoint.mjJNT_HINGE].any(axis=0)
    across, up = np.flatnonzero(~turning)
    return int(across), int(up)


def _branch(model: Any, link: int) -> int:
    """Return 1 where the body, or one that carries it, is not its parent's first child; else 0."""
    while link > 0:
        parent = int(model.body_parentid[link])
        siblings = np.flatnonzero(model.body_parentid == parent)
        if link != siblings[siblings > 0][0]:
            return 1
        link = parent
    return 0
