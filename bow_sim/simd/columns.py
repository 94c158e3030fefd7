"""Transposition of eight rows of samples, so that eight cells are computed at once, each in its own lane."""

from __future__ import annotations

from typing import Any

from llvmlite import ir
from numba import types
from numba.core import cgutils

from bow_sim.simd.jit import intrinsic
from bow_sim.simd.lanes import LANES, LANES_OF, element_aligned, pointer, vector
from bow_sim.simd.rows import interleave

_I64 = ir.IntType(64)


@intrinsic
def columns(typingctx: Any, x: Any, i: Any, width: Any, level: Any, out: Any, o: Any) -> Any:
    """Write eight samples of eight rows of float32, less each row's level, as eight rows of float64.

    ``out[o + 8 t + row] = x[i + row width + t] - level[row]`` for t and row in 0 ... 7. This is exact: float64
    holds the difference of two float32 numbers of about the same size.
    """
    if not (x.dtype is types.float32 and out.dtype is types.float64 and level is LANES_OF[types.float64]):
        return None

    def codegen(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        x_value, i_value, w, less, out_value, o_value = args
        single, double = vector(LANES_OF[types.float32]), vector(level)
        rows = []
        for row in range(LANES):
            place = builder.add(i_value, builder.mul(w, ir.Constant(_I64, row)))
            rows.append(element_aligned(builder.load(pointer(context, builder, x, x_value, place, single)), x))
        for t, column in enumerate(interleave(builder, rows)):
            value = builder.fsub(builder.fpext(column, double), less)
            place = builder.add(o_value, ir.Constant(_I64, LANES * t))
            element_aligned(builder.store(value, pointer(context, builder, out, out_value, place, double)), out)
        return context.get_dummy_value()

    return types.void(x, types.intp, types.intp, level, out, types.intp), codegen


@intrinsic
def prefetch(typingctx: Any, x: Any, i: Any) -> Any:
    """Fetch the cache line of ``x.flat[i]``, which will be read soon, without waiting for it."""

    def codegen(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        byte, number = ir.IntType(8), ir.IntType(32)
        place = pointer(context, builder, x, args[0], args[1], byte)
        kind = ir.FunctionType(ir.VoidType(), [byte.as_pointer(), number, number, number])
        fetch = cgutils.get_or_insert_function(builder.module, kind, "llvm.prefetch.p0")
        builder.call(fetch, [place, number(0), number(2), number(1)])
        return context.get_dummy_value()

    return types.void(x, types.intp), codegen
