"""Files of demonstrations that are damaged, odd or huge: headers are read before data, and nothing that nobody asked for."""

import io
import zipfile
from typing import Any

import numpy as np
import pytest

from aircl_jax.demonstrations import files, npz
from tests.demonstrations.test_files import GRID, N, O, T, arrays, robot

ROBOT = robot()


def of_robot(**changes: Any) -> dict[str, Any]:
    return {"obs": np.ones((N, T, O)), "action": np.zeros((N, T, 2))} | changes


def member(path, name: str, header: str, data: bytes = b"") -> None:
    """An archive with one array of our own making."""
    text = header.encode() + b" " * (63 - (len(header) + 10) % 64) + b"\n"
    with zipfile.ZipFile(path, "w") as archive:
        archive.writestr(f"{name}.npy", b"\x93NUMPY\x01\x00" + len(text).to_bytes(2, "little") + text + data)


def refused(path, words: str, env=GRID) -> None:
    with pytest.raises(ValueError, match=words) as caught:
        files.load(path, env)
    assert str(caught.value).startswith(f"demonstrations={path}: ") and "\n" not in str(caught.value)


@pytest.mark.parametrize("place", [0.3, 0.5, 0.7])
def test_a_flipped_byte_is_found(tmp_path, place):
    path = tmp_path / "mine.npz"
    np.savez_compressed(path, **of_robot(obs=np.random.default_rng(0).normal(size=(N, T, O))))
    content = bytearray(path.read_bytes())
    content[int(place * len(content))] ^= 0x10
    path.write_bytes(content)
    refused(path, r"no whole \.npz file", ROBOT)


@pytest.mark.parametrize(
    ("header", "words"),
    [
        ("{'descr': '<f8', 'fortran_order': False, 'shape': (3, 4, 9), }", "obs declares shape .* another number of bytes"),
        ("{'descr': '<f8', 'fortran_order': False, 'shape': (-3, -4, 9), }", "obs declares shape"),
        ("{'descr': '<f8', 'fortran_order': False, 'shape': (3000000000, 4, 9), }", "obs declares shape"),
        ("{'descr': '|O', 'fortran_order': False, 'shape': (3, 4, 9), }", "pickled objects"),
        ("{'descr': 'what', 'fortran_order': False, 'shape': (3, 4, 9), }", r"no whole \.npz"),
        ("{'descr': '<f8', 'shape': (3, 4, 9), }", r"no whole \.npz"),
        ("not python", r"no whole \.npz"),
        ("(" * 3000, r"no whole \.npz"),
        ("", r"no whole \.npz"),
    ],
)
def test_odd_headers_are_refused(tmp_path, header, words):
    member(tmp_path / "mine.npz", "obs", header)
    refused(tmp_path / "mine.npz", words)


def test_a_shape_that_does_not_fit_is_refused_before_its_data_are_unpacked(tmp_path, monkeypatch):
    path = tmp_path / "mine.npz"
    np.savez_compressed(path, **of_robot(obs=np.zeros((N, T, 20_000))))
    monkeypatch.setattr(npz.Archive, "read", lambda *_: pytest.fail("it was unpacked"))
    refused(path, r"obs has shape \[3, 4, 20000\]; robot needs \[3, 4, 9\]", ROBOT)


def test_arrays_of_more_than_memory_is_for_are_refused_by_their_headers(tmp_path, monkeypatch):
    monkeypatch.setattr(npz, "MOST_BYTES", 1000)
    np.savez_compressed(tmp_path / "mine.npz", **of_robot())
    refused(tmp_path / "mine.npz", r"its arrays take 1\.06e-06 GB unpacked; at most 1e-06 GB are read", ROBOT)


def test_arrays_that_nobody_asked_for_are_not_read(tmp_path):
    path = tmp_path / "mine.npz"
    np.savez(path, **of_robot(extra=np.array([{}], dtype=object), info=np.array(["a"])))
    assert files.load(path, ROBOT).obs.shape == (N, T, O)


def test_an_encrypted_member_and_another_packing_are_refused(tmp_path):
    path = tmp_path / "mine.npz"
    np.savez(path, **of_robot())
    content = path.read_bytes()
    for mark, offset in ((b"PK\x03\x04", 6), (b"PK\x01\x02", 8)):
        at = content.index(mark) + offset
        content = content[:at] + b"\x01" + content[at + 1 :]
    path.write_bytes(content)
    refused(path, "obs is encrypted; save plain arrays", ROBOT)
    with zipfile.ZipFile(path, "w", zipfile.ZIP_LZMA) as archive:
        archive.writestr("obs.npy", b"\x93NUMPY")
    refused(path, "obs is packed otherwise than NumPy does it", ROBOT)


def test_two_arrays_of_one_name_are_refused(tmp_path):
    path, part = tmp_path / "mine.npz", io.BytesIO()
    np.save(part, np.zeros(3))
    with zipfile.ZipFile(path, "w") as archive:
        archive.writestr("obs.npy", part.getvalue())
        with pytest.warns(UserWarning, match="Duplicate name"):
            archive.writestr("obs.npy", part.getvalue())
    refused(path, "it holds two arrays of one name")


@pytest.mark.parametrize(
    ("value", "words"),
    [
        (1e300, r"obs is 1e\+300, beyond 1e\+18, in trajectory 1, step 2"),
        (-1e20, r"obs is -1e\+20, beyond 1e\+18, in trajectory 1, step 2"),
        (np.inf, "obs is not finite in trajectory 1, step 2"),
    ],
)
def test_values_that_single_precision_does_not_hold_are_refused(tmp_path, value, words):
    obs = np.ones((N, T, O))
    obs[1, 2, 3] = value
    np.savez(tmp_path / "mine.npz", **of_robot(obs=obs))
    refused(tmp_path / "mine.npz", words, ROBOT)


@pytest.mark.parametrize("kind", [">f8", "<f2", "<i8", "|b1", "<u2"])
def test_numbers_of_any_kind_are_read_alike(tmp_path, kind):
    np.savez(tmp_path / "mine.npz", **of_robot(obs=np.ones((N, T, O), kind)))
    loaded = files.load(tmp_path / "mine.npz", ROBOT)
    assert loaded.obs.dtype == np.float32 and (loaded.obs == 1).all()


@pytest.mark.parametrize("name", ["", " "])
def test_an_empty_name_is_refused(name):
    with pytest.raises(ValueError, match=r"the name is empty; give an \.npz file, a Minari folder or minari:ID"):
        files.load(name, GRID)


def test_a_name_that_is_too_long_is_one_line():
    with pytest.raises(ValueError, match="it cannot be read: File name too long"):
        files.load("x" * 5000 + ".npz", GRID)


def test_the_metadata_are_read_alone(tmp_path):
    np.savez(tmp_path / "mine.npz", **arrays(), metadata=np.array('{"source": "a test"}'))
    assert files.metadata(tmp_path / "mine.npz") == {"source": "a test"}
