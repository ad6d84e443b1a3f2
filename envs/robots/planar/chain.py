"""The constants of a planar body, read from its compiled MuJoCo model (docs/physics.md, section 2)."""

from typing import Any, NamedTuple

import numpy as np

HINGE, PLANE, CAPSULE = 3, 0, 3  # mjtJoint.mjJNT_HINGE, mjtGeom.mjGEOM_PLANE, mjtGeom.mjGEOM_CAPSULE
IMPEDANCES = 1e-4, 0.9999  # the least and the greatest one: mjMINIMP, mjMAXIMP


class Spring(NamedTuple):
    """Softness of limits and contacts: acceleration = −damping·velocity − stiffness·impedance·distance."""

    stiffness: float  # 1/s²
    damping: float  # 1/s
    least: float  # impedance at distance 0
    greatest: float  # impedance at `width` and beyond
    width: float  # m, rad
    middle: float  # share of the width where the impedance's curve turns
    power: int  # of that curve


class Chain(NamedTuple):
    """Axes: B links, V joints, A motors, C capsule ends that may touch the floor, X = V + B + C points, 1 for environments."""

    angle: np.ndarray  # [B, V]: φ = angle · (qpos − qpos0)
    place: np.ndarray  # [2X, 2B]: hinges, centres of mass, ends, from the root (m) = place · [cos φ, sin φ]
    slide: np.ndarray  # [2, V, 1]: the directions of the sliding joints
    turn: np.ndarray  # [V, 1]: ±1 for a hinge, 0 for a slide
    moves: np.ndarray  # [V, B]: 1 where the joint moves the link
    moves_end: np.ndarray  # [V, C]
    pairs: tuple[tuple[int, int], ...]  # (j, i), i ≤ j: joint i moves joint j, or is it
    qpos0: np.ndarray  # [V, 1] m, rad
    height: np.ndarray  # [] m, of the root above the floor at qpos0
    mass: np.ndarray  # [B, 1] kg
    inertia: np.ndarray  # [B, 1] kg m², about the centre of mass
    armature: np.ndarray  # [V, 1] kg, kg m²
    damping: np.ndarray  # [V, 1] N s/m, N m s
    stiffness: np.ndarray  # [V, 1] N/m, N m: of the springs in the joints
    relaxed: np.ndarray  # [V, 1] m, rad: where those pull to
    motor: np.ndarray  # [V, A]: N, N m per unit of action
    gravity: np.ndarray  # [2] m/s²
    drag: np.ndarray  # [2, 3, B, 1]: linear and quadratic drag along a link, across it, against turning
    low: np.ndarray  # [V, 1] m, rad; −∞ without a limit
    high: np.ndarray  # [V, 1]
    limit_mass: np.ndarray  # [V, 1] kg, kg m²: what a limit pushes against
    radius: np.ndarray  # [C, 1] m
    margin: np.ndarray  # [C, 1] m: the distance at which the floor begins to push
    friction: np.ndarray  # [C, 1]
    contact_mass: np.ndarray  # [C, 1] kg: what an edge of the friction pyramid pushes against
    limit: Spring
    contact: Spring


class _Plane(NamedTuple):
    normal: np.ndarray
    axes: list[int]
    sign: float  # 1 where turning about the normal takes the first axis to the second, else −1


def chain_of(model: Any) -> Chain:
    """Read the constants. A root moves on slides and one hinge, the other links on hinges, all in one plane."""
    hinge = model.jnt_type == HINGE
    normal = np.abs(model.jnt_axis[hinge]).max(axis=0)
    plane = _Plane(normal, [0, 1], 1.0) if normal[2] == 1 else _Plane(normal, [0, 2], -1.0)
    links, joints = model.nbody - 1, model.nv
    moves = np.zeros((joints, links))
    origin = np.zeros((links, links, 2))  # a link's origin = root + Σ_k R(φ_k) origin[link, k]
    anchor = np.zeros((joints, links, 2))  # the same of a joint
    for link in range(links):
        parent, own = model.body_parentid[link + 1] - 1, model.jnt_bodyid == link + 1
        pivot = model.jnt_pos[own & hinge][:, plane.axes].sum(axis=0)
        if parent >= 0:
            moves[:, link], origin[link] = moves[:, parent], origin[parent]
            origin[link, parent] += model.body_pos[link + 1, plane.axes] + pivot
            anchor[own] = origin[link]
            origin[link, link] -= pivot
        moves[own, link] = 1.0
    centre = origin.copy()
    centre[range(links), range(links)] += model.body_ipos[1:, plane.axes]
    turn = np.where(hinge, plane.sign * model.jnt_axis @ normal, 0.0)
    motor = np.zeros((model.nu, joints))
    motor[range(model.nu), model.actuator_trnid[:, 0]] = model.actuator_gear[:, 0]
    limited = model.jnt_limited.astype(bool)
    inertia, drag = _shape(model, plane)
    touching = _ends(model, plane, origin)
    chain = Chain(
        angle=(turn[:, None] * moves).T,
        place=_rotating(np.concatenate([anchor, centre, touching["end"]])),
        slide=np.where(hinge, 0.0, model.jnt_axis[:, plane.axes].T)[..., None],
        turn=turn[:, None],
        moves=moves,
        moves_end=moves[:, touching["link"]],
        pairs=tuple((int(j), int(i)) for j, i in np.argwhere(np.tril(moves[:, model.jnt_bodyid - 1].T))),
        qpos0=model.qpos0[:, None],
        height=model.body_pos[1, plane.axes[1]],
        mass=model.body_mass[1:, None],
        inertia=inertia[:, None],
        armature=model.dof_armature[:, None],
        damping=model.dof_damping[:, None],
        stiffness=model.jnt_stiffness[:, None],
        relaxed=model.qpos_spring[:, None],
        motor=motor.T,
        gravity=model.opt.gravity[plane.axes],
        drag=drag[..., None],
        low=np.where(limited, model.jnt_range[:, 0], -np.inf)[:, None],
        high=np.where(limited, model.jnt_range[:, 1], np.inf)[:, None],
        limit_mass=1 / model.dof_invweight0[:, None],
        radius=touching["radius"][:, None],
        margin=touching["margin"][:, None],
        friction=touching["friction"][:, None],
        contact_mass=touching["mass"][:, None],
        limit=_spring(model, model.jnt_solref[limited][0], model.jnt_solimp[limited][0]),
        contact=_spring(model, model.geom_solref[0], model.geom_solimp[0]),
    )
    return chain._replace(**{k: np.float32(v) for k, v in chain._asdict().items() if not isinstance(v, tuple)})


