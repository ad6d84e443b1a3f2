"""Read arrays of an .npz file, the headers first, so that nothing is unpacked that cannot fit or that nobody asked for."""

import math
import warnings
import zipfile
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

MOST_BYTES = 2**31  # of all arrays together, unpacked
BROKEN = "it is no whole .npz file; save it with numpy.savez(path, obs=…, action=…)"
ENCRYPTED = 0x1  # flag of a member of a zip file
_HEADERS = {(1, 0): np.lib.format.read_array_header_1_0, (2, 0): np.lib.format.read_array_header_2_0}


class Header(NamedTuple):
    """What a member of the archive declares to hold."""

    shape: tuple[int, ...]
    dtype: np.dtype[Any]


class Archive:
    """An open .npz file: `headers` of the members by name, and `read` for the data of some."""

    def __init__(self, archive: zipfile.ZipFile) -> None:
        self.archive = archive
        self.members = {member.filename.removesuffix(".npy"): member for member in archive.infolist()}
        if len(self.members) < len(archive.infolist()):
            raise ValueError("it holds two arrays of one name; save each once")
        for name, member in self.members.items():  # all: a damaged name would pass for one that nobody asks for
            if member.flag_bits & ENCRYPTED:
                raise ValueError(f"{name} is encrypted; save plain arrays as .npz")
            if member.compress_type not in (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED):
                raise ValueError(f"{name} is packed otherwise than NumPy does it; save it with numpy.savez")
            with _foreign():
                archive.open(member).close()

    def headers(self, names: Sequence[str]) -> dict[str, Header]:
        """Read the headers of those members that there are. Raises ValueError where one cannot be read as it stands."""
        found = {name: self._header(name) for name in names if name in self.members}
        size = sum(math.prod(header.shape) * header.dtype.itemsize for header in found.values())
        if size > MOST_BYTES:
            raise ValueError(f"its arrays take {size / 1e9:.3g} GB unpacked; at most {MOST_BYTES / 1e9:.3g} GB are read")
        return found

    def read(self, names: Sequence[str]) -> dict[str, np.ndarray]:
        """Read the data of members whose headers were read."""
        arrays = {}
        for name in names:
            with _foreign(), self.archive.open(self.members[name]) as stream:
                arrays[name] = np.lib.format.read_array(stream, allow_pickle=False)
        return arrays

    def _header(self, name: str) -> Header:
        member = self.members[name]
        with _foreign(), self.archive.open(member) as stream, warnings.catch_warnings():
            warnings.simplefilter("ignore")  # of headers that Python 2 wrote
            shape, _, dtype = _HEADERS[np.lib.format.read_magic(stream)](stream)
            begin = stream.tell()
        if dtype.hasobject:
            raise ValueError("it holds pickled objects, which are not loaded; save plain arrays as .npz")
        if min(shape, default=0) < 0 or member.file_size != begin + math.prod(shape) * dtype.itemsize:
            raise ValueError(f"{name} declares shape {list(shape)}, and the file holds another number of bytes; save it anew")
        return Header(shape, dtype)


@contextmanager
def opened(path: Path) -> Iterator[Archive]:
    """Open an .npz file. Raises ValueError, in one line, where it is none."""
    with _foreign():
        archive = zipfile.ZipFile(path)
    with archive:
        yield Archive(archive)


@contextmanager
def _foreign() -> Iterator[None]:
    """Whatever NumPy and zipfile raise over the bytes of a file says that it is broken; an error of the disk stays one."""
    try:
        yield
    except Exception as error:
        if isinstance(error, OSError) and error.errno:
            raise
        raise ValueError(BROKEN) from error
