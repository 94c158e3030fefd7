"""Which kernel this is, told without loading its compiler."""

from __future__ import annotations

import functools
import hashlib
import platform
from importlib.metadata import version
from pathlib import Path

import numpy as np

SOURCES = (
    "kernel/block",
    "kernel/time_loop",
    "simd/rows",
    "simd/lanes",
    "simd/jit",
    "physics/friction",
    "physics/gesture",
    "physics/reflection",
    "physics/reflection_text",
    "physics/cells",
    "physics/parameters",
)
"""The modules of `bow_sim` that decide the numbers."""


@functools.cache
def source_hash() -> str:
    """Hash of the sources that decide the numbers, 16 hex digits."""
    digest = hashlib.sha256()
    for name in SOURCES:
        digest.update((Path(__file__).parent.parent / f"{name}.py").read_bytes())
    return digest.hexdigest()[:16]


@functools.cache
def fingerprint() -> str:
    """What two simulators must share to give the same bytes: sources, compilers, libraries and CPU, one line."""
    import llvmlite.binding  # as it is large

    features = llvmlite.binding.get_host_cpu_features().flatten()
    cpu = f"{llvmlite.binding.get_host_cpu_name()}-{hashlib.sha256(features.encode()).hexdigest()[:8]}"
    libraries = f"numba-{version('numba')} llvmlite-{version('llvmlite')} numpy-{np.__version__}"
    return f"source-{source_hash()} {libraries} {'-'.join(platform.libc_ver())} {cpu}"
