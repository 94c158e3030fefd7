"""Comparisons of many samples at once, as bits of a number: the lowest bit is that of the first sample."""

from __future__ import annotations

from typing import Any

from llvmlite import ir
from numba import types
from numba.core import cgutils

from bow_sim.simd.jit import intrinsic
from bow_sim.simd.lane_types import broadcast, element_aligned, pointer

MANY = 16
"""Samples of float32 in the widest registers, those of AVX-512."""

BYTES = 64
"""Bytes that are compared together."""

_I64 = ir.IntType(64)


@intrinsic
def onsets(typingctx: Any, x: Any, i: Any, delay: Any, low: Any, high: Any) -> Any:
    """Return where y[t] = x[t] - x[t - delay] may begin to exceed a level, for the `MANY` samples from i on.

    That is where the magnitude of y[t] is above `low`, and y[t - 1] is not above `high` with the same sign. All are
    float32; x is C-contiguous.
    """
    if not (x.dtype is types.float32 and low is types.float32 and high is types.float32):
        return None

    def codegen(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        x_value, at, d, *levels = args
        eight, whole = ir.VectorType(ir.FloatType(), MANY), ir.VectorType(ir.IntType(32), MANY)
        low_value, high_value = (broadcast(builder, level, eight) for level in levels)

        def y(start: Any) -> Any:
            places = (pointer(context, builder, x, x_value, p, eight) for p in (start, builder.sub(start, d)))
            return builder.fsub(*(element_aligned(builder.load(place), x) for place in places))

        now, before = y(at), y(builder.sub(at, _I64(1)))
        sign = builder.and_(builder.bitcast(now, whole), ir.Constant(whole, [-(2**31)] * MANY))
        flipped = builder.bitcast(builder.xor(builder.bitcast(before, whole), sign), eight)
        kind = ir.FunctionType(eight, [eight])
        fabs = cgutils.get_or_insert_function(builder.module, kind, f"llvm.fabs.v{MANY}f32")
        above = builder.fcmp_ordered(">", builder.call(fabs, [now]), low_value)
        found = builder.and_(above, builder.fcmp_ordered("<=", flipped, high_value))
        return builder.bitcast(found, ir.IntType(MANY))

    return types.uint16(x, types.intp, types.intp, low, high), codegen


@intrinsic
def nonzero(typingctx: Any, x: Any, i: Any) -> Any:
    """Return which of `BYTES` bytes from i on are not 0; x is uint8, C-contiguous."""
    if x.dtype is not types.uint8:
        return None

    def codegen(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        kind = ir.VectorType(ir.IntType(8), BYTES)
        values = element_aligned(builder.load(pointer(context, builder, x, args[0], args[1], kind)), x)
        found = builder.icmp_unsigned("!=", values, ir.Constant(kind, [0] * BYTES))
        return builder.bitcast(found, ir.IntType(BYTES))

    return types.uint64(x, types.intp), codegen


@intrinsic
def bit_count(typingctx: Any, byte: Any) -> Any:
    """Return how many bits of a byte are set."""

    def codegen(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        return builder.ctpop(builder.zext(args[0], _I64))

    return types.int64(types.uint8), codegen
