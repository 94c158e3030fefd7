"""Who is who: which kernel this is, told without loading its compiler, and new names for runs and nodes."""

from __future__ import annotations

import functools
import hashlib
import platform
import secrets
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


def random_id() -> str:
    """Return a new identity for a run or an incarnation: 16 hexadecimal digits, the first a letter.

    A run's namespace is named by it, and ROS names do not begin with a digit.
    """
    return secrets.choice("abcdef") + secrets.token_hex(8)[1:]
