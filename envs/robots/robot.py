"""Robots: one adapter over the rows of `envs.robots.tasks.ROBOTS` (docs/physics.md)."""

import contextlib
import importlib
import io
from collections.abc import Callable
from importlib import resources
from types import ModuleType
from typing import Any

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, PRNGKeyArray

from envs.base import Env, Limit, Step
from envs.checks import check_predicate
from envs.options import RobotOptions
from envs.robots.bodies import Body
from envs.robots.constraints import find_rule
from envs.robots.factors import AS_SHIPPED, BodyOptions, change
from envs.robots.planar.dynamics import planar_physics
from envs.robots.rewards import rewarded
from envs.robots.tasks import ROBOTS, RobotState, always, sized
from envs.views import Coordinates

SLIDE = 2  # `mujoco.mjtJoint.mjJNT_SLIDE`; every other joint of these bodies turns
SLIDES_IN, TURNS_IN = "m", "rad"
DIVERGED = 1e3  # m, rad, m/s or rad/s; no body comes near it, so a state beyond it, or not finite, is no physics
ABSENT_WARP = ("Failed to import warp", "Failed to import mujoco_warp")  # what MJX prints on standard output

Vector = Float[Array, " V"]
Physics = Callable[[Vector, Vector, Float[Array, " A"]], tuple[Vector, Vector]]


def make_swimmer(options: RobotOptions) -> Env:
    """Make the swimmer: three links in a viscous fluid. Raises ValueError on a wrong setting."""
    return _make("swimmer", options)


def make_walker(options: RobotOptions) -> Env:
    """Make the two-legged walker. Raises ValueError on a wrong setting."""
    return _make("walker", options)


def make_halfcheetah(options: RobotOptions) -> Env:
    """Make the half-cheetah, which runs on two legs in a plane. Raises ValueError on a wrong setting."""
    return _make("halfcheetah", options)


def make_hopper(options: RobotOptions) -> Env:
    """Make the one-legged hopper. Raises ValueError on a wrong setting."""
    return _make("hopper", options)


def make_pendulum(options: RobotOptions) -> Env:
    """Make the inverted pendulum on a cart. Raises ValueError on a wrong setting."""
    return _make("pendulum", options)


def _make(name: str, options: RobotOptions) -> Env:
    body, box, height = ROBOTS[name].body, ROBOTS[name].action_space, ROBOTS[name].height
    model = compile_model(body, options.integrator, options.body)
    rule = find_rule(name, options, model)
    task = rewarded(ROBOTS[name].tasks[rule.task], name, options)
    length = getattr(options.body, "length", 1.0)
    if height is not None and length != 1.0:
        task = sized(task, height, length)
    physics = ENGINES[options.engine](model, body, options.integrator)
    dt = float(model.opt.timestep) * body.frame_skip
    rest = RobotState(jnp.array(model.qpos0, jnp.float32), jnp.zeros(model.nv))
    check_predicate(
        f"constraint {options.constraint!r} of {name}",
        rule.violated,
        rest,
        jax.ShapeDtypeStruct(box.shape, jnp.float32),
    )
    hidden = model.nq + model.nv - task.observe(rest).size  # joints whose position is not observed, the first ones

    def reset(key: PRNGKeyArray) -> tuple[RobotState, Float[Array, " O"]]:
        """Start in the rest pose plus uniform noise on qpos and qvel (Gymnasium)."""
        noise = jax.random.uniform(key, (2 * model.nv,), minval=-body.reset_noise, maxval=body.reset_noise)
        state = _add(rest, noise)
        return state, task.observe(state)

    def step(key: PRNGKeyArray, state: RobotState, action: Float[Array, " A"]) -> tuple[RobotState, Step]:
        """Take one control step. The reward precedes the transition noise; observation, cost and end follow it."""
        action = box.clip(action)
        moved = RobotState(*physics(state.qpos, state.qvel, action))
        sound = jnp.abs(jnp.concatenate(moved)).max() < DIVERGED  # False for NaN too
        moved = jax.tree.map(lambda new, safe: jnp.where(sound, new, safe), moved, rest)
        after = _add(moved, options.noise * jax.random.normal(key, (2 * model.nv,)))
        fallen = ~task.healthy(after) if options.terminate else jnp.zeros((), bool)
        return after, Step(
            obs=task.observe(after),
            reward=jnp.where(sound, task.reward(state, moved, action, dt), 0.0),
            cost=(sound & rule.violated(after, action)).astype(jnp.float32),
            terminated=(~sound | fallen).astype(jnp.float32),
        )

    return Env(
        name=name,
        horizon=options.horizon,
        obs_size=task.observe(rest).size,
        action_space=box,
        reset=reset,
        step=step,
        constraint_input=rule.of,
        shipped_demonstrations=_shipped(name, options) if rule.is_default else None,
        view=_view(model, hidden),
        limit=_observed(rule.limit, hidden),
        fallen=None if task.healthy is always else lambda state: ~task.healthy(state),
    )


