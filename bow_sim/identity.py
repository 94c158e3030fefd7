"""Which kernel this is: what two simulators must share to give the same bytes, told without loading its compiler."""

from __future__ import annotations

import functools
import hashlib
import platform
from importlib.metadata import version
from pathlib import Path

import numpy as np

SOURCES = ("kernel", "loop", "rows", "simd", "compiled", "friction", "gesture", "reflection", "taps", "cells", "model")
"""The modules that decide the numbers."""


@functools.cache
def source_hash() -> str:
    """Hash of the sources that decide the numbers, 16 hex digits."""
    digest = hashlib.sha256()
    for name in SOURCES:
        digest.update(Path(__file__).with_name(f"{name}.py").read_bytes())
    return digest.hexdigest()[:16]


@functools.cache
def fingerprint() -> str:
    """What two simulators must share to give the same bytes: sources, compilers, libraries and CPU, one line."""
    import llvmlite.binding  # as it is large

    features = llvmlite.binding.get_host_cpu_features().flatten()
    cpu = f"{llvmlite.binding.get_host_cpu_name()}-{hashlib.sha256(features.encode()).hexdigest()[:8]}"
    libraries = f"numba-{version('numba')} llvmlite-{version('llvmlite')} numpy-{np.__version__}"
    return f"source-{source_hash()} {libraries} {'-'.join(platform.libc_ver())} {cpu}"
