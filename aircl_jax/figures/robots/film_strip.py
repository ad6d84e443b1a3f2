"""Draw the film strip of a robot's run: poses of demonstration and policy at even instants, over charts of the constraint."""

import numpy as np
from jaxtyping import Bool, Float
from matplotlib.axes import Axes
from matplotlib.collections import PolyCollection
from matplotlib.figure import Figure
from matplotlib.patches import Polygon

from aircl_jax.analysis.robot_scene import Scene, Side
from aircl_jax.figures.style import BLACK, BLUE, GREEN, GREY, ORANGE, Drawing

FRAMES = 12  # frames of each strip; no gait's period is near a 12th of the horizon, so the poses differ
ROUND = 10  # corners of a capsule's end
MILLIMETRES = 0.05  # m; positions of a body that stays within this are written in millimetres
NAMES = {"expert": ("demonstration", BLACK), "learned": (r"policy $\pi$", BLUE)}


def film_strip(scene: Scene, episode: int = 0) -> Drawing:
    """Draw one episode of demonstration and policy. Use within `matplotlib.rc_context(STYLE)`."""
    sides = (scene.expert, scene.learned)
    has_delta = scene.expert.delta is not None
    heights = ([1.0, 0.62] + [0.34] * has_delta) * 2
    figure = Figure(figsize=(7.2, 0.4 + sum(0.95 * height for height in heights)), layout="constrained")
    axes = figure.subplots(len(heights), 1, height_ratios=heights, squeeze=False)[:, 0]
    rows = len(heights) // 2
    half = half_extent(sides, episode)
    for place, side in enumerate(sides):
        strip, chart, *delta = axes[place * rows : (place + 1) * rows]
        shown = instants(int(side.length[episode]))
        draw_strip(strip, scene, side, episode, shown, half)
        draw_chart(chart, scene, side, episode, shown)
        for axis in delta:
            _delta(axis, scene, side, episode)
        for axis in (chart, *delta):
            axis.set_xlim(0, side.links.shape[1] * scene.stage.dt)
            axis.tick_params(labelbottom=axis is axes[-1])
    axes[-1].set_xlabel("time (s)")
    return Drawing("film_strip", figure, _caption(scene, episode))


def instants(length: int, frames: int = FRAMES) -> np.ndarray:
    """Find the middle steps of `frames` equal spans."""
    return ((np.arange(frames) + 0.5) * length / frames).astype(int)


def half_extent(sides: tuple[Side, Side], episode: int) -> Float[np.ndarray, " 2"]:
    """Compute half of the width and height of a frame around the body's middle."""
    spans = [np.abs(side.links[episode] - _middle(side.links[episode])[:, None, None]).max(axis=(0, 1, 2)) for side in sides]
    return np.max(spans, axis=0)


def _middle(links: Float[np.ndarray, "T G 2 2"]) -> Float[np.ndarray, "T 2"]:
    return links.mean(axis=(1, 2))


def draw_strip(axis: Axes, scene: Scene, side: Side, episode: int, shown: np.ndarray, half: Float[np.ndarray, " 2"]) -> None:
    """Draw the poses side by side, each moved into its frame, with its x below."""
    title, colour = NAMES[side.name]
    links, stage = side.links[episode], scene.stage
    millimetres = bool(np.abs(side.across[episode, shown]).max() < MILLIMETRES)
    pitch, middle = 2.3 * (half[0] + stage.radius.max()), _middle(links)
    ground = stage.floor if stage.floor is not None else middle[:, 1].mean()
    for place, step in enumerate(shown):
        offset = np.array([(place + 0.5) * pitch - middle[step, 0], 0.0])
        ink = ORANGE if side.violating[episode, step] else colour
        _body(axis, links[step] + offset, stage.radius, stage.branch, ink)
        if scene.wall is not None and abs(scene.wall - middle[step, 0]) < pitch / 2:
            axis.axvline(scene.wall + offset[0], color=ORANGE, ls=(0, (3, 2)), lw=0.7, zorder=4)
        where = _place(float(side.across[episode, step]), millimetres, unit=place == 0)
        axis.annotate(
            where, ((place + 0.5) / len(shown), 0), (0, -2), "axes fraction", "offset points", ha="center", va="top", color=ink
        )
    if stage.floor is not None:
        axis.axhline(ground, color=GREY, lw=0.8)
    low, high = links[..., 1].min() - stage.radius.max(), links[..., 1].max() + stage.radius.max()
    axis.set(xlim=(0, len(shown) * pitch), ylim=(min(low, ground), high), aspect="equal", anchor="C")
    axis.set_title(f"{title}: {said(side, episode)}", color=colour)
    axis.set_axis_off()


