"""Files written whole, errors of the disk in one line, and a lock on systems of either kind."""

import os
import sys
import types

import pytest

from aircl_jax import storage
from aircl_jax.storage import DiskError, append, disk, locked, replacing, write_whole


def test_a_file_is_written_in_utf_8_with_one_byte_a_newline_and_nothing_is_left_beside_it(tmp_path):
    write_whole(tmp_path / "a", "δ\n")
    append(tmp_path / "a", "x\n")
    assert (tmp_path / "a").read_bytes() == b"\xce\xb4\nx\n"
    assert [path.name for path in tmp_path.iterdir()] == ["a"]


def test_after_an_error_the_old_file_is_there(tmp_path):
    write_whole(tmp_path / "a", "old")
    with pytest.raises(TypeError), replacing(tmp_path / "a") as beside:
        beside.write_text(b"half")  # pyright: ignore[reportArgumentType]
    assert (tmp_path / "a").read_text() == "old"
    assert [path.name for path in tmp_path.iterdir()] == ["a"]


def test_an_error_of_the_disk_names_path_reason_and_what_to_do(tmp_path):
    with pytest.raises(DiskError) as refused, disk(tmp_path, "free some"):
        raise OSError(28, "No space left on device")
    assert str(refused.value) == f"{tmp_path} cannot be written: No space left on device; free some"
    with pytest.raises(DiskError, match="cannot be written: no words of the system's; free some"), disk(tmp_path, "free some"):
        raise OSError("no words of the system's")


def test_a_folder_is_locked_once_and_free_afterwards(tmp_path):
    with locked(tmp_path) as first, locked(tmp_path) as second:
        assert (first, second) == (True, False)
    with locked(tmp_path) as again:
        assert again
    assert list(tmp_path.iterdir()) == []


def test_where_the_system_has_no_lock_a_folder_is_free(tmp_path, monkeypatch):
    monkeypatch.setattr(storage.importlib.util, "find_spec", lambda name: None)
    with locked(tmp_path) as first, locked(tmp_path) as second:
        assert (first, second) == (True, True)


def test_a_file_system_without_locks_is_free(tmp_path, monkeypatch):
    import fcntl

    def unsupported(*_):
        raise OSError(95, "Operation not supported")

    monkeypatch.setattr(fcntl, "flock", unsupported)
    with locked(tmp_path) as ours:
        assert ours


def test_windows_locks_a_file_within_the_folder(tmp_path, monkeypatch):
    held = []

    def locking(handle, mode, length):
        if held:
            raise PermissionError(13, "Permission denied")
        held.append((os.fstat(handle).st_ino, mode, length))

    monkeypatch.setattr(storage.importlib.util, "find_spec", lambda name: name == "msvcrt" or None)
    monkeypatch.setitem(sys.modules, "msvcrt", types.SimpleNamespace(LK_NBLCK=2, locking=locking))
    with locked(tmp_path) as first, locked(tmp_path) as second:
        assert (first, second) == (True, False)
    assert held == [((tmp_path / ".lock").stat().st_ino, 2, 1)]
