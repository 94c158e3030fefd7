"""Sums of products of rows of eight lanes with earlier rows, for several lags at once.

They are written as single LLVM instructions, because their speed depends on how they use the registers.
"""

from __future__ import annotations

from typing import Any

from llvmlite import ir
from numba import types
from numba.core import cgutils

from bow_sim.simd.jit import intrinsic
from bow_sim.simd.lane_types import LANES, LANES_OF, element_aligned, in_halves, pointer, vector

_I64 = ir.IntType(64)

_ROWS = 2
"""Rows that are multiplied together: an earlier row, once read, is used for two of them."""


def lagged_products(lags: int) -> Any:
    """Return a function that sums the products of n rows of lanes with those that are so many successive lags earlier.

    It writes ``out[o + 8 i + lane]``: the sum, for t from 0 on below n and in this order, of ``x[now + 8 t + lane]
    x[past + 8 (t + i) + lane]``, for i below `lags`. So x is read up to row n + `lags` - 1 from `past` on.

    Eleven sums, two rows, an earlier row and two products are the 16 registers of AVX2, half a row in each. With fewer
    lags each addition waits for the one before.
    """

    @intrinsic
    def sums(typingctx: Any, x: Any, now: Any, past: Any, n: Any, out: Any, o: Any) -> Any:
        lanes = LANES_OF.get(x.dtype)
        if lanes is None or out.dtype is not x.dtype:
            return None

        def codegen(context: Any, builder: Any, signature: Any, args: Any) -> Any:
            x_value, now_value, past_value, total, out_value, o_value = args
            parts = 2 if in_halves(context, lanes) else 1
            size = LANES // parts
            kind = ir.VectorType(vector(lanes).element, size)
            zero = ir.Constant(kind, [ir.Constant(kind.element, 0.0)] * size)
            whole = builder.mul(builder.udiv(total, _I64(_ROWS)), _I64(_ROWS))

            def place(array_type: Any, array: Any, start: Any, row: Any, part: int) -> Any:
                index = builder.add(start, builder.add(builder.mul(row, _I64(LANES)), _I64(part * size)))
                return pointer(context, builder, array_type, array, index, kind)

            def load(start: Any, row: Any, part: int) -> Any:
                return element_aligned(builder.load(place(x, x_value, start, row, part)), x)

            def multiply(t: Any, rows: int, slots: list[Any], part: int) -> None:
                """Emit the products of successive rows; each sum takes them in their order."""
                values = [builder.load(slot) for slot in slots]
                present = [load(now_value, builder.add(t, _I64(k)), part) for k in range(rows)]
                for i in range(lags + rows - 1):
                    earlier = load(past_value, builder.add(t, _I64(i)), part)
                    for k, row in enumerate(present):
                        if 0 <= i - k < lags:
                            values[i - k] = builder.fadd(values[i - k], builder.fmul(row, earlier))
                for value, slot in zip(values, slots, strict=True):
                    builder.store(value, slot)

            for part in range(parts):
                slots = [cgutils.alloca_once_value(builder, zero) for _ in range(lags)]
                for slot in slots:
                    builder.store(zero, slot)
                with cgutils.for_range_slice(builder, _I64(0), whole, _I64(_ROWS)) as (t, _):
                    multiply(t, _ROWS, slots, part)
                with cgutils.for_range_slice(builder, whole, total, _I64(1)) as (t, _):
                    multiply(t, 1, slots, part)
                for i, slot in enumerate(slots):
                    target = place(out, out_value, o_value, _I64(i), part)
                    element_aligned(builder.store(builder.load(slot), target), out)
            return context.get_dummy_value()

        return types.void(x, types.intp, types.intp, types.intp, out, types.intp), codegen

    return sums
