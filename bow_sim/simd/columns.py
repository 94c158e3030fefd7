"""Transposition of eight rows of samples, so that eight cells are computed at once, each in its own lane."""

from __future__ import annotations

from typing import Any

from llvmlite import ir
from numba import types
from numba.core import cgutils

from bow_sim.simd.jit import intrinsic
from bow_sim.simd.lane_types import LANES, LANES_OF, element_aligned, pointer, vector

_I64 = ir.IntType(64)

_HALF = 4
"""Samples that are read from a row at once: one half of a register takes them from a row, the other from a row four
further on, and two rounds of shuffles within the halves transpose eight rows."""


def _order(*places: int) -> ir.Constant:
    return ir.Constant(ir.VectorType(ir.IntType(32), len(places)), places)


def _in_both_halves(*places: int) -> ir.Constant:
    """Return the order that shuffles each half of two registers in the same way; places 4 ... 7 are of the second."""
    return _order(*(place % _HALF + half + place // _HALF * LANES for half in (0, _HALF) for place in places))


def _transposed(builder: Any, rows: list[Any]) -> list[Any]:
    """Transpose each half of four registers of eight in two rounds of shuffles."""
    a, b, c, d = rows
    orders = _in_both_halves(0, 4, 1, 5), _in_both_halves(2, 6, 3, 7)
    pairs = [(builder.shuffle_vector(a, b, order), builder.shuffle_vector(c, d, order)) for order in orders]
    orders = _in_both_halves(0, 1, 4, 5), _in_both_halves(2, 3, 6, 7)
    return [builder.shuffle_vector(*pair, order) for pair in pairs for order in orders]


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
        single, eight = ir.VectorType(ir.FloatType(), _HALF), vector(level)
        whole = _order(*range(LANES))

        def read(row: int, begin: int) -> Any:
            place = builder.add(i_value, builder.add(builder.mul(w, _I64(row)), _I64(begin)))
            return element_aligned(builder.load(pointer(context, builder, x, x_value, place, single)), x)

        for begin in range(0, LANES, _HALF):
            pairs = [(read(row, begin), read(row + _HALF, begin)) for row in range(_HALF)]
            rows = [builder.shuffle_vector(*pair, whole) for pair in pairs]
            for t, column in enumerate(_transposed(builder, rows), begin):
                place = pointer(context, builder, out, out_value, builder.add(o_value, _I64(LANES * t)), eight)
                element_aligned(builder.store(builder.fsub(builder.fpext(column, eight), less), place), out)
        return context.get_dummy_value()

    return types.void(x, types.intp, types.intp, level, out, types.intp), codegen


@intrinsic
def flipped(typingctx: Any, x: Any, other: Any) -> Any:
    """Return x with its sign changed in the lanes where the sign of `other` is minus; both are float32."""
    lanes = LANES_OF[types.float32]
    if not (x is lanes and other is lanes):
        return None

    def codegen(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        whole = ir.VectorType(ir.IntType(32), LANES)
        values, signs = (builder.bitcast(value, whole) for value in args)
        signs = builder.and_(signs, ir.Constant(whole, [-(2**31)] * LANES))
        return builder.bitcast(builder.xor(values, signs), vector(lanes))

    return lanes(x, other), codegen


@intrinsic
def prefetch(typingctx: Any, x: Any, i: Any) -> Any:
    """Fetch the cache line of ``x.flat[i]``, which will be read soon, without waiting for it."""

    def codegen(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        byte, number = ir.IntType(8), ir.IntType(32)
        place = pointer(context, builder, x, args[0], args[1], byte)
        kind = ir.FunctionType(ir.VoidType(), [byte.as_pointer(), number, number, number])
        fetch = cgutils.get_or_insert_function(builder.module, kind, "llvm.prefetch.p0")
        builder.call(fetch, [place, number(0), number(3), number(1)])
        return context.get_dummy_value()

    return types.void(x, types.intp), codegen
