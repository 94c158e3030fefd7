"""Numba's decorators, for all modules with compiled functions.

To the type checker these are plain functions: Numba's own annotations give an intrinsic the arguments that it has at
compile time, and lack the options that are not documented.
"""

from __future__ import annotations

from typing import Any
from weakref import WeakKeyDictionary

import numba
from numba import extending, types
from numba._dispatcher import compute_fingerprint

from bow_sim.simd.code_cache import CodeCache
from bow_sim.simd.parts import OPTIONS, Pipeline, part_of

if numba.config.DISABLE_JIT:
    raise ImportError("the kernels exist in compiled form only: unset NUMBA_DISABLE_JIT")


def njit(*, cache: bool = False, **options: Any) -> Any:
    """Compile a function as `numba.njit` does; with `cache`, store the code by :mod:`bow_sim.simd.code_cache`."""

    def decorate(function: Any) -> Any:
        dispatcher = numba.njit(no_cfunc_wrapper=True, **options)(function)
        if cache:
            dispatcher._cache = CodeCache(function)
        return dispatcher

    return decorate


def part(**options: Any) -> Any:
    """Compile a function that compiled functions call, once, together with them; see :mod:`bow_sim.simd.parts`."""

    def decorate(function: Any) -> Any:
        return part_of(function, options)

    return decorate


_entries: WeakKeyDictionary[Any, dict[bytes, Any]] = WeakKeyDictionary()
"""Function -> its code by the fingerprint of the arguments' types, as its dispatcher has it."""


def entry(function: Any, arguments: tuple[Any, ...]) -> Any:
    """Return the code of a function of `njit` for arguments of these types, compiled if it is not.

    It may only be called with arguments of the same types, which it does not check: to find the types of a hundred
    arrays takes as long as 30 cells take for a chunk.
    """
    known = _entries.setdefault(function, {})
    fingerprint = compute_fingerprint(arguments)
    if fingerprint not in known:
        kinds = tuple(numba.typeof(x) for x in arguments)
        function.compile(kinds)
        known[fingerprint] = function.overloads[kinds].entry_point
    return known[fingerprint]


intrinsic: Any = extending.intrinsic
overload: Any = extending.overload
register_model: Any = extending.register_model
lower_builtin: Any = extending.lower_builtin


@intrinsic
def align_stack(typingctx: Any) -> Any:
    """Let the stack of the function that calls this begin at a cache line."""

    def codegen(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        builder.function.attributes.add("nounwind")  # llvmlite writes the alignment only beside another attribute
        builder.function.attributes.alignstack = 64
        return context.get_dummy_value()

    return types.void(), codegen


INLINE: dict[str, Any] = {"nogil": True, "_nrt": False, "forceinline": True}
"""Options of the functions that the time loop calls: no reference counts, and inlined."""

OVERLOAD: dict[str, Any] = {**INLINE, **OPTIONS, "pipeline_class": Pipeline}
"""The same for `overload`, as parts."""
