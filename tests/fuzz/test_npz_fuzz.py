"""Thousands of damaged files of demonstrations: read as they were, or refused in one line."""

import io
import zipfile
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from aircl_jax.demonstrations import files
from envs import Box, Env
from tests.fuzz.outcomes import Refused, outcome

CASES = 2500
N, T, O, A = 3, 4, 5, 2
ENV = Env("robot", T, O, Box(A), reset=lambda key: (None, None), step=lambda *_: (None, None))  # pyright: ignore
Random = np.random.Generator
Members = dict[str, bytes]


def arrays(random: Random) -> dict[str, np.ndarray]:
    optional = {
        "mask": np.ones((N, T)),
        "reward": random.normal(size=(N, T)),
        "cost": (random.random((N, T)) < 0.3).astype(float),
        "extra": np.arange(7),
    }
    chosen = {name: array for name, array in optional.items() if random.random() < 0.5}
    return {"obs": random.normal(size=(N, T, O)), "action": random.uniform(-1, 1, (N, T, A)), **chosen}


def packed(given: dict[str, Any], compressed: bool) -> bytes:
    file = io.BytesIO()
    (np.savez_compressed if compressed else np.savez)(file, **given)
    return file.getvalue()


def flipped(random: Random, content: bytes) -> bytes:
    changed = bytearray(content)
    for _ in range(random.integers(1, 4)):
        changed[random.integers(len(changed))] ^= 1 << random.integers(8)
    return bytes(changed)


def cut(random: Random, content: bytes) -> bytes:
    return content[: random.integers(len(content))]


def spliced(random: Random, content: bytes) -> bytes:
    at, length = random.integers(len(content)), random.integers(1, 200)
    return content[:at] + random.bytes(int(length)) + content[at + (length if random.random() < 0.5 else 0) :]


def swapped(random: Random, content: bytes) -> bytes:
    one, other = sorted(random.integers(len(content), size=2))
    return content[other:] + content[one:other] + content[:one]


BYTES: tuple[Callable[[Random, bytes], bytes], ...] = (flipped, cut, spliced, swapped)
TOKENS = (b"(", b"-", b"9" * 12, b"'|O'", b"None", b"True", b"1e9", b"{", b"\x00", b"'<f8'", b"nan")


def headers_rewritten(random: Random, content: bytes) -> bytes:
    """The same members, one with a token of its header replaced, under checksums that fit."""
    out = io.BytesIO()
    with zipfile.ZipFile(io.BytesIO(content)) as archive:
        members: Members = {name: archive.read(name) for name in archive.namelist()}
    victim = random.choice(sorted(members))
    head = bytearray(members[victim])
    at = int(random.integers(6, 90))
    token = TOKENS[random.integers(len(TOKENS))]
    head[at : at + len(token)] = token
    members[victim] = bytes(head)
    with zipfile.ZipFile(out, "w") as archive:
        for name, data in members.items():
            archive.writestr(name, data)
    return out.getvalue()


# Changes of the arrays that must be refused, whatever else they hold.
def _with(name: str, change: Callable[[np.ndarray], np.ndarray]) -> Callable[[dict[str, np.ndarray]], None]:
    def of(given: dict[str, np.ndarray]) -> None:
        given[name] = change(given[name])

    return of


def _poked(value: float) -> Callable[[np.ndarray], np.ndarray]:
    def poke(array: np.ndarray) -> np.ndarray:
        array = array.copy()
        array.flat[array.size // 2] = value
        return array

    return poke


WRONG = tuple(
    _with(name, change)
    for name in ("obs", "action")
    for change in (
        _poked(np.nan),
        _poked(np.inf),
        _poked(1e300),
        lambda array: array[:, 1:],
        lambda array: array[..., :-1],
        lambda array: array[:0],
        lambda array: array.astype(complex),
        lambda array: array.astype(str),
        lambda array: array.astype(object),
        lambda array: array.ravel(),
        lambda array: np.zeros(()),
        lambda array: np.concatenate([array, array], axis=-1),
    )
)


@pytest.mark.slow
def test_a_damaged_file_is_read_as_it_was_or_refused_in_one_line(tmp_path):
    path, read, refused = tmp_path / "mine.npz", 0, 0
    for case in range(CASES):
        random = np.random.default_rng(case)
        given, wrong = arrays(random), False
        if case % 5 == 0:
            WRONG[random.integers(len(WRONG))](given)
            wrong = True
        content = packed(given, bool(random.integers(2)))
        if case % 5 == 1:
            content = headers_rewritten(random, content)
        elif case % 5 <= 3 and not wrong:
            content = BYTES[random.integers(len(BYTES))](random, content)
        path.write_bytes(content)
        loaded = outcome(lambda: files.load(path, ENV))
        if isinstance(loaded, Refused):
            assert loaded.names(f"demonstrations={path}: ") and case % 5 != 4, case  # every fifth file is whole
            refused += 1
            continue
        assert not wrong, case
        for name in given.keys() - {"extra"}:
            np.testing.assert_array_equal(getattr(loaded, name), given[name].astype(np.float32), str(case))
        read += 1
    print(f"{read} read, {refused} refused, of {CASES}")
    assert read >= CASES // 5 and refused > CASES // 2
