"""Read, check and write demonstrations D_E: .npz files without pickles, and Minari data sets."""

import json
import zipfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import jax.numpy as jnp
import numpy as np

from aircl_jax.storage import replacing
from aircl_jax.types import Trajectory
from envs import Box, Discrete, Env

MINARI = "minari:"  # prefix of a Minari data set's id
FAR_OUTSIDE = 2.0  # half-widths of the action's box; half of the actions beyond it means another unit

Arrays = Mapping[str, np.ndarray]


def load(source: str | Path, env: Env) -> Trajectory:
    """Read D_E [N, T, …] from an .npz file, a Minari folder or `minari:ID`. Raises ValueError where it does not fit.

    What the source does not hold is filled: `mask` with ones, `reward` and `cost` with NaN, that is, undefined.
    """
    minari = str(source).startswith(MINARI) or Path(source).is_dir()
    try:
        arrays = _read_minari(str(source), env.horizon) if minari else _read_npz(Path(source))
        _check_shapes(arrays, env)
        _check_values(arrays)
        _check_actions(arrays["action"], env)
        if env.enumerated:
            _check_codes(arrays, env)
    except ValueError as error:
        raise ValueError(f"demonstrations={source}: {error}") from error
    return from_arrays(arrays, env)


def save(path: str | Path, trajectories: Trajectory, metadata: Mapping[str, Any]) -> None:
    """Write D_E as .npz, whole or not at all; `metadata` names its origin."""
    path = Path(path)
    arrays = {name: np.asarray(getattr(trajectories, name)) for name in ("obs", "action", "mask", "reward", "cost")}
    arrays["metadata"] = np.array(json.dumps(metadata))
    with replacing(path) as beside, beside.open("wb") as file:
        np.savez_compressed(file, allow_pickle=False, **arrays)


def metadata(path: str | Path) -> dict[str, Any]:
    """Read the metadata of an .npz file; empty where it has none."""
    return json.loads(str(_read_npz(Path(path)).get("metadata", "{}")))


def _read_npz(path: Path) -> dict[str, np.ndarray]:
    if not path.is_file():
        raise ValueError("there is no such file; give an .npz with obs and action, a Minari folder, or minari:ID")
    broken = "it is no whole .npz file; save it with numpy.savez(path, obs=…, action=…)"
    if not zipfile.is_zipfile(path):
        raise ValueError(broken)
    try:
        with path.open("rb") as file, np.load(file, allow_pickle=False) as archive:
            return {name: archive[name] for name in archive.files}
    except (OSError, EOFError, ValueError, AttributeError, zipfile.BadZipFile) as error:
        if "pickle" in str(error):
            raise ValueError("it holds pickled objects, which are not loaded; save plain arrays as .npz") from error
        raise ValueError(broken) from error


def _read_minari(source: str, horizon: int) -> dict[str, np.ndarray]:
    """Read the episodes of a Minari data set, padded to the horizon under the mask."""
    try:
        import minari
    except ImportError as error:
        raise ValueError("this needs the package minari, which is not installed") from error
    try:
        if source.startswith(MINARI):
            dataset = minari.load_dataset(source.removeprefix(MINARI))
        else:
            dataset = minari.MinariDataset(next(path for path in (Path(source, "data"), Path(source)) if path.is_dir()))
        episodes = list(dataset.iterate_episodes())
    except Exception as error:  # Minari passes on any error of its storage
        reason = (str(error) or type(error).__name__).splitlines()[0]
        raise ValueError(f"it is no Minari data set ({reason})") from error
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