def _view(model: Any, hidden: int) -> Coordinates:
    """Name the coordinates by the joints that are observed, the last of them, and by all their velocities."""
    joints = [_spoken(model.joint(index).name) for index in range(model.njnt)]
    driven = [_spoken(model.joint(model.actuator(index).trnid[0]).name) for index in range(model.nu)]
    units = [SLIDES_IN if model.joint(index).type == SLIDE else TURNS_IN for index in range(model.njnt)]
    return Coordinates(
        names=(*joints[hidden:], *(f"velocity of {name}" for name in joints)),
        motors=tuple(f"motor {name}" for name in driven),
        units=(*units[hidden:], *(f"{unit}/s" for unit in units)),
    )


def _observed(limit: Limit | None, hidden: int) -> Limit | None:
    """Turn what the limit bounds, a coordinate of [qpos, qvel], into one of the observation; None where it is not observed."""
    if limit is None or not isinstance(limit.bounds, int):
        return limit
    return limit._replace(bounds=limit.bounds - hidden if limit.bounds >= hidden else None)


def _spoken(name: str) -> str:
    return name.replace("_", " ")


def _shipped(body: str, options: RobotOptions) -> str | None:
    """Name the file of envs/demonstrations. It is of the constraint's default limit, the task and the body as shipped."""
    if options.reward != "task" or options.action_cost or options.body != type(options.body)():
        return None
    name = f"{body}_{options.constraint}"
    return name if (resources.files("envs") / "demonstrations" / f"{name}.npz").is_file() else None


def _add(state: RobotState, noise: Float[Array, " N"]) -> RobotState:
    return RobotState(state.qpos + noise[: state.qpos.size], state.qvel + noise[state.qpos.size :])


def compile_model(body: Body, integrator: str, factors: BodyOptions = AS_SHIPPED) -> Any:
    """Compile the body's `MjModel`, changed by the factors, with the solver settings of its row."""
    mujoco: Any = importlib.import_module("mujoco")
    spec = mujoco.MjSpec.from_string(body.mjcf)
    change(spec, factors)
    model = spec.compile()
    model.opt.integrator = getattr(mujoco.mjtIntegrator, f"mjINT_{integrator.upper()}")
    model.opt.iterations, model.opt.ls_iterations = body.iterations, body.ls_iterations
    if not body.contacts:
        model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_CONTACT
    return model


def mjx_physics(model: Any, body: Body, integrator: str) -> Physics:
    """Make the control step by `mjx.step`, the engine that `planar` is tested against."""
    mjx = import_mjx()
    device_model = mjx.put_model(model)
    template = mjx.make_data(device_model)

    def physics(qpos: Vector, qvel: Vector, action: Float[Array, " A"]) -> tuple[Vector, Vector]:
        def substep(carry: tuple[Vector, Vector, Vector], _: None) -> tuple[tuple[Vector, Vector, Vector], None]:
            qpos, qvel, guess = carry
            data = template.replace(qpos=qpos, qvel=qvel, ctrl=action, qacc_warmstart=guess)
            data = mjx.step(device_model, data)
            return (data.qpos, data.qvel, data.qacc_warmstart), None

        (qpos, qvel, _), _ = jax.lax.scan(substep, (qpos, qvel, jnp.zeros_like(qvel)), None, length=body.frame_skip)
        return qpos, qvel

    return physics


def _planar(model: Any, body: Body, integrator: str) -> Physics:
    return planar_physics(model, integrator, body.frame_skip, body.newton_steps)


ENGINES: dict[str, Callable[[Any, Body, str], Physics]] = {"planar": _planar, "mjx": mjx_physics}


def import_mjx() -> ModuleType:
    """Import `mujoco.mjx`, which takes seconds, without its two printed lines about an absent warp."""
    printed = io.StringIO()
    with contextlib.redirect_stdout(printed):
        mjx = importlib.import_module("mujoco.mjx")
    for line in printed.getvalue().splitlines():
        if not line.startswith(ABSENT_WARP):
            print(line)
    return mjx
