"""The sources that decide a verdict, and their hash.

It is part of the hash of the classifier's parameters, and of the compiled tests: Numba's cache watches only the file in
which a function stands, and some of these are made of :mod:`bow_sim.simd.lanes` too. What a closure holds is part of
the cache's key, so a cached function that closes over `VERSION` is never stale. The functions that it calls need no
cache of their own, and must not have one, as theirs would be.
"""

from __future__ import annotations

import functools
import hashlib
from pathlib import Path
from typing import Any

from bow_sim import simd

HERE = (
    "chunk_pass",
    "block_classifier",
    "features/corners",
    "features/long_periods",
    "features/periodicity",
    "features/ripples",
    "features/slips",
    "verdict/confidence",
    "verdict/decision",
    "verdict/regimes",
    "verdict/thresholds",
)
SOURCES = (
    *(Path(__file__).parents[1] / f"{name}.py" for name in HERE),
    *(Path(simd.__path__[0]) / f"{name}.py" for name in ("columns", "jit", "lanes", "rows")),
)
"""Files that decide a verdict."""


@functools.cache
def source_hash() -> str:
    """Return the hash of the sources that decide a verdict, 16 hexadecimal digits."""
    digest = hashlib.sha256()
    for path in SOURCES:
        digest.update(path.read_bytes())
    return digest.hexdigest()[:16]


VERSION = int(source_hash()[:15], 16)
"""For the functions that Numba keeps: the hash as a number of 64 bits."""

LEAN: dict[str, Any] = {"nogil": True, "error_model": "numpy", "_nrt": False}
"""Numba's options for the parts of the tests: without reference counts, which would take a fifth of the time."""
