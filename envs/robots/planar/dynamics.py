"""MuJoCo's equations of motion for a body that moves in a plane: `mjx.step`, faster (docs/physics.md, section 2).

Planar spatial vectors at the root, (u, v, turning), carry everything: with the joints' columns S_j, a link's motion is
Σ S_j w_j over the joints that move it, and a joint feels S_j · Σ of the forces beyond it (Featherstone, Rigid Body
Dynamics Algorithms, 2008, chapters 2, 5 and 6).

The last axis of every array is that of N environments: each scalar of the algebra is then one run of memory.
"""

from collections.abc import Callable
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from envs.robots.planar.chain import Chain, Spring, chain_of
from envs.robots.planar.matrix import Entries, Joints, diagonal, solve, times

Points = Float[Array, "X N"]
Physics = Callable[
    [Float[Array, " V"], Float[Array, " V"], Float[Array, " A"]],
    tuple[Float[Array, " V"], Float[Array, " V"]],
]


class Pose(NamedTuple):
    """Positions of a body's parts, in metres from the root."""

    cos: Float[Array, "B N"]
    sin: Float[Array, "B N"]
    centre: Float[Array, "2 B N"]  # of mass
    end: Float[Array, "2 C N"]  # of the capsules
    columns: Float[Array, "3 V N"]  # S: the motion (u, v, turning) at the root per unit of each joint's


class Rows(NamedTuple):
    """Limits and contacts of one state. Each has a wanted acceleration and a weight, 0 where it is out of reach."""

    side: Joints  # 1 at a lower limit, −1 at an upper one
    stop: Joints  # weight of the limits
    stop_want: Joints
    point: Float[Array, "2 C N"]  # where the ends touch, from the root (m)
    hold: Float[Array, "C N"]  # weight of one edge of the friction pyramid
    rise_want: Float[Array, "C N"]
    slip_want: Float[Array, "C N"]  # times friction


def pose(chain: Chain, qpos: Joints) -> Pose:
    """Place every point: Σ_k R(φ_k) c_k over the links k between the root and it, with constant c_k."""
    angle = chain.angle @ (qpos - chain.qpos0)
    cos, sin = jnp.cos(angle), jnp.sin(angle)
    points = (chain.place @ jnp.concatenate([cos, sin])).reshape(2, -1, qpos.shape[-1])
    hinge, centre, end = jnp.split(points, [chain.turn.size, chain.turn.size + chain.mass.size], axis=1)
    turn = jnp.broadcast_to(chain.turn, qpos.shape)
    columns = jnp.stack([chain.slide[0] + turn * hinge[1], chain.slide[1] - turn * hinge[0], turn])
    return Pose(cos, sin, centre, end, columns)


def move(at: Pose, moves: np.ndarray, points: Float[Array, "2 X N"], rate: Joints) -> tuple[Points, Points, Points]:
    """Compute J·w at some points: their motion along u and v, and the turning of their links."""
    u, v, turning = (moves.T @ (column * rate) for column in at.columns)
    return u - turning * points[1], v + turning * points[0], turning


def feel(at: Pose, moves: np.ndarray, points: Float[Array, "2 X N"], force: tuple[Points, Points, Points]) -> Joints:
    """Compute Jᵀ·force: the force on each joint of (u, v, moment) at some points."""
    u, v, moment = force
    beyond = jnp.stack([moves @ u, moves @ v, moves @ (points[0] * v - points[1] * u + moment)])
    return (at.columns * beyond).sum(axis=0)


def stiff(
    chain: Chain, at: Pose, moves: np.ndarray, points: Float[Array, "2 X N"], block: tuple[Points, Points, Points, Points]
) -> Entries:
    """Compute Jᵀ K J at some points, with K = [[uu, uv], [uv, vv]] and a stiffness against turning."""
    uu, uv, vv, turning = block
    first_u, first_v = uv * points[0] - uu * points[1], vv * points[0] - uv * points[1]
    second = points[0] * first_v - points[1] * first_u + turning
    uu, uv, vv, first_u, first_v, second = (moves @ one for one in (uu, uv, vv, first_u, first_v, second))
    u, v, t = at.columns
    pushed = (uu * u + uv * v + first_u * t, uv * u + vv * v + first_v * t, first_u * u + first_v * v + second * t)
    below, above = np.array(chain.pairs).T
    first, second, third = (force[below] * column[above] for force, column in zip(pushed, at.columns, strict=True))
    return first + second + third


