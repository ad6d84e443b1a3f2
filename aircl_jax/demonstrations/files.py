"""Read, check and write demonstrations D_E: .npz files without pickles, Minari data sets and DSRL files."""

import json
from collections.abc import Mapping, Sequence
from contextlib import AbstractContextManager
from pathlib import Path
from typing import Any

import jax.numpy as jnp
import numpy as np

from aircl_jax.demonstrations import npz
from aircl_jax.demonstrations.dsrl import is_dsrl, read_dsrl
from aircl_jax.demonstrations.minari_data import is_minari, read_minari
from aircl_jax.storage import replacing
from aircl_jax.types import Trajectory
from envs import Discrete, Env

NAMES = ("obs", "action", "mask", "reward", "cost")
LARGEST = 1e18  # of a value; beyond it the square is none in single precision
FAR_OUTSIDE = 2.0  # half-widths of the action's box; half of the actions beyond it means another unit

Arrays = Mapping[str, np.ndarray]


def load(source: str | Path, env: Env) -> Trajectory:
    """Read D_E [N, T, …] from an .npz file, a Minari folder, `minari:ID` or a DSRL file (.hdf5).

    What the source does not hold is filled: `mask` with ones, `reward` and `cost` with NaN, that is, undefined.
    Raises ValueError, in one line, where it does not fit.
    """
    try:
        arrays = _read(source, env)
        _check_values(arrays)
        _check_actions(arrays["action"], env)
        if env.enumerated:
            _check_codes(arrays, env)
    except ValueError as error:
        raise ValueError(f"demonstrations={source}: {' '.join(str(error).split())}") from error
    except OSError as error:
        raise ValueError(f"demonstrations={source}: it cannot be read: {error.strerror}") from error
    return from_arrays(arrays, env)


def _read(source: str | Path, env: Env) -> dict[str, np.ndarray]:
    """Read the arrays of NAMES, where their shapes fit the environment."""
    if not str(source).strip():
        raise ValueError("the name is empty; give an .npz file, a Minari folder or minari:ID, or leave the setting out")
    if is_minari(source) or is_dsrl(source):
        minari = is_minari(source)
        arrays = read_minari(str(source), env.horizon) if minari else read_dsrl(Path(source), env.horizon)
        _check_shapes({name: npz.Header(array.shape, array.dtype) for name, array in arrays.items()}, env)
        return arrays
    with _archive(Path(source)) as archive:
        headers = archive.headers(NAMES)
        _check_shapes(headers, env, list(archive.members))
        return archive.read(list(headers))


def _archive(path: Path) -> AbstractContextManager[npz.Archive]:
    if not path.is_file():
        raise ValueError("there is no such file; give an .npz with obs and action, a Minari folder, or minari:ID")
    return npz.opened(path)


def save(path: str | Path, trajectories: Trajectory, metadata: Mapping[str, Any]) -> None:
    """Write D_E as .npz, whole or not at all; `metadata` names its origin. An undefined reward or cost is left out."""
    path = Path(path)
    arrays = {name: np.asarray(getattr(trajectories, name)) for name in NAMES}
    arrays = {name: values for name, values in arrays.items() if not np.isnan(values).any()}
    arrays["metadata"] = np.array(json.dumps(metadata))
    with replacing(path) as beside, beside.open("wb") as file:
        np.savez_compressed(file, allow_pickle=False, **arrays)


def metadata(path: str | Path) -> dict[str, Any]:
    """Read the metadata of an .npz file; empty where it has none."""
    with _archive(Path(path)) as archive:
        return json.loads(str(archive.read(list(archive.headers(["metadata"]))).get("metadata", "{}")))


def _check_shapes(headers: Mapping[str, npz.Header], env: Env, held: Sequence[str] = ()) -> None:
    """Raise ValueError for an array that is missing or of another shape or type; `held` names all that the source has."""
    for name in ("obs", "action"):
        if name not in headers:
            raise ValueError(f"{name} is missing; it holds {', '.join(sorted(held or headers)) or 'nothing'}")
    for name, header in headers.items():
        if header.dtype.kind not in "fiub":
            raise ValueError(f"{name} is of type {header.dtype}; numbers are needed")
    number = next(iter(headers["obs"].shape), 0)
    if number == 0:
        raise ValueError("it holds no trajectory; at least one is needed")
    steps = (number, env.horizon)
    expected = {"obs": (*steps, env.obs_size), "action": (*steps, *env.action_space.shape)}
    for name, shape in (expected | dict.fromkeys(("mask", "reward", "cost"), steps)).items():
        if name in headers and headers[name].shape != shape:
            raise ValueError(f"{name} has shape {list(headers[name].shape)}; {env.name} needs {list(shape)}")


def _check_values(arrays: Arrays) -> None:
    """Raise ValueError for a value that is not finite in the single precision of training, or that is no mask or cost."""
    for name in NAMES:
        values = arrays.get(name, np.zeros(()))
        with np.errstate(over="ignore", invalid="ignore"):
            wrong = np.argwhere(~(np.abs(values.astype(np.float32)) <= LARGEST))
        if len(wrong):
            value = values[tuple(wrong[0])]
            what = f"is {value:.3g}, beyond {LARGEST:g}," if np.isfinite(value) else "is not finite"
            raise ValueError(f"{name} {what} in trajectory {wrong[0][0]}, step {wrong[0][1]}")
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
    elif np.median(np.abs(action - space.middle) / space.half_width) > FAR_OUTSIDE:
        bounds = f"[{space.low:g}, {space.high:g}]"
        raise ValueError(f"half of the actions lie far outside {bounds}; scale them to the environment's unit")


def from_arrays(arrays: Arrays, env: Env) -> Trajectory:
    """Make trajectories [N, T, …] of checked arrays by name, filling missing ones as `load` says."""
    number, steps = arrays["obs"].shape[:2]
    ones, zeros, undefined = (np.full((number, steps), value) for value in (1.0, 0.0, np.nan))
    kind = np.int32 if isinstance(env.action_space, Discrete) else np.float32
    return Trajectory(
        obs=jnp.asarray(np.asarray(arrays["obs"], np.float32)),
        action=jnp.asarray(np.asarray(arrays["action"], kind)),
        log_prob=jnp.asarray(zeros, jnp.float32),
        value=jnp.asarray(zeros, jnp.float32),
        reward=jnp.asarray(arrays.get("reward", undefined), jnp.float32),
        cost=jnp.asarray(arrays.get("cost", undefined), jnp.float32),
        mask=jnp.asarray(arrays.get("mask", ones), jnp.float32),
        bootstrap=jnp.zeros(number),
    )
