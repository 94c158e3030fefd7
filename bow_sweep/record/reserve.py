"""Disk space that is reserved for a file before it is written.

Otherwise the file system reserves space for every page, and looks for it when the page goes to the disk: more than a
quarter of the CPU time of writing a bag to ext4. Nothing depends on it: a file system may refuse.
"""

from __future__ import annotations

import contextlib
import ctypes
import os
from typing import Any

STEP = 16 << 20
"""Bytes that are reserved at a time; steps of 256 MB gave no more."""

LARGE = 1 << 20
"""A write of fewer bytes reserves nothing: a small bag stays small on the disk too."""

_KEEP_SIZE = 1  # FALLOC_FL_KEEP_SIZE; os.posix_fallocate would change the size of the file
_fallocate: Any = getattr(ctypes.CDLL(None), "fallocate", None)  # Linux only
if _fallocate is not None:
    _fallocate.argtypes = (ctypes.c_int, ctypes.c_int, ctypes.c_int64, ctypes.c_int64)


class Reserve:
    """The space reserved behind the end of a file. Its size, as readers see it, is that of what was written.

    Parameters
    ----------
    descriptor
        Of the file, open for writing.
    """

    def __init__(self, descriptor: int) -> None:
        self._descriptor = descriptor
        self._end = 0
        self._works = _fallocate is not None

    def prepare(self, offset: int, size: int) -> None:
        """Reserve space for `size` bytes at `offset`, where the file ends, and more; not again where this fails."""
        if not self._works or size < LARGE or offset + size <= self._end:
            return
        self._end = offset + size + STEP
        if _fallocate(self._descriptor, _KEEP_SIZE, offset, size + STEP):
            self._works = False
            self.release(offset)  # a full disk may have given a part

    def release(self, end: int) -> None:
        """Give back what is reserved beyond `end`, where the file ends."""
        if self._end > end:
            self._end = end
            with contextlib.suppress(OSError):
                os.ftruncate(self._descriptor, end)
