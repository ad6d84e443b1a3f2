"""Swimmer, walker and pendulum in MJX: one adapter, three rows of TASKS (docs/physics.md)."""

import contextlib
import io
from collections.abc import Callable
from dataclasses import dataclass
from types import ModuleType
from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, PRNGKeyArray

from envs import bodies
from envs.base import Box, Env, Step
from envs.bodies import Body
from envs.constraints import find_constraint
from envs.options import RobotOptions

DIVERGED = 1e3  # m, rad, m/s or rad/s; no body comes near it, so a state beyond it (or not finite) is the integrator's


class RobotState(NamedTuple):
    """All that an episode carries: generalised positions and velocities (m, rad, m/s, rad/s)."""

    qpos: Float[Array, " Q"]
    qvel: Float[Array, " V"]


Physics = Callable[[RobotState, Float[Array, " A"]], RobotState]
Reward = Callable[[RobotState, RobotState, Float[Array, " A"], float], Float[Array, ""]]


@dataclass(frozen=True)
class Task:
    """What is seen, rewarded and healthy: `observe(state)`, `reward(before, after, clipped action, dt)`, `healthy(state)`."""

    observe: Callable[[RobotState], Float[Array, " O"]]
    reward: Reward
    healthy: Callable[[RobotState], Bool[Array, ""]]


@dataclass(frozen=True)
class Row:
    body: Body
    action_space: Box
    tasks: dict[str, Task]


def make_swimmer(options: RobotOptions) -> Env:
    """The swimmer: three links in a viscous fluid. Raises ValueError on a wrong setting."""
    return _make("swimmer", options)


def make_walker(options: RobotOptions) -> Env:
    """The planar two-legged walker. Raises ValueError on a wrong setting."""
    return _make("walker", options)


def make_pendulum(options: RobotOptions) -> Env:
    """The inverted pendulum on a cart. Raises ValueError on a wrong setting."""
    return _make("pendulum", options)


def _make(name: str, options: RobotOptions) -> Env:
    constraint = find_constraint(options.constraint, name)
    limit = constraint.limit if options.limit == "default" else float(options.limit)
    row = ROWS[name]
    task, box = row.tasks[constraint.task], row.action_space
    physics, rest, dt = mjx_physics(row.body, options.integrator)

    def reset(key: PRNGKeyArray) -> tuple[RobotState, Float[Array, " O"]]:
        """The rest pose plus uniform noise on qpos and qvel, as Gymnasium does it."""
        noise = row.body.reset_noise
        state = _perturb(rest, lambda k, shape: jax.random.uniform(k, shape, minval=-noise, maxval=noise), key)
        return state, task.observe(state)

    def step(key: PRNGKeyArray, state: RobotState, action: Float[Array, " A"]) -> tuple[RobotState, Step]:
        """One control step: reward before the transition noise; observation, cost and end after it."""
        action = box.clip(action)
        after = physics(state, action)
        finite = jnp.abs(jnp.concatenate(after)).max() < DIVERGED  # False for NaN too
        after = jax.tree.map(lambda new, safe: jnp.where(finite, new, safe), after, rest)
        reward = task.reward(state, after, action, dt)
        after = _perturb(after, lambda k, shape: options.noise * jax.random.normal(k, shape), key)
        cost = constraint.violated(after.qpos, action, limit)
        ended = ~finite | (~task.healthy(after) if options.terminate else False)
        return after, Step(
            obs=task.observe(after),
            reward=jnp.where(finite, reward, 0.0),
            cost=jnp.where(finite, cost, False).astype(jnp.float32),
            terminated=jnp.asarray(ended, jnp.float32),
        )

    return Env(
        name=name,
        horizon=options.horizon,
        obs_size=task.observe(rest).size,
        action_space=box,
        reset=reset,
        step=step,
        constraint_input=constraint.of,
    )


def _perturb(state: RobotState, draw: Callable[..., Array], key: PRNGKeyArray) -> RobotState:
    noise = draw(key, (state.qpos.size + state.qvel.size,))
    return RobotState(state.qpos + noise[: state.qpos.size], state.qvel + noise[state.qpos.size :])


def mjx_physics(body: Body, integrator: str) -> tuple[Physics, RobotState, float]:
    """One control step of MJX, the state at rest, and the control step's length in seconds."""
    mjx = import_mjx()
    import mujoco

    model = mujoco.MjModel.from_xml_string(body.mjcf)
    model.opt.integrator = {"euler": mujoco.mjtIntegrator.mjINT_EULER, "rk4": mujoco.mjtIntegrator.mjINT_RK4}[integrator]
    model.opt.iterations, model.opt.ls_iterations = body.iterations, body.ls_iterations
    if not body.contacts:
        model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_CONTACT
    device_model = mjx.put_model(model)
    template = mjx.make_data(device_model)
    rest = RobotState(jnp.array(model.qpos0, jnp.float32), jnp.zeros(model.nv))

    def physics(state: RobotState, action: Float[Array, " A"]) -> RobotState:
        def substep(carry, _):
            qpos, qvel, warm = carry
            data = template.replace(qpos=qpos, qvel=qvel, ctrl=action, qacc_warmstart=warm)
            data = mjx.step(device_model, data)
            return (data.qpos, data.qvel, data.qacc_warmstart), None

        start = (state.qpos, state.qvel, jnp.zeros_like(state.qvel))
        (qpos, qvel, _), _ = jax.lax.scan(substep, start, None, length=body.frame_skip)
        return RobotState(qpos, qvel)

    return physics, rest, model.opt.timestep * body.frame_skip


