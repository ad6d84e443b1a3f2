"""Read the episodes of a Minari data set, by its id or from its folder."""

from pathlib import Path
from typing import Any

import numpy as np

MINARI = "minari:"  # prefix of a Minari data set's id


def is_minari(source: str | Path) -> bool:
    return str(source).startswith(MINARI) or Path(source).is_dir()


def read_minari(source: str, horizon: int) -> dict[str, np.ndarray]:
    """Read the episodes, padded to the horizon under the mask. Raises ValueError where they are not of one vector a step."""
    episodes = _episodes(source)
    longest = max((len(episode.actions) for episode in episodes), default=0)
    if longest > horizon:
        raise ValueError(f"an episode has {longest} steps; the environment's horizon is {horizon}")

    def padded(values: Any) -> np.ndarray:
        values = np.asarray(values)
        return np.pad(values, [(0, horizon - len(values)), *[(0, 0)] * (values.ndim - 1)])

    return {
        "obs": np.array([padded(episode.observations[: len(episode.actions)]) for episode in episodes]),
        "action": np.array([padded(episode.actions) for episode in episodes]),
        "reward": np.array([padded(episode.rewards) for episode in episodes]),
        "mask": np.array([padded(np.ones(len(episode.actions))) for episode in episodes]),
    }


def _episodes(source: str) -> list[Any]:
    try:
        import minari
    except ImportError as error:
        raise ValueError("this needs the package minari, which is not installed; install aircl-jax[minari]") from error
    try:
        if source.startswith(MINARI):
            dataset = minari.load_dataset(source.removeprefix(MINARI))
        else:
            dataset = minari.MinariDataset(next(path for path in (Path(source, "data"), Path(source)) if path.is_dir()))
        spaces = {"observations": dataset.observation_space, "actions": dataset.action_space}
        episodes = list(dataset.iterate_episodes())
    except Exception as error:  # Minari passes on any error of its storage
        reason = (str(error) or type(error).__name__).splitlines()[0]
        raise ValueError(f"it is no Minari data set ({reason})") from error
    for what, space in spaces.items():
        if not all(isinstance(getattr(episode, what), np.ndarray) for episode in episodes):
            raise ValueError(f"its {what} are of a {type(space).__name__} space; choose a data set with one array a step")
    return episodes
