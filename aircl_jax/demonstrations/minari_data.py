"""Read the episodes of a Minari data set, by its id or from its folder, and write demonstrations as one."""

import re
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any, Literal

import numpy as np

from aircl_jax.demonstrations.padding import padded
from aircl_jax.types import Trajectory
from envs import Box, Env

MINARI = "minari:"  # prefix of a Minari data set's id
KEY = "@"  # between a data set and the part of its observations to read
MISSING = "this needs the package minari, which is not installed; install aircl-jax[minari]"
_ID = re.compile(r"(?:[\w-]+/)*[\w-]+-v\d+", re.ASCII)

Format = Literal["arrow", "hdf5"]


def is_minari(source: str | Path) -> bool:
    return str(source).startswith(MINARI) or Path(_split(str(source))[0]).is_dir()


def read_minari(source: str, horizon: int) -> dict[str, np.ndarray]:
    """Read the episodes, padded to the horizon under the mask, with `cost` where their infos hold it.

    Raises ValueError where they are not of one vector a step.
    """
    source, key = _split(source)
    return padded([_arrays(episode) for episode in _episodes(source, key)], horizon)


def write_minari(name: str, trajectories: Trajectory, env: Env, about: str, data_format: Format = "arrow") -> None:
    """Write trajectories [N, T, …] as a data set of Minari, the true cost of each step in its infos.

    Minari keeps an observation more than there are actions: the one after the last step, which ours do not hold, repeats the
    last. A reward that nobody knows is NaN.

    Raises:
        ValueError: in one line, where minari is missing, the name is none of its ids, or it is taken.
    """
    try:
        import minari
        from gymnasium import spaces
        from minari.data_collector import EpisodeBuffer
    except ImportError as error:
        raise ValueError(MISSING) from error
    if not _ID.fullmatch(name):
        raise ValueError(f"minari={name} is no id of a data set; write one as in minari=own/swimmer-v0")
    space = env.action_space
    actions = spaces.Box(space.low, space.high, space.shape, np.float32) if isinstance(space, Box) else spaces.Discrete(space.n)
    if (
        isinstance(space, Box)
        and (np.asarray(trajectories.action) > space.high).any() | (np.asarray(trajectories.action) < space.low).any()
    ):
        actions = spaces.Box(-np.inf, np.inf, space.shape, np.float32)  # as they were before the world clipped them
    buffers = [EpisodeBuffer(id=number, **_episode(one, env)) for number, one in enumerate(_each(trajectories))]
    try:
        minari.create_dataset_from_buffers(
            name,
            buffers,
            observation_space=spaces.Box(-np.inf, np.inf, (env.obs_size,), np.float32),
            action_space=actions,
            data_format=data_format,
            author="aircl-jax",
            author_email="none",
            code_permalink="none",
            algorithm_name="unknown",
            description=about,
        )
    except ValueError as error:
        raise ValueError(f"minari={name}: {str(error).splitlines()[0]}") from error


def _each(trajectories: Trajectory) -> list[dict[str, np.ndarray]]:
    """Cut every trajectory where it ends."""
    names = ("obs", "action", "reward", "cost")
    lengths = np.asarray(trajectories.mask).sum(axis=1).astype(int)
    whole = {name: np.asarray(getattr(trajectories, name)) for name in names}
    return [{name: values[number, :length] for name, values in whole.items()} for number, length in enumerate(lengths)]


def _episode(steps: Mapping[str, np.ndarray], env: Env) -> dict[str, Any]:
    length = len(steps["action"])
    ends = np.arange(1, length + 1) == length
    early = length < env.horizon or env.finite_horizon
    known = not np.isnan(steps["cost"]).any()
    return {
        "observations": np.concatenate([steps["obs"], steps["obs"][-1:]]),
        "actions": steps["action"],
        "rewards": steps["reward"],
        "terminations": ends & early,
        "truncations": ends & (not early),
        "infos": {"cost": [0.0, *steps["cost"].tolist()]} if known else {},
    }


def _arrays(episode: Any) -> dict[str, np.ndarray]:
    length = len(episode.actions)
    found = {"obs": np.asarray(episode.observations[:length]), "action": np.asarray(episode.actions)}
    if not np.isnan(rewards := np.asarray(episode.rewards)).all():
        found["reward"] = rewards
    infos = episode.infos if isinstance(episode.infos, Mapping) else {}
    if "cost" in infos:
        found["cost"] = np.asarray(infos["cost"])[-length:]  # the reset has infos too, before the first step
    return found


def _split(source: str) -> tuple[str, str]:
    """Part a data set's name from the key of its observations, empty where none is named."""
    name, _, key = source.rpartition(KEY)
    return (source, "") if not name or Path(source).is_dir() else (name, key)


def _episodes(source: str, key: str) -> list[Any]:
    try:
        import minari
    except ImportError as error:
        raise ValueError(MISSING) from error
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
    parts = sorted(getattr(spaces["observations"], "spaces", {})) if type(spaces["observations"]).__name__ == "Dict" else []
    if parts and key in parts:
        episodes = [replace(episode, observations=episode.observations[key]) for episode in episodes]
    elif parts or key:
        asked = f"its observations have no part {key!r}" if key else "its observations are of a Dict space"
        raise ValueError(
            f"{asked}; " + (f"name one of {', '.join(parts)}, as in {source}{KEY}{parts[0]}" if parts else "leave it out")
        )
    for what, space in spaces.items():
        if not all(isinstance(getattr(episode, what), np.ndarray) for episode in episodes):
            raise ValueError(f"its {what} are of a {type(space).__name__} space; choose a data set with one array a step")
    return episodes
