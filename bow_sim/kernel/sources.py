"""The sources that decide the waveforms, and their hash. Does not import Numba."""

from __future__ import annotations

import functools
import hashlib
import platform
from importlib.metadata import version
from pathlib import Path

import numpy as np

SOURCES = (
    "kernel/block",
    "kernel/arguments",
    "kernel/body",
    "kernel/hair",
    "kernel/rings",
    "kernel/windows",
    "kernel/order",
    "kernel/arriving",
    "kernel/eight_steps",
    "kernel/time_loop",
    "kernel/few_cells",
    "kernel/ahead",
    "simd/rows",
    "simd/lane_types",
    "simd/lanes",
    "simd/steps",
    "simd/signs",
    "simd/jit",
    "simd/parts",
    "physics/exact",
    "physics/body",
    "physics/friction",
    "physics/friction_curve",
    "physics/thermal",
    "physics/gesture",
    "physics/reflection",
    "physics/reflection_text",
    "physics/number_files",
    "physics/cells",
    "physics/schelleng",
    "physics/fields",
    "physics/instruments",
    "physics/parameters",
)
"""The modules of `bow_sim` that decide the waveforms; a test finds one that is missing."""


@functools.cache
def source_hash() -> str:
    """Return the hash of the sources that decide the waveforms, 16 hexadecimal digits."""
    digest = hashlib.sha256()
    for name in SOURCES:
        digest.update((Path(__file__).parent.parent / f"{name}.py").read_bytes())
    return digest.hexdigest()[:16]


@functools.cache
def program() -> str:
    """Return sources, compilers, libraries and processor in a line, for what is written down of a computation."""
    import llvmlite.binding  # here because it takes long to import

    libraries = f"numba-{version('numba')} llvmlite-{version('llvmlite')} numpy-{np.__version__}"
    return f"source-{source_hash()} {libraries} {'-'.join(platform.libc_ver())} {llvmlite.binding.get_host_cpu_name()}"
