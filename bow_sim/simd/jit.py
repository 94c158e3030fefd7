"""Numba's decorators, for all modules with compiled functions.

To the type checker these are plain functions: Numba's own annotations give an intrinsic the arguments that it has at
compile time, and lack the options that are not documented.
"""

from __future__ import annotations

from typing import Any

import numba
from numba import extending

from bow_sim.simd.code_cache import CodeCache

if numba.config.DISABLE_JIT:
    raise ImportError("the kernels exist in compiled form only: unset NUMBA_DISABLE_JIT")


def njit(*, cache: bool = False, **options: Any) -> Any:
    """Compile a function as `numba.njit` does; with `cache`, store the code by :mod:`bow_sim.simd.code_cache`."""

    def decorate(function: Any) -> Any:
        dispatcher = numba.njit(**options)(function)
        if cache:
            dispatcher._cache = CodeCache(function)
        return dispatcher

    return decorate


intrinsic: Any = extending.intrinsic
overload: Any = extending.overload
register_model: Any = extending.register_model

INLINE: dict[str, Any] = {"nogil": True, "_nrt": False, "forceinline": True}
"""Options of the functions that the time loop calls: no reference counts, and inlined."""