def smooth_force(chain: Chain, at: Pose, qpos: Joints, qvel: Joints, action: Float[Array, "A N"]) -> Joints:
    """Sum motors, gravity, drag and springs, less damping, Coriolis and centrifugal forces."""
    joints, links = chain.turn.size, chain.mass.size
    along, across, spin = move(at, chain.moves, at.centre, qvel)
    to_centres = chain.place.reshape(2, -1, 2 * links)[:, joints : joints + links].reshape(2 * links, 2 * links)
    spinning = jnp.concatenate([at.cos * spin**2, at.sin * spin**2])
    centrifugal = (to_centres @ spinning).reshape(2, links, -1)
    u, v = chain.mass * (chain.gravity[0] + centrifugal[0]), chain.mass * (chain.gravity[1] + centrifugal[1])
    moment = jnp.zeros_like(u)
    if chain.drag.any():
        local = jnp.stack([at.cos * along + at.sin * across, at.cos * across - at.sin * along, spin])
        drag = -(chain.drag[0] + chain.drag[1] * jnp.abs(local)) * local
        u, v = u + at.cos * drag[0] - at.sin * drag[1], v + at.sin * drag[0] + at.cos * drag[1]
        moment = drag[2]
    driven = jnp.asarray(chain.motor) @ action - chain.damping * qvel
    if chain.stiffness.any():
        driven = driven - chain.stiffness * (qpos - chain.relaxed)
    return driven + feel(at, chain.moves, at.centre, (u, v, moment))


def constraint_rows(chain: Chain, at: Pose, qpos: Joints, qvel: Joints) -> Rows:
    """Set up MuJoCo's soft constraints: each joint at the nearer of its limits, each end on the floor."""
    low, high = qpos - chain.low, chain.high - qpos
    side = jnp.where(low < high, 1.0, -1.0)
    stop, stop_pull = _soften(chain.limit, jnp.minimum(low, high), chain.limit_mass)
    lifted = (chain.slide[1] * (qpos - chain.qpos0)).sum(axis=0)
    gap = at.end[1] + lifted + chain.height - chain.radius
    point = jnp.stack([at.end[0], at.end[1] - chain.radius - gap / 2])  # the middle of the overlap
    hold, pull = _soften(chain.contact, gap - chain.margin, chain.contact_mass)
    slip, rise, _ = move(at, chain.moves_end, point, qvel)
    return Rows(
        side=side,
        stop=stop,
        stop_want=stop_pull - chain.limit.damping * side * qvel,
        point=point,
        hold=hold,
        rise_want=pull - chain.contact.damping * rise,
        slip_want=-chain.contact.damping * jnp.asarray(chain.friction) * slip,
    )


def _soften(spring: Spring, distance: Points, mass: np.ndarray) -> tuple[Points, Points]:
    """Return (mass·impedance/(1 − impedance), −stiffness·impedance·distance) where the distance is negative, else 0."""
    x = jnp.minimum(jnp.abs(distance) / spring.width, 1.0)
    rising = x**spring.power / spring.middle ** (spring.power - 1)
    falling = 1 - (1 - x) ** spring.power / (1 - spring.middle) ** (spring.power - 1)
    share = jnp.where(x < spring.middle, rising, falling)
    impedance = spring.least + share * (spring.greatest - spring.least)
    reached = distance < 0
    pull = -spring.stiffness * impedance * jnp.where(reached, distance, 0.0)
    return jnp.where(reached, mass * impedance / (1 - impedance), 0.0), pull


def constrain(chain: Chain, at: Pose, rows: Rows, mass: Entries, force: Joints, guess: Joints, iterations: int) -> Joints:
    """Minimise ½|q̈ − M⁻¹force|²_M + ½ Σ_r D_r min(J_r q̈ − want_r, 0)² over q̈, by Newton steps on the rows that push."""
    wider = jnp.asarray(chain.friction)

    def newton_step(_: Any, qacc: Joints) -> Joints:
        pushing = jnp.where(rows.side * qacc < rows.stop_want, rows.stop, 0.0)
        hessian = mass + diagonal(chain, pushing)
        right = force + pushing * rows.side * rows.stop_want
        if chain.radius.size:
            slip, rise, _turning = move(at, chain.moves_end, rows.point, qacc)
            ahead, behind = rows.rise_want + rows.slip_want, rows.rise_want - rows.slip_want
            plus = jnp.where(rise + wider * slip < ahead, rows.hold, 0.0)
            minus = jnp.where(rise - wider * slip < behind, rows.hold, 0.0)
            sides = jnp.where(rise < rows.rise_want, 2 * rows.hold, 0.0)  # the pyramid's edges out of the plane
            block = (wider**2 * (plus + minus), wider * (plus - minus), plus + minus + sides, jnp.zeros_like(plus))
            up = plus * ahead + minus * behind + sides * rows.rise_want
            push = (wider * (plus * ahead - minus * behind), up, jnp.zeros_like(up))
            hessian = hessian + stiff(chain, at, chain.moves_end, rows.point, block)
            right = right + feel(at, chain.moves_end, rows.point, push)
        return solve(chain, hessian, right)

    return jax.lax.fori_loop(0, iterations, newton_step, guess)