def import_mjx() -> ModuleType:
    """`mujoco.mjx`, imported late (it takes seconds) and without its two lines about an absent warp."""
    printed = io.StringIO()
    with contextlib.redirect_stdout(printed):
        from mujoco import mjx
    for line in printed.getvalue().splitlines():
        if not line.startswith(("Failed to import warp", "Failed to import mujoco_warp")):
            print(line)
    return mjx


def _concatenate(state: RobotState) -> Float[Array, " O"]:
    return jnp.concatenate([state.qpos, state.qvel])


def _always(state: RobotState) -> Bool[Array, ""]:
    return jnp.ones((), bool)


def _swim(before: RobotState, after: RobotState, action: Float[Array, " A"], dt: float) -> Float[Array, ""]:
    """Δx/dt − 1e-4‖a‖² (Gymnasium, Swimmer)."""
    return (after.qpos[0] - before.qpos[0]) / dt - 1e-4 * (action**2).sum()


def _swim_either_way(before: RobotState, after: RobotState, action: Float[Array, " A"], dt: float) -> Float[Array, ""]:
    """|Δx|/dt − 1e-4‖a‖² (ICRL benchmark, the blocked swimmer)."""
    return jnp.abs(after.qpos[0] - before.qpos[0]) / dt - 1e-4 * (action**2).sum()


def _upright(state: RobotState) -> Bool[Array, ""]:
    """0.8 < z < 2 m and |pitch| < 1 rad (Gymnasium, Walker2d)."""
    return (state.qpos[1] > 0.8) & (state.qpos[1] < 2.0) & (jnp.abs(state.qpos[2]) < 1.0)


def _walk(before: RobotState, after: RobotState, action: Float[Array, " A"], dt: float) -> Float[Array, ""]:
    """Δx/dt + 1 while upright − 1e-3‖a‖² (Gymnasium, Walker2d)."""
    return (after.qpos[0] - before.qpos[0]) / dt + _upright(after) - 1e-3 * (action**2).sum()


def _walk_either_way(before: RobotState, after: RobotState, action: Float[Array, " A"], dt: float) -> Float[Array, ""]:
    """|Δx|/dt + 1 while upright − 1e-3‖a‖² (ICRL benchmark, the blocked walker)."""
    return jnp.abs(after.qpos[0] - before.qpos[0]) / dt + _upright(after) - 1e-3 * (action**2).sum()


def _balanced(state: RobotState) -> Bool[Array, ""]:
    """|tilt| ≤ 0.2 rad (Gymnasium, InvertedPendulum)."""
    return jnp.abs(state.qpos[1]) <= 0.2


def _lean_left(before: RobotState, after: RobotState, action: Float[Array, " A"], dt: float) -> Float[Array, ""]:
    """1 where x ≤ −0.01, 0.1 where x ≥ 0, linear between (ICRL benchmark, InvertedPendulumWall); 0 once fallen."""
    return _balanced(after) * jnp.interp(after.qpos[0], jnp.array([-0.01, 0.0]), jnp.array([1.0, 0.1]))


def _swimmer_view(state: RobotState) -> Float[Array, " O"]:
    return jnp.concatenate([state.qpos[2:], state.qvel])


def _walker_view(state: RobotState) -> Float[Array, " O"]:
    return jnp.concatenate([state.qpos[1:], jnp.clip(state.qvel, -10.0, 10.0)])


_PENDULUM_TASK = Task(_concatenate, _lean_left, _balanced)

ROWS: dict[str, Row] = {
    "swimmer": Row(
        bodies.SWIMMER,
        Box(2),
        {
            "forward": Task(_swimmer_view, _swim, _always),
            "wall": Task(_concatenate, _swim_either_way, _always),
        },
    ),
    "walker": Row(
        bodies.WALKER,
        Box(6),
        {
            "forward": Task(_walker_view, _walk, _upright),
            "wall": Task(_concatenate, _walk_either_way, _upright),
        },
    ),
    "pendulum": Row(bodies.PENDULUM, Box(1, -3.0, 3.0), {"forward": _PENDULUM_TASK, "wall": _PENDULUM_TASK}),
}
