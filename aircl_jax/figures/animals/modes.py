"""Draw the modes of walking in a maze: the reward of arriving at each node, one panel a mode."""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float
from matplotlib.colors import Normalize
from matplotlib.figure import Figure

from aircl_jax.figures.grids.maze import draw_nodes
from aircl_jax.figures.style import Drawing
from envs import Maze


def draw(reward: Float[np.ndarray, "Z N"], share: Sequence[float] | Float[np.ndarray, " Z"], maze: Maze) -> Drawing:
    """Draw each mode's rewards of arriving on one scale, the commonest mode first."""
    order = np.argsort(-np.asarray(share))
    figure = Figure(figsize=(2.2 * len(order), 2.6), layout="constrained")
    axes = figure.subplots(1, len(order), squeeze=False)[0]
    bound = float(np.abs(reward).max())
    for axis, mode in zip(axes, order, strict=True):
        draw_nodes(axis, maze, reward[mode], "RdBu", Normalize(-bound, bound), "reward of arriving")
        axis.set_title(f"{share[mode]:.0%} of the moves")
    return Drawing(
        "modes",
        figure,
        "Modes of walking, each with habits of turning and a reward of arriving at each place (nats); all recordings, from the "
        "named start.",
    )