def planar_physics(model: Any, integrator: str, frame_skip: int, iterations: int) -> Physics:
    """Make the control step (qpos, qvel, action) → (qpos, qvel) of a compiled model's planar body."""
    chain, dt = chain_of(model), float(model.opt.timestep)

    def dynamics(qpos: Joints, qvel: Joints, action: Float[Array, "A N"], guess: Joints) -> tuple[Joints, Entries]:
        at = pose(chain, qpos)
        links = jnp.broadcast_to(chain.mass, at.cos.shape)
        block = (links, jnp.zeros_like(links), links, jnp.broadcast_to(chain.inertia, at.cos.shape))
        mass = stiff(chain, at, chain.moves, at.centre, block) + diagonal(chain, chain.armature)
        force, rows = smooth_force(chain, at, qpos, qvel, action), constraint_rows(chain, at, qpos, qvel)
        return constrain(chain, at, rows, mass, force, guess, iterations), mass

    def euler(qpos: Joints, qvel: Joints, action: Float[Array, "A N"], guess: Joints) -> tuple[Joints, Joints, Joints]:
        """Step semi-implicitly, with the joints' damping implicit: (M + dt D) Δq̇ = dt M q̈ (MuJoCo, "Numerical integration")."""
        qacc, mass = dynamics(qpos, qvel, action, guess)
        step = qacc
        if chain.damping.any():
            step = solve(chain, mass + diagonal(chain, dt * chain.damping), times(chain, mass, qacc))
        qvel = qvel + dt * step
        return qpos + dt * qvel, qvel, qacc

    def rk4(qpos: Joints, qvel: Joints, action: Float[Array, "A N"], guess: Joints) -> tuple[Joints, Joints, Joints]:
        """Take a classical fourth-order Runge–Kutta step. Each stage starts its solver from the stage before."""

        def stage(carry: tuple[Joints, ...], weights: Float[Array, "2"]) -> tuple[tuple[Joints, ...], None]:
            speed, rate, speeds, rates = carry
            share, weight = weights
            place, speed = qpos + share * dt * speed, qvel + share * dt * rate
            rate, _ = dynamics(place, speed, action, rate)
            return (speed, rate, speeds + weight * speed, rates + weight * rate), None

        tableau = jnp.array([[0, 1 / 6], [1 / 2, 1 / 3], [1 / 2, 1 / 3], [1, 1 / 6]])
        start = (qvel, guess, jnp.zeros_like(qvel), jnp.zeros_like(qvel))
        (_, rate, speeds, rates), _ = jax.lax.scan(stage, start, tableau)
        return qpos + dt * speeds, qvel + dt * rates, rate

    one = {"euler": euler, "rk4": rk4}[integrator]

    def many(qpos: Joints, qvel: Joints, action: Float[Array, "A N"]) -> tuple[Joints, Joints]:
        def substep(carry: tuple[Joints, Joints, Joints], _: None) -> tuple[tuple[Joints, Joints, Joints], None]:
            qpos, qvel, guess = carry
            return one(qpos, qvel, action, guess), None

        (qpos, qvel, _), _ = jax.lax.scan(substep, (qpos, qvel, jnp.zeros_like(qvel)), None, length=frame_skip)
        return qpos, qvel

    return _of_one(many)


def _of_one(many: Callable[..., tuple[Array, Array]]) -> Callable[..., tuple[Array, Array]]:
    """Turn `many`, which takes N environments on the last axis, into a function of one whose `vmap`s call `many` once.

    A plain `vmap` would put the environments first, and each further one its own axis before them: seeds × rollouts are N here.
    The batching rule has no reverse mode, so derivatives are taken through `many` at N = 1.
    """

    def plain(*inputs: Array) -> tuple[Array, Array]:
        qpos, qvel = many(*(one[..., None] for one in inputs))
        return qpos[..., 0], qvel[..., 0]

    @jax.custom_batching.custom_vmap
    def of_rows(*inputs: Array) -> tuple[Array, Array]:
        qpos, qvel = many(*(jnp.moveaxis(rows, 0, -1) for rows in inputs))
        return jnp.moveaxis(qpos, -1, 0), jnp.moveaxis(qvel, -1, 0)

    @of_rows.def_vmap
    def _(size: int, is_batched: list[bool], *inputs: Array) -> tuple[tuple[Array, Array], tuple[bool, bool]]:
        every = [
            rows if along else jnp.broadcast_to(rows, (size, *rows.shape))
            for rows, along in zip(inputs, is_batched, strict=True)
        ]
        qpos, qvel = of_rows(*(rows.reshape(-1, *rows.shape[2:]) for rows in every))
        return (qpos.reshape(size, -1, *qpos.shape[1:]), qvel.reshape(size, -1, *qvel.shape[1:])), (True, True)

    def one(*inputs: Array) -> tuple[Array, Array]:
        qpos, qvel = of_rows(*(row[None] for row in inputs))
        return qpos[0], qvel[0]

    physics = jax.custom_jvp(one)
    physics.defjvp(lambda primals, tangents: jax.jvp(plain, primals, tangents))
    return physics
