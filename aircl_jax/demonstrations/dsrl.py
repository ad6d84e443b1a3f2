"""Read the episodes of a DSRL file: HDF5 with the steps of all episodes one after another, and a cost beside each reward."""

from pathlib import Path
from typing import Any

import numpy as np

from aircl_jax.demonstrations.padding import padded

SUFFIXES = (".hdf5", ".h5")
ENDS = ("terminals", "timeouts")  # either is 1 in an episode's last step
OURS = {"observations": "obs", "actions": "action", "rewards": "reward", "costs": "cost"}


def is_dsrl(source: str | Path) -> bool:
    return Path(source).suffix in SUFFIXES


def read_dsrl(path: Path, horizon: int) -> dict[str, np.ndarray]:
    """Read the episodes, padded to the horizon under the mask; what follows the last end is an episode too.

    Raises ValueError, in one line, where h5py is missing, or the file is no such one.
    """
    if not path.is_file():
        raise ValueError(
            "there is no such file; give an HDF5 file with observations, actions, rewards, costs, terminals, timeouts"
        )
    steps = _steps(path)
    length = {name: len(values) for name, values in steps.items()}
    if len(set(length.values())) > 1:
        raise ValueError(
            f"its arrays have {', '.join(f'{number} {name}' for name, number in length.items())}; one a step each is needed"
        )
    ended = np.flatnonzero(np.logical_or(*(np.asarray(steps[name], bool) for name in ENDS))) + 1
    cuts = ended[ended < len(steps["actions"])]
    pieces = {ours: np.split(steps[theirs], cuts) for theirs, ours in OURS.items()}
    return padded([dict(zip(pieces, parts, strict=True)) for parts in zip(*pieces.values(), strict=True)], horizon)


def _steps(path: Path) -> dict[str, Any]:
    try:
        import h5py
    except ImportError as error:
        raise ValueError("this needs the package h5py, which is not installed; install aircl-jax[minari]") from error
    try:
        with h5py.File(path) as file:
            missing = [name for name in (*OURS, *ENDS) if name not in file]
            if missing:
                raise ValueError(f"{', '.join(missing)} missing; it holds {', '.join(sorted(file)) or 'nothing'}")
            return {name: np.asarray(file[name]) for name in (*OURS, *ENDS)}
    except OSError as error:
        raise ValueError(f"it is no HDF5 file ({str(error).splitlines()[0]})") from error
