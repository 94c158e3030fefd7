"""The sources that decide a verdict, and their hash.

The hash is part of the hash of the thresholds (two classifiers that share it give the same verdicts) and of the cached
code. Numba's cache watches only the file that defines a function, and the cached one, in
:mod:`bow_classifier.chunk_pass`, contains functions of all these files. But the values of a closure are part of the
cache's key: a cached function that closes over `VERSION` is never older than its sources. The functions that it calls
are compiled with it, and must not be cached themselves.
"""

from __future__ import annotations

import functools
import hashlib
from pathlib import Path

from bow_sim import simd
from bow_sim.simd import options

HERE = (
    "chunk_pass",
    "block_classifier",
    "features/corners",
    "features/first_slips",
    "features/long_periods",
    "features/next_rows",
    "features/periodicity",
    "features/ripples",
    "features/slips",
    "features/windows",
    "features/wolf",
    "verdict/confidence",
    "verdict/decision",
    "verdict/regimes",
    "verdict/thresholds",
)
SOURCES = (
    *(Path(__file__).parents[1] / f"{name}.py" for name in HERE),
    *(
        Path(simd.__path__[0]) / f"{name}.py"
        for name in (
            "bits",
            "columns",
            "elementary",
            "jit",
            "lane_types",
            "lanes",
            "options",
            "parts",
            "products",
            "rows",
        )
    ),
)
"""Files that decide a verdict; a test finds one that is missing."""


@functools.cache
def source_hash() -> str:
    """Return the hash of the sources that decide a verdict, 16 hexadecimal digits."""
    digest = hashlib.sha256()
    for path in SOURCES:
        digest.update(path.read_bytes())
    return digest.hexdigest()[:16]


VERSION = int(source_hash()[:15], 16)
"""The hash as a number of 60 bits, for the cached function to close over."""

LEAN = options.LEAN
"""Numba's options for the functions that are called for every cell."""
