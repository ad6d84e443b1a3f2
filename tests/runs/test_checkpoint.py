"""Checkpoints: whole or absent under any name, read back when they are written, and every damage noticed."""

import json
import random
import shutil
import tempfile
from pathlib import Path

import jax
import numpy as np
import pytest

from aircl_jax.runs import checkpoint
from tests.runs.test_opening import opened, trained

TREE = {"weights": np.linspace(0, 1, 50, dtype=np.float32).reshape(5, 10), "nan": np.array(np.nan, np.float32)}


def saved(path: Path, notes=None) -> Path:
    checkpoint.save(path, TREE, notes or {"metrics": "abc"})
    return path


@pytest.mark.parametrize("name", ["plain", "run[1]", "back\\slash", "star*", "what?", "{a,b}", "per%20cent", "δ₁ ü", "#1", "~"])
def test_a_checkpoint_is_read_again_whatever_the_folder_is_called(name, tmp_path):
    folder = tmp_path / name
    folder.mkdir()
    path = saved(folder / "00000001")
    restored = checkpoint.load(path, TREE)
    assert all(np.array_equal(restored[leaf], TREE[leaf], equal_nan=True) for leaf in TREE)
    assert [entry.name for entry in folder.iterdir()] == ["00000001"]
    assert checkpoint.notes_of(path) == {"metrics": "abc"}


def test_a_name_that_orbax_trips_over_is_refused_where_the_temporary_folder_has_one_too(tmp_path, monkeypatch):
    (tmp_path / "tmp[1]").mkdir()
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path / "tmp[1]"))
    with pytest.raises(OSError, match="set TMPDIR"):
        saved(tmp_path / "run[1]")


def test_keys_are_saved_as_keys(tmp_path):
    tree = {"key": jax.random.key(7)}
    checkpoint.save(tmp_path / "one", tree, {})
    assert jax.random.key_data(checkpoint.load(tmp_path / "one", tree)["key"]).tolist() == [0, 7]


def test_what_the_disk_gives_back_otherwise_is_not_kept(tmp_path, monkeypatch):
    other = TREE | {"nan": np.array(1.0, np.float32)}
    monkeypatch.setattr(checkpoint, "_read_back", lambda folder, names: iter(other.values()))
    with pytest.raises(OSError, match="the numbers read back are not those written"):
        saved(tmp_path / "one")
    assert not (tmp_path / "one").exists()


def test_a_tree_of_other_shapes_is_of_another_version(tmp_path):
    with pytest.raises(ValueError, match="is of another version"):
        checkpoint.load(saved(tmp_path / "one"), TREE | {"more": np.zeros(3)})


def damaged(copy: Path, draw: random.Random) -> None:
    """Damage one file of a checkpoint: a byte, its end, its name, its place, or all of it."""
    file = draw.choice(sorted(path for path in copy.rglob("*") if path.is_file()))
    data = bytearray(file.read_bytes())
    kind = draw.randrange(8)
    if kind <= 2:
        data[draw.randrange(len(data))] ^= 1 << draw.randrange(8)
        file.write_bytes(data)
    elif kind == 3:
        file.write_bytes(data[: draw.randrange(len(data))])
    elif kind == 4:
        file.write_bytes(data + draw.randbytes(draw.randrange(1, 9)))
    elif kind == 5:
        file.unlink()
    elif kind == 6:
        file.rename(file.with_name(file.name + "_"))
    else:
        (copy / "arrays" / "stray").write_bytes(data)


@pytest.mark.parametrize("count", [40, pytest.param(1000, marks=pytest.mark.slow)])
def test_every_damage_is_found_and_the_older_checkpoint_goes_on(count, tmp_path):
    trained(tmp_path / "run")
    whole, newest = tmp_path / "whole", tmp_path / "run" / "state" / "00000008"
    shutil.copytree(newest, whole)
    draw, missed, going_on = random.Random(0), [], 0
    for number in range(count):
        shutil.rmtree(newest)
        shutil.copytree(whole, newest)
        damaged(newest, draw)
        if (newest / "checksum.json").is_file() and _says_the_same(newest, whole):
            continue  # white space or the like, in the file of the checksum alone
        try:
            start = opened(tmp_path / "run", "resume").start
        except ValueError:
            continue
        going_on += start == 6
        missed += [number] * (start == 8)
    assert missed == []
    assert going_on >= 0.99 * count


def _says_the_same(newest: Path, whole: Path) -> bool:
    """Whether nothing but white space of the checksum's file differs."""
    try:
        found, right = (json.loads((path / "checksum.json").read_bytes()) for path in (newest, whole))
    except ValueError:
        return False
    return found == right and _arrays(newest) == _arrays(whole)


def _arrays(path: Path) -> dict[Path, bytes]:
    files = [file for file in (path / "arrays").rglob("*") if file.is_file()]
    return {file.relative_to(path): file.read_bytes() for file in files}
