"""Files that are replaced atomically, and archives of arrays that are read without trusting their headers."""

from __future__ import annotations

import contextlib
import io
import os
import tokenize
import zipfile
import zlib
from collections.abc import Iterator
from pathlib import Path
from typing import IO, Any

import numpy as np

MAX_ARRAYS = 64
MAX_UNPACKED = 1 << 32
"""Largest number of members of an archive, and of bytes in all of them together."""


@contextlib.contextmanager
def replacing(path: str | Path) -> Iterator[IO[bytes]]:
    """Yield a file to write to, which replaces `path` if the block ends without an exception.

    Readers see the old file or the complete new one, even if this process is killed or the machine loses power.

    Raises
    ------
    OSError
        If the file cannot be written.
    """
    path = Path(path)
    aside = path.with_name(f".{path.name}.part")
    try:
        with open(aside, "wb") as file:
            yield file
            file.flush()
            os.fsync(file.fileno())
        os.replace(aside, path)
        sync_directory(path.parent)
    except BaseException:
        aside.unlink(missing_ok=True)
        raise


def sync_directory(directory: Path) -> None:
    """Write the list of a directory's files to disk, if its file system supports that."""
    with contextlib.suppress(OSError):
        descriptor = os.open(directory, os.O_RDONLY | os.O_DIRECTORY | os.O_CLOEXEC)
        try:
            os.fsync(descriptor)
        finally:
            os.close(descriptor)


def read_arrays(path: str | Path) -> dict[str, np.ndarray]:
    """Return the arrays of a NumPy archive; no more memory is allocated than the file has data for.

    Raises
    ------
    OSError
        If the file cannot be read.
    ValueError
        If it is not an archive of plain arrays; the message gives the reason.
    """
    arrays: dict[str, np.ndarray] = {}
    with open(path, "rb") as stream:
        try:
            with zipfile.ZipFile(stream) as archive:
                members = archive.infolist()
                if len(members) > MAX_ARRAYS or sum(member.file_size for member in members) > MAX_UNPACKED:
                    raise ValueError(f"has {len(members)} members; at most {MAX_ARRAYS} and {MAX_UNPACKED} bytes")
                for member in members:
                    arrays[member.filename.removesuffix(".npy")] = _array(archive.read(member))
        except _NO_ARCHIVE as error:
            raise ValueError(f"no archive of arrays: {error}") from None
    return arrays


_NO_ARCHIVE = (
    *(zipfile.BadZipFile, zlib.error, EOFError, KeyError, TypeError, OverflowError, NotImplementedError),
    *(RuntimeError, SyntaxError, tokenize.TokenError, MemoryError, OSError),  # RuntimeError: an encrypted member
)
"""Exceptions of zipfile and NumPy for damaged data, other than ValueError."""


def _array(data: bytes) -> np.ndarray:
    """Return the array in a .npy file, after checking that its data are as long as its header states."""
    stream: Any = io.BytesIO(data)
    version = np.lib.format.read_magic(stream)
    if version not in ((1, 0), (2, 0)):
        raise ValueError(f"a .npy file of version {version}")
    read = np.lib.format.read_array_header_1_0 if version == (1, 0) else np.lib.format.read_array_header_2_0
    shape, _, dtype = read(stream)
    count = 1
    for length in shape:
        count *= length
    available = len(data) - stream.tell()
    if dtype.hasobject or min(shape, default=0) < 0 or count * dtype.itemsize != available:
        raise ValueError(f"an array of {dtype} with shape {shape} in {available} bytes")
    stream.seek(0)
    array: np.ndarray = np.lib.format.read_array(stream, allow_pickle=False)
    return array
