"""Save and load a pytree as an Orbax directory, which is whole or absent and is checked when read."""

import json
import shutil
import zlib
from pathlib import Path
from typing import Any, TypeVar

import jax
import jax.numpy as jnp
import numpy as np

T = TypeVar("T")

_CHECKSUM = "checksum.json"
_ARRAYS = "arrays"


def save(path: Path, tree: Any) -> None:
    """Write the tree's leaves under their names, into a folder beside `path` that is then renamed.

    After a kill at any moment `path` is whole or absent.
    """
    import orbax.checkpoint

    beside = path.with_name(f".saving-{path.name}")
    shutil.rmtree(beside, ignore_errors=True)
    arrays = _named_arrays(tree)
    with orbax.checkpoint.StandardCheckpointer() as checkpointer:
        checkpointer.save(beside.absolute() / _ARRAYS, arrays)
    (beside / _CHECKSUM).write_text(json.dumps({"crc32": _crc32(beside / _ARRAYS)}))
    beside.rename(path)


def load(path: Path, like: T) -> T:
    """Load the tree saved at `path` into the structure of `like` (arrays or their shapes).

    Raises ValueError where it is damaged or of another version.
    """
    import orbax.checkpoint

    # Check before Orbax reads: at one damaged file among several, its other reads fail noisily later.
    if not _is_whole(path):
        raise ValueError(f"the checkpoint {path} is damaged or cut short; use overwrite=true to start again")
    with orbax.checkpoint.StandardCheckpointer() as checkpointer:
        arrays = {name: np.asarray(leaf) for name, leaf in checkpointer.restore(path.absolute() / _ARRAYS).items()}
    names, leaves, structure = _names_and_leaves(like)
    shapes = {name: leaf.shape for name, leaf in zip(names, jax.eval_shape(_raw_all, leaves), strict=True)}
    if {name: array.shape for name, array in arrays.items()} != shapes:
        raise ValueError(f"the checkpoint {path} is of another version; use overwrite=true to start again")
    restored = [_typed(arrays[name], leaf.dtype) for name, leaf in zip(names, leaves, strict=True)]
    return jax.tree.unflatten(structure, restored)


def _typed(array: np.ndarray, dtype: Any) -> jax.Array:
    leaf = jnp.asarray(array)
    return jax.random.wrap_key_data(leaf) if jax.dtypes.issubdtype(dtype, jax.dtypes.prng_key) else leaf


def _named_arrays(tree: Any) -> dict[str, np.ndarray]:
    names, leaves, _ = _names_and_leaves(tree)
    return dict(zip(names, jax.device_get(_raw_all(leaves)), strict=True))


def _names_and_leaves(tree: Any) -> tuple[list[str], list[Any], Any]:
    paths, structure = jax.tree.flatten_with_path(tree)
    return (
        [jax.tree_util.keystr(path, simple=True, separator=".") for path, _ in paths],
        [x for _, x in paths],
        structure,
    )


def _raw_all(leaves: list[Any]) -> list[Any]:
    """Replace typed keys by their integers."""

    def raw(leaf: Any) -> Any:
        return jax.random.key_data(leaf) if jax.dtypes.issubdtype(leaf.dtype, jax.dtypes.prng_key) else leaf

    return [raw(leaf) for leaf in leaves]


def _is_whole(path: Path) -> bool:
    try:
        return json.loads((path / _CHECKSUM).read_text())["crc32"] == _crc32(path / _ARRAYS)
    except (OSError, ValueError, KeyError, TypeError):
        return False


def _crc32(directory: Path) -> int:
    """Compute the checksum of the names and bytes of every file below the directory."""
    checksum = 0
    for file in sorted(path for path in directory.rglob("*") if path.is_file()):
        name = file.relative_to(directory).as_posix()
        checksum = zlib.crc32(file.read_bytes(), zlib.crc32(name.encode(), checksum))
    return checksum
