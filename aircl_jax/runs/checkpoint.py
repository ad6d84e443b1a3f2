"""Save and load a pytree as an Orbax directory, which is whole or absent and is checked when written and when read."""

import json
import re
import shutil
import tempfile
import zlib
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any, TypeVar

import jax
import jax.numpy as jnp
import numpy as np

from aircl_jax.storage import sync, sync_tree

T = TypeVar("T")

_CHECKSUM = "checksum.json"
_ARRAYS = "arrays"
_PART = 1 << 24  # bytes of a file that are read at once
_PLAIN = re.compile(r"([A-Za-z]:)?[\w./+=,@ -]*")  # a path without letters that Orbax takes for a pattern or an address


def save(path: Path, tree: Any, notes: Mapping[str, Any]) -> None:
    """Write the tree's leaves under their names, and the notes, into a folder beside `path` that is then renamed.

    After a kill or a power cut at any moment `path` is whole or absent. Raises OSError where the disk refuses, or gives
    back other numbers than it was given.
    """
    beside = path.with_name(f".saving-{path.name}")
    shutil.rmtree(beside, ignore_errors=True)
    beside.mkdir(parents=True)
    arrays = _named_arrays(tree)
    try:
        with _plain_place(beside) as place:
            with _checkpointer() as checkpointer:
                checkpointer.save(place / _ARRAYS, arrays)
            same = all(map(_same, arrays.values(), _read_back(place, arrays)))
            if place != beside.absolute():
                shutil.copytree(place / _ARRAYS, beside / _ARRAYS)
    except OSError:
        raise
    except Exception as error:  # TensorStore's errors of the disk are no OSErrors
        raise OSError(" ".join(str(error).split())[:200] or type(error).__name__) from error
    if not same:
        raise OSError("the numbers read back are not those written")
    checksum = {"crc32": _crc32(beside / _ARRAYS, notes), "notes": notes}
    (beside / _CHECKSUM).write_text(json.dumps(checksum), encoding="utf-8")
    sync_tree(beside)
    beside.rename(path)
    sync(path.parent)


def load(path: Path, like: T) -> T:
    """Load the tree saved at `path` into the structure of `like` (arrays or their shapes).

    Raises ValueError where it is damaged or of another version.
    """
    # Check before Orbax reads: at one damaged file among several, its other reads fail noisily later.
    if not is_whole(path):
        raise ValueError(f"the checkpoint {path} is damaged or cut short; use overwrite=true to start again")
    try:
        with _plain_place(path, _ARRAYS) as place:
            arrays = _restored(place)
    except Exception as error:
        raise ValueError(f"the checkpoint {path} cannot be read; use overwrite=true to start again") from error
    names, leaves, structure = _names_and_leaves(like)
    shapes = {name: leaf.shape for name, leaf in zip(names, jax.eval_shape(_raw_all, leaves), strict=True)}
    if {name: array.shape for name, array in arrays.items()} != shapes:
        raise ValueError(
            f"the checkpoint {path} is of another version; read it with the one that wrote it, or train anew (overwrite=true)"
        )
    restored = [_typed(arrays[name], leaf.dtype) for name, leaf in zip(names, leaves, strict=True)]
    return jax.tree.unflatten(structure, restored)


def is_whole(path: Path) -> bool:
    """Say whether the checkpoint's files and notes are those that were written."""
    try:
        checksum = _checksum(path)
        return checksum["crc32"] == _crc32(path / _ARRAYS, checksum.get("notes"))
    except (OSError, ValueError, KeyError, TypeError, AttributeError, RecursionError):
        return False


def notes_of(path: Path) -> Mapping[str, Any]:
    """Return the notes of a whole checkpoint; none of one from before there were any."""
    return _checksum(path).get("notes") or {}


def _checksum(path: Path) -> dict[str, Any]:
    return json.loads((path / _CHECKSUM).read_bytes())


@contextmanager
def _plain_place(folder: Path, copied: str = "") -> Iterator[Path]:
    """Yield the folder itself, or a temporary one with its subfolder `copied` where Orbax trips over the folder's name."""
    absolute = folder.absolute()
    if _PLAIN.fullmatch(absolute.as_posix()):
        yield absolute
        return
    with tempfile.TemporaryDirectory() as temporary:
        place = Path(temporary).absolute()
        if not _PLAIN.fullmatch(place.as_posix()):
            raise OSError(f"neither its name nor that of the folder for temporary files, {place}, suits Orbax; set TMPDIR")
        if copied:
            shutil.copytree(absolute / copied, place / copied)
        yield place


def _checkpointer() -> Any:
    """Make an Orbax checkpointer that waits for no other process of a world, because the first alone saves and loads."""
    import orbax.checkpoint

    here = jax.process_index()
    alone = {"primary_host": here, "active_processes": {here}, "barrier_sync_key_prefix": f"process_{here}"}
    options = orbax.checkpoint.options.MultiprocessingOptions(**alone if jax.process_count() > 1 else {})
    return orbax.checkpoint.StandardCheckpointer(multiprocessing_options=options)


def _restored(folder: Path) -> dict[str, np.ndarray]:
    with _checkpointer() as checkpointer:
        return {name: np.asarray(leaf) for name, leaf in checkpointer.restore(folder / _ARRAYS).items()}


def _read_back(folder: Path, names: Iterable[str]) -> Iterator[np.ndarray]:
    """Read what was just written, one array after another, in a tenth of the time that Orbax takes."""
    import tensorstore

    database = {"driver": "ocdbt", "base": {"driver": "file", "path": f"{(folder / _ARRAYS).as_posix()}/"}}
    arrays = [{"driver": "zarr", "kvstore": {**database, "path": f"{name}/"}} for name in names]
    once = tensorstore.Context()  # the database is opened once for all arrays
    for store in [tensorstore.open(array, context=once, open=True, read=True) for array in arrays]:
        yield np.asarray(store.result().read().result())


def _same(written: np.ndarray, read: np.ndarray) -> bool:
    """Compare by bytes, because NaN is not equal to itself."""
    if written.shape != read.shape or written.dtype != read.dtype:
        return False
    one, other = (np.ascontiguousarray(array).reshape(-1).view(np.uint8) for array in (written, read))
    return np.array_equal(one, other)


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


def _crc32(directory: Path, notes: Mapping[str, Any] | None) -> int:
    """Compute the checksum of the notes, where there are any, and of the names and bytes of every file below the directory."""
    checksum = 0 if notes is None else zlib.crc32(json.dumps(notes, sort_keys=True).encode())
    for file in sorted(path for path in directory.rglob("*") if path.is_file()):
        checksum = zlib.crc32(file.relative_to(directory).as_posix().encode(), checksum)
        with file.open("rb") as content:
            while part := content.read(_PART):
                checksum = zlib.crc32(part, checksum)
    return checksum
