"""Draw a world of nodes as a maze: the recovered reward of arriving at each node, and where the animals were."""

from collections.abc import Iterator

import matplotlib as mpl
import numpy as np
from jaxtyping import Float, Int
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.colors import LogNorm, Normalize
from matplotlib.figure import Figure

from aircl_jax.analysis.recovered import Recovered, rank_agreement
from aircl_jax.figures.style import BLACK, GREY, Drawing
from envs import Maze

LABEL_AT = {"home": (6, -6.2)}  # offset of a label from its node in points: between the corridor and the leaves below it


def draw(recovered: Recovered, maze: Maze, title: str) -> Iterator[Drawing]:
    """Draw the maze coloured by reward, by visits and, where the method learns it, by feasibility."""
    if np.isfinite(recovered.reward).all():
        yield maze_map(recovered, maze, title)


def arriving(values: Float[np.ndarray, "S X A"], maze: Maze, seen: Int[np.ndarray, "X A"]) -> Float[np.ndarray, "S X"]:
    """Average over the moves to each node from another, weighted as in D_E; NaN where D_E never arrives."""
    moved = np.where(maze.successor == np.arange(len(maze.successor))[:, None], 0, seen)
    weight = np.zeros(len(seen))
    np.add.at(weight, maze.successor, moved)
    total = np.zeros((len(values), len(seen)))
    for seed, values_moved in enumerate(values * moved):
        np.add.at(total[seed], maze.successor, values_moved)
    return np.where(weight > 0, total / np.maximum(weight, 1), np.nan)


def maze_map(recovered: Recovered, maze: Maze, title: str) -> Drawing:
    """Draw the reward of arriving at each node beside the number of visits, and the feasibility of steps where there is one."""
    reward, visits = arriving(recovered.reward, maze, recovered.seen), recovered.seen.sum(axis=1)
    has_feasibility = bool(np.isfinite(recovered.delta).all())
    panels = 3 if has_feasibility else 2
    figure = Figure(figsize=(2.5 * panels, 2.75), layout="constrained")
    axes = figure.subplots(1, panels)
    mean = reward.mean(axis=0)
    bound = float(np.nanmax(np.abs(mean)))
    draw_nodes(axes[0], maze, mean, "RdBu", Normalize(-bound, bound), "reward of arriving")
    draw_nodes(axes[1], maze, np.where(visits > 0, visits, np.nan), "magma_r", LogNorm(), "steps recorded there")
    if has_feasibility:
        delta = arriving(recovered.delta, maze, np.ones_like(recovered.seen)).mean(axis=0)
        draw_nodes(axes[2], maze, delta, "viridis", Normalize(0, 1), "feasibility of arriving")
    known = np.flatnonzero(np.isfinite(mean))
    order = known[np.argsort(-mean[known])]
    places = "; ".join(
        f"{name} is rank {int(np.argmax(order == node)) + 1}" for name, node in maze.marks.items() if node in order
    )
    ranks = rank_agreement(reward[:, known])
    stable = f" Rank correlation of the nodes between seeds {ranks.mean():.2f} (least {ranks.min():.2f})." if len(ranks) else ""
    return Drawing(
        "maze",
        figure,
        f"The maze, {title}: recovered reward of arriving at a node (mean over seeds, 0 the average step; grey: never entered) "
        f"and where the animals were. Of {len(known)} nodes by reward {places}.{stable}",
    )


def draw_nodes(axis: Axes, maze: Maze, values: Float[np.ndarray, " X"], colours: str, norm: Normalize, label: str) -> None:
    source, action = np.nonzero(maze.successor != np.arange(len(maze.successor))[:, None])
    lines = np.stack([maze.position[source], maze.position[maze.successor[source, action]]], axis=1)
    axis.add_collection(LineCollection(list(lines), colors=GREY, lw=1.2, zorder=1))
    cmap = mpl.colormaps[colours].with_extremes(bad="#dddddd")
    image = axis.scatter(
        *maze.position.T,
        c=np.ma.masked_invalid(values),
        cmap=cmap,
        norm=norm,
        s=26,
        ec=BLACK,
        lw=0.3,
        zorder=2,
        plotnonfinite=True,
    )
    axis.figure.colorbar(image, ax=axis, orientation="horizontal", label=label, shrink=0.8, pad=0.02)
    for name, node in maze.marks.items():
        axis.annotate(
            name,
            maze.position[node],
            xytext=LABEL_AT.get(name, (8, 8)),
            textcoords="offset points",
            fontsize=6.5,
            weight="bold",
            bbox={"boxstyle": "round,pad=0.15", "fc": "white", "ec": "none", "alpha": 0.85},
            arrowprops={"arrowstyle": "-", "lw": 0.7},
            zorder=4,
        )
        axis.scatter(*maze.position[node], s=52, fc="none", ec=BLACK, lw=1.2, zorder=3)
    axis.set_aspect("equal")
    axis.axis("off")
