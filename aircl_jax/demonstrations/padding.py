"""Put episodes of several lengths side by side."""

from collections.abc import Mapping, Sequence

import numpy as np


def padded(episodes: Sequence[Mapping[str, np.ndarray]], horizon: int) -> dict[str, np.ndarray]:
    """Stack episodes [T_i, …] to [N, T, …], with zeros behind them and `mask`, which says where.

    An array that some episode lacks is left out. Raises ValueError where one is longer than the horizon.
    """
    lengths = [len(episode["action"]) for episode in episodes]
    if max(lengths, default=0) > horizon:
        raise ValueError(f"an episode has {max(lengths)} steps; the environment's horizon is {horizon}")
    names = set.intersection(*(set(episode) for episode in episodes)) if episodes else {"obs", "action"}
    arrays = {name: np.array([_padded(episode[name], horizon) for episode in episodes]) for name in sorted(names)}
    return {**arrays, "mask": np.array([_padded(np.ones(length), horizon) for length in lengths])}


def _padded(values: np.ndarray, horizon: int) -> np.ndarray:
    return np.pad(values, [(0, horizon - len(values)), *[(0, 0)] * (values.ndim - 1)])
