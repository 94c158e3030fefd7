"""Comparisons of many samples at once, as bits of a number: the lowest bit is that of the first sample; and counts."""

from __future__ import annotations

from typing import Any

from llvmlite import ir
from numba import types
from numba.core import cgutils

from bow_sim.simd.jit import intrinsic
from bow_sim.simd.lane_types import LANES, LANES_OF, LanesType, broadcast, element_aligned, in_halves, pointer

MANY = 16
"""Samples of float32 in the widest registers, those of AVX-512."""

BYTES = 64
"""Bytes that are compared together."""

_BYTE = 8
_I64 = ir.IntType(64)


@intrinsic
def find_onsets(typingctx: Any, x: Any, i: Any, count: Any, delay: Any, low: Any, high: Any, out: Any) -> Any:
    """Write to out where y[t] = x[t] - x[t - delay] may begin to exceed a level, a byte for eight samples.

    That is where the magnitude of y[t] is above `low`, and y[t - 1] is not above `high` with the same sign. It is
    written for `count` samples, a multiple of `MANY`, from i on. x and the levels are float32, out is uint8.
    """
    single = types.float32
    if not (x.dtype is single and low is single and high is single and out.dtype is types.uint8):
        return None

    def codegen(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        x_value, first, n, d, low_value, high_value, out_value = args
        size = MANY // 2 if in_halves(context, LANES_OF[types.float64]) else MANY  # one register
        kind, whole = ir.VectorType(ir.FloatType(), size), ir.VectorType(ir.IntType(32), size)
        low_value, high_value = (broadcast(builder, level, kind) for level in (low_value, high_value))
        fabs = ir.FunctionType(kind, [kind])
        fabs = cgutils.get_or_insert_function(builder.module, fabs, f"llvm.fabs.v{size}f32")
        one_on = ir.Constant(whole, list(range(size - 1, 2 * size - 1)))

        def y(start: Any, of: Any) -> Any:
            places = (pointer(context, builder, x, x_value, p, of) for p in (start, builder.sub(start, d)))
            return builder.fsub(*(element_aligned(builder.load(place), x) for place in places))

        latest = builder.bitcast(y(builder.sub(first, _I64(1)), kind.element), whole.element)
        latest = builder.insert_element(ir.Constant(whole, ir.Undefined), latest, ir.IntType(32)(size - 1))
        slot = cgutils.alloca_once_value(builder, latest)
        builder.store(latest, slot)
        with cgutils.for_range_slice(builder, _I64(0), n, _I64(size)) as (t, _):
            start = builder.add(first, t)
            now = y(start, kind)
            number = builder.bitcast(now, whole)
            before = builder.shuffle_vector(builder.load(slot), number, one_on)
            builder.store(number, slot)
            sign = builder.and_(number, ir.Constant(whole, [-(2**31)] * size))
            flipped = builder.bitcast(builder.xor(before, sign), kind)
            above = builder.fcmp_ordered(">", builder.call(fabs, [now]), low_value)
            found = builder.and_(above, builder.fcmp_ordered("<=", flipped, high_value))
            bits = ir.IntType(size)
            place = pointer(context, builder, out, out_value, builder.udiv(t, _I64(_BYTE)), bits)
            element_aligned(builder.store(builder.bitcast(found, bits), place), out)
        return context.get_dummy_value()

    return types.void(x, types.intp, types.intp, types.intp, low, high, out), codegen


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
def count_of(typingctx: Any, lanes: Any) -> Any:
    """Return the sum of lanes that are whole numbers, whose order makes no difference."""
    if not isinstance(lanes, LanesType):
        return None

    def codegen(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        total, number = args[0], ir.IntType(32)
        for apart in (4, 2, 1):
            order = ir.Constant(ir.VectorType(number, LANES), [(lane + apart) % LANES for lane in range(LANES)])
            total = builder.fadd(total, builder.shuffle_vector(total, total, order))
        return builder.extract_element(total, number(0))

    return lanes.dtype(lanes), codegen