def _rotating(offset: np.ndarray) -> np.ndarray:
    """Σ_k R(φ_k) offset[x, k] as a matrix [2X, 2B] · [cos φ, sin φ]."""
    quarter_turn = np.stack([-offset[..., 1], offset[..., 0]], axis=-1)
    both = np.concatenate([offset, quarter_turn], axis=1)
    return both.transpose(2, 0, 1).reshape(-1, both.shape[1])


def _rotation(quaternion: np.ndarray) -> np.ndarray:
    """The rotation matrix 1 + 2w[r]× + 2[r]×² of a unit quaternion (w, r)."""
    cross = np.cross(np.eye(3), quaternion[1:])
    return np.eye(3) + 2 * quaternion[0] * cross + 2 * cross @ cross


def _shape(model: Any, plane: _Plane) -> tuple[np.ndarray, np.ndarray]:
    """Inertia about the normal, and the drag of a box with each link's inertia (MuJoCo's inertia model of fluids)."""
    inertia, drag = [], []
    for mass, principal, quaternion in zip(model.body_mass[1:], model.body_inertia[1:], model.body_iquat[1:], strict=True):
        rotation = np.abs(_rotation(quaternion))  # a link's own axes lie in the plane or along its normal
        box = rotation @ np.sqrt(6 * (principal.sum() - 2 * principal) / mass)
        (u, v), n, diameter = box[plane.axes], box @ plane.normal, box.mean()
        inertia.append(plane.normal @ rotation @ principal)
        linear = model.opt.viscosity * np.pi * np.array([3 * diameter, 3 * diameter, diameter**3])
        quadratic = model.opt.density * np.array([v * n / 2, u * n / 2, n * (u**4 + v**4) / 64])
        drag.append([linear, quadratic])
    return np.array(inertia), np.array(drag).transpose(1, 2, 0)


def _ends(model: Any, plane: _Plane, origin: np.ndarray) -> dict[str, np.ndarray]:
    """Both ends of each capsule above a floor: offsets from the root, link, radius, margin, friction, mass."""
    floors = np.flatnonzero(model.geom_type == PLANE)
    capsules = np.flatnonzero(model.geom_type == CAPSULE) if floors.size else np.array([], int)
    link = np.repeat(model.geom_bodyid[capsules] - 1, 2)
    axis = np.array([_rotation(model.geom_quat[geom])[:, 2] for geom in capsules]).reshape(-1, 3)
    half = axis * model.geom_size[capsules, 1:2]
    local = np.stack([model.geom_pos[capsules] + half, model.geom_pos[capsules] - half], axis=1).reshape(-1, 3)
    end = origin[link]
    end[range(link.size), link] += local[:, plane.axes]
    floor_friction = model.geom_friction[floors, 0].max(initial=0.0)
    friction = np.repeat(np.maximum(model.geom_friction[capsules, 0], floor_friction), 2)
    margin = np.repeat(model.geom_margin[capsules] + model.geom_margin[floors].max(initial=0.0), 2)
    inverse = 2 * friction**2 * (1 + friction**2) * model.body_invweight0[link + 1, 0] / model.opt.impratio
    return {
        "end": end,
        "link": link,
        "radius": np.repeat(model.geom_size[capsules, 0], 2),
        "margin": margin,
        "friction": friction,
        "mass": 1 / inverse,
    }


def _spring(model: Any, solref: np.ndarray, solimp: np.ndarray) -> Spring:
    """MuJoCo's stiffness and damping of a (time constant, damping ratio) pair, the time at least two timesteps."""
    time, ratio = max(solref[0], 2 * model.opt.timestep), solref[1]
    least, greatest = np.clip(solimp[:2], *IMPEDANCES)
    width, middle, power = (float(value) for value in solimp[2:])
    stiffness, damping = 1 / (greatest * time * ratio) ** 2, 2 / (greatest * time)
    return Spring(float(stiffness), float(damping), float(least), float(greatest), width, middle, int(power))