def _place(x: float, millimetres: bool, unit: bool) -> str:
    shown = f"{round(1e3 * x):d}{' mm' * unit}" if millimetres else f"{round(x, 2) + 0.0:+.2f} m"
    return shown.replace("-", "−")


def _body(axis: Axes, links: Float[np.ndarray, "G 2 2"], radius: np.ndarray, branch: np.ndarray, colour: str) -> None:
    for link in np.argsort(-branch, kind="stable"):  # the second limb is behind
        corners = _capsule(links[link], float(radius[link]))
        axis.add_patch(Polygon(corners, fc=colour, ec="white", lw=0.4, alpha=0.55 if branch[link] else 0.95, zorder=3))


def _capsule(ends: Float[np.ndarray, "2 2"], radius: float) -> Float[np.ndarray, "C 2"]:
    along = np.arctan2(*(ends[1] - ends[0])[::-1])
    turn = np.linspace(-np.pi / 2, np.pi / 2, ROUND)
    return np.concatenate(
        [
            ends[1 - k] + radius * np.stack([np.cos(along + turn + np.pi * k), np.sin(along + turn + np.pi * k)], axis=1)
            for k in (0, 1)
        ]
    )


def draw_chart(axis: Axes, scene: Scene, side: Side, episode: int, shown: np.ndarray) -> None:
    """Draw the bounded quantity over the episode: violating steps in orange, the frames' instants as ticks above."""
    length, dt = int(side.length[episode]), scene.stage.dt
    time = (np.arange(length) + 0.5) * dt
    if side.level is not None:
        axis.plot(time, side.level[episode, :length], color=NAMES[side.name][1], lw=0.7)
    else:
        axis.set_yticks([])
    for limit in scene.limits:
        axis.axhline(limit, color=ORANGE, ls=(0, (4, 2)), lw=0.8)
    axis.set_ylabel(scene.quantity or "violations")
    _shade(axis, side.violating[episode, :length], dt)
    axis.plot(time[shown], np.ones(len(shown)), "v", color=GREY, ms=2.5, transform=axis.get_xaxis_transform(), clip_on=False)


def _shade(axis: Axes, violating: Bool[np.ndarray, " T"], dt: float) -> None:
    """Shade every stretch of violating steps over the full height."""
    edges = np.flatnonzero(np.diff(np.concatenate([[0], violating.astype(int), [0]]))) * dt
    boxes = [[(a, 0), (a, 1), (b, 1), (b, 0)] for a, b in edges.reshape(-1, 2)]
    axis.add_collection(PolyCollection(boxes, fc=ORANGE, ec="none", alpha=0.3, transform=axis.get_xaxis_transform()))


def _delta(axis: Axes, scene: Scene, side: Side, episode: int) -> None:
    length = int(side.length[episode])
    if side.delta is not None:
        time = (np.arange(length) + 0.5) * scene.stage.dt
        axis.fill_between(time, side.delta[episode, :length], color=GREEN, alpha=0.3, lw=0)
        axis.plot(time, side.delta[episode, :length], color=GREEN, lw=0.6)
    axis.set(ylim=(0, 1.08), yticks=[0, 1], ylabel=r"$\delta_1$")


def said(side: Side, episode: int) -> str:
    """Describe an episode's violations and return."""
    rate, gained = side.violation_rate[episode], side.returns[episode]
    violates = f"violates in {100 * rate:.1f} % of its steps" if np.isfinite(rate) else "violations unknown"
    return violates + (f", return {gained:.1f}" if np.isfinite(gained) else "")


def _caption(scene: Scene, episode: int) -> str:
    parts = [
        f"Behaviour at {FRAMES} even instants (triangles) of one episode each.",
        f"A demonstration: {said(scene.expert, episode)}. {scene.title}: the policy {said(scene.learned, episode)}.",
        "Violating poses and steps are orange; below each frame its x.",
    ]
    if scene.quantity:
        parts.append(f"Curves: {scene.quantity} with the constraint's limit (dashed).")
    if scene.expert.delta is not None:
        parts.append("δ₁: the learned feasibility of each step.")
    return " ".join(parts + ([f"{scene.note[0].upper()}{scene.note[1:]}."] if scene.note else []))