def _check_shapes(arrays: Arrays, env: Env) -> None:
    for name in ("obs", "action"):
        if name not in arrays:
            raise ValueError(f"{name} is missing; it holds {', '.join(sorted(arrays)) or 'nothing'}")
    number = len(arrays["obs"]) if arrays["obs"].ndim else 0
    if number == 0:
        raise ValueError("it holds no trajectory; at least one is needed")
    steps = (number, env.horizon)
    expected = {"obs": (*steps, env.obs_size), "action": (*steps, *env.action_space.shape)}
    for name, shape in (expected | dict.fromkeys(("mask", "reward", "cost"), steps)).items():
        if name in arrays and arrays[name].shape != shape:
            raise ValueError(f"{name} has shape {list(arrays[name].shape)}; {env.name} needs {list(shape)}")


def _check_values(arrays: Arrays) -> None:
    for name in ("obs", "action", "mask", "reward", "cost"):
        values = arrays.get(name, np.zeros(()))
        if values.dtype.kind not in "fiub":
            raise ValueError(f"{name} is of type {values.dtype}; numbers are needed")
        if not np.isfinite(values).all():
            place = np.argwhere(~np.isfinite(values))[0]
            raise ValueError(f"{name} is not finite in trajectory {place[0]}, step {place[1]}")
    mask, cost = arrays.get("mask"), arrays.get("cost")
    if mask is not None and not (np.isin(mask, (0, 1)).all() and mask[:, 0].all() and _never_rises(mask)):
        raise ValueError("mask must be 1 up to an episode's last step and 0 after it")
    if cost is not None and not np.isin(cost, (0, 1)).all():
        raise ValueError("cost must be 0 or 1 in every step")


def _check_codes(arrays: Arrays, env: Env) -> None:
    one_hot = np.isin(arrays["obs"], (0, 1)).all(axis=-1) & (arrays["obs"].sum(axis=-1) == 1)
    wrong = np.argwhere(~one_hot & (arrays.get("mask", np.ones(one_hot.shape)) > 0))
    if len(wrong):
        place = f"trajectory {wrong[0][0]}, step {wrong[0][1]}"
        raise ValueError(f"obs is not one-hot in {place}; {env.name} has {env.obs_size} codes")


def _never_rises(mask: np.ndarray) -> bool:
    return bool((np.diff(mask.astype(int), axis=1) <= 0).all())


def _check_actions(action: np.ndarray, env: Env) -> None:
    space = env.action_space
    if isinstance(space, Discrete):
        choices = f"{env.name} has integers 0 to {space.n - 1}"
        if action.dtype.kind not in "iu":
            raise ValueError(f"action is of type {action.dtype}; {choices}")
        if action.min() < 0 or action.max() >= space.n:
            raise ValueError(f"action runs from {action.min()} to {action.max()}; {choices}")
    elif np.median(_half_widths(action, space)) > FAR_OUTSIDE:
        bounds = f"[{space.low:g}, {space.high:g}]"
        raise ValueError(f"half of the actions lie far outside {bounds}; scale them to the environment's unit")


def _half_widths(action: np.ndarray, space: Box) -> np.ndarray:
    """Measure |a| from the middle of the box in half-widths: 1 at the bounds."""
    middle, half = (space.high + space.low) / 2, (space.high - space.low) / 2
    return np.abs(action - middle) / half


def from_arrays(arrays: Arrays, env: Env) -> Trajectory:
    """Make trajectories [N, T, …] of checked arrays by name, filling missing ones as `load` says."""
    number, steps = arrays["obs"].shape[:2]
    ones, zeros, undefined = (np.full((number, steps), value) for value in (1.0, 0.0, np.nan))
    kind = jnp.int32 if isinstance(env.action_space, Discrete) else jnp.float32
    return Trajectory(
        obs=jnp.asarray(arrays["obs"], jnp.float32),
        action=jnp.asarray(arrays["action"], kind),
        log_prob=jnp.asarray(zeros, jnp.float32),
        value=jnp.asarray(zeros, jnp.float32),
        reward=jnp.asarray(arrays.get("reward", undefined), jnp.float32),
        cost=jnp.asarray(arrays.get("cost", undefined), jnp.float32),
        mask=jnp.asarray(arrays.get("mask", ones), jnp.float32),
        bootstrap=jnp.zeros(number),
    )
