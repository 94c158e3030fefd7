"""Numba's decorators, for the modules whose functions run compiled.

Numba's annotations describe an intrinsic with the arguments it has at compile time, and know no
option beyond the documented ones; here they are plain functions to the type checker.
"""

from __future__ import annotations

from typing import Any

import numba
from numba import extending

from bow_sim.simd.code_cache import CodeCache

if numba.config.DISABLE_JIT:
    raise ImportError("the kernels exist in compiled form only: unset NUMBA_DISABLE_JIT")


def njit(*, cache: bool = False, **options: Any) -> Any:
    """Compile a function as `numba.njit` does; with `cache`, keep the code as :mod:`bow_sim.simd.code_cache` says."""

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
"""Options of the kernel's parts: no reference counts and no calls within the time loop."""
