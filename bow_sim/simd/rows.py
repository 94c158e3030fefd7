"""Two operations on rows of eight lanes: convolution of several steps, and transposition.

They are written as single LLVM instructions, because their speed depends on how they use the registers.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import product
from typing import Any

from llvmlite import ir
from numba import types
from numba.core import cgutils

from bow_sim.simd.jit import intrinsic
from bow_sim.simd.lane_types import LANES, LANES_OF, broadcast, element_aligned, in_halves, pointer, vector

_I64 = ir.IntType(64)

_MANY = 16
"""With more taps than this, half of the rows are summed at a time: then samples stay in registers, and taps do not."""


def fir_of(rows: int) -> Any:
    """Return the convolution of ``rows`` successive steps, unrolled over the taps.

    ``out[o + r w : + 8] = 0 + taps[0] x[i + r w] + taps[1] x[i + (r + 1) w] + ...`` with ``w = width``, each sum from
    left to right. Several steps together read each sample and each tap once instead of ``rows`` times. The taps are a
    tuple, so that their number is part of the type, and a kernel is compiled for each number.
    """

    @intrinsic
    def fir(typingctx: Any, taps: Any, x: Any, i: Any, out: Any, o: Any, width: Any) -> Any:
        lanes = LANES_OF[x.dtype]

        def codegen(context: Any, builder: Any, signature: Any, args: Any) -> Any:
            tap_values, x_value, i_value, out_value, o_value, w = args
            parts = 2 if in_halves(context, lanes) else 1
            size = LANES // parts
            kind = ir.VectorType(vector(lanes).element, size)

            def row(array_type: Any, array: Any, start: Any, number: int, part: int) -> Any:
                index = builder.add(start, builder.mul(w, ir.Constant(_I64, number)))
                index = builder.add(index, ir.Constant(_I64, part * size))
                return pointer(context, builder, array_type, array, index, kind)

            some = LANES // 2 if rows == LANES and parts > 1 and taps.count > _MANY else rows
            zero = ir.Constant(kind, [ir.Constant(kind.element, 0.0)] * size)
            for part, first in product(range(parts), range(0, rows, some)):
                sums = [zero] * some
                window: list[Any] = []
                for k in range(taps.count):
                    tap = broadcast(builder, builder.extract_value(tap_values, k), kind)
                    for r in range(some):
                        if k + r == len(window):
                            place = row(x, x_value, i_value, first + k + r, part)
                            window.append(element_aligned(builder.load(place), x))
                        sums[r] = builder.fadd(sums[r], builder.fmul(tap, window[k + r]))
                for r in range(some):
                    element_aligned(builder.store(sums[r], row(out, out_value, o_value, first + r, part)), out)
            return context.get_dummy_value()

        return types.void(taps, x, types.intp, out, types.intp, types.intp), codegen

    return fir


def fir_each_of(rows: int) -> Any:
    """Return the same convolution with taps of each lane, whose number is even and need not be known before.

    ``out[o + r 8 : + 8] = 0 + taps[b : + 8] x[i + r 8] + taps[b + 8 : + 8] x[i + (r + 1) 8] + ...`` for the rows r.
    """

    @intrinsic
    def fir(typingctx: Any, taps: Any, b: Any, count: Any, x: Any, i: Any, out: Any, o: Any) -> Any:
        lanes = LANES_OF[x.dtype]

        def codegen(context: Any, builder: Any, signature: Any, args: Any) -> Any:
            tap_values, b_value, total, x_value, i_value, out_value, o_value = args
            parts = 2 if rows > LANES // 2 and in_halves(context, lanes) else 1
            size = LANES // parts
            kind = ir.VectorType(vector(lanes).element, size)

            def place(array_type: Any, array: Any, start: Any, row: int, part: int) -> Any:
                index = builder.add(start, ir.Constant(_I64, row * LANES + part * size))
                return pointer(context, builder, array_type, array, index, kind)

            zero = ir.Constant(kind, [ir.Constant(kind.element, 0.0)] * size)
            for part in range(parts):
                slots = [cgutils.alloca_once_value(builder, zero) for _ in range(rows)]
                for slot in slots:
                    builder.store(zero, slot)
                with cgutils.for_range_slice(builder, ir.Constant(_I64, 0), total, ir.Constant(_I64, 2)) as (k, _):
                    step = builder.mul(k, ir.Constant(_I64, LANES))
                    tap_at, x_at = builder.add(b_value, step), builder.add(i_value, step)
                    pair = [
                        element_aligned(builder.load(place(taps, tap_values, tap_at, n, part)), taps) for n in range(2)
                    ]
                    window = [
                        element_aligned(builder.load(place(x, x_value, x_at, r, part)), x) for r in range(rows + 1)
                    ]
                    for r, slot in enumerate(slots):
                        total_r = builder.fadd(builder.load(slot), builder.fmul(pair[0], window[r]))
                        builder.store(builder.fadd(total_r, builder.fmul(pair[1], window[r + 1])), slot)
                for r, slot in enumerate(slots):
                    element_aligned(builder.store(builder.load(slot), place(out, out_value, o_value, r, part)), out)
            return context.get_dummy_value()

        return types.void(taps, types.intp, types.intp, x, types.intp, out, types.intp), codegen

    return fir


def _more(context: Any, builder: Any, signature: Any, args: Any, number: int) -> Any:
    """Emit code for sum `number` of `push`, or for that of `completed`, -1, with one more product."""
    table, sums, x = signature.args
    kind = vector(x)
    place = pointer(context, builder, table, args[0], _I64(sums.count - 1 - number), kind.element)
    tap = broadcast(builder, element_aligned(builder.load(place), table), kind)
    zero = ir.Constant(kind, [ir.Constant(kind.element, 0.0)] * LANES)
    before = builder.extract_value(args[1], number + 1) if number + 1 < sums.count else zero
    return builder.fadd(before, builder.fmul(tap, args[2]))


@intrinsic
def push(typingctx: Any, taps: Any, sums: Any, x: Any) -> Any:
    """Add a sample to the sums of products that it is part of, but for that which it completes.

    With T taps, the one of the greatest lag first, there are T - 1 sums of the samples before x; the next to be
    complete is the first. The result are those after x: ``sums[j] + taps[T - 1 - j] x`` for j from 1 on, and ``0 +
    taps[0] x``. The sums stay in registers, and each has the terms of `fir_of`, in the same order. The taps, an array,
    are read at each use: as many more registers there are not.
    """

    def codegen(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        values = [_more(context, builder, signature, args, j) for j in range(sums.count)]
        return context.make_tuple(builder, sums, values)

    return sums(taps, sums, x), codegen


@intrinsic
def completed(typingctx: Any, taps: Any, sums: Any, x: Any) -> Any:
    """Return the sum that a sample completes, ``sums[0] + taps[T - 1] x`` of those that `push` takes."""
    return x(taps, sums, x), lambda context, builder, signature, args: _more(context, builder, signature, args, -1)


@intrinsic
def nothing_summed(typingctx: Any, taps: Any, like: Any) -> Any:
    """Return the sums that `push` takes before the first sample: zeros."""
    some = types.UniTuple(like, taps.count - 1)

    def codegen(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        return ir.Constant(context.get_value_type(some), None)

    return some(taps, like), codegen


def interleave(builder: Any, rows: Sequence[Any]) -> list[Any]:
    """Transpose eight vectors of eight in three rounds of shuffles."""
    index = ir.VectorType(ir.IntType(32), LANES)
    low = ir.Constant(index, [i // 2 + LANES * (i % 2) for i in range(LANES)])
    high = ir.Constant(index, [LANES // 2 + i // 2 + LANES * (i % 2) for i in range(LANES)])
    for _ in range(3):
        half = LANES // 2
        pairs = [(rows[i], rows[i + half]) for i in range(half)]
        rows = [builder.shuffle_vector(a, b, order) for a, b in pairs for order in (low, high)]
    return list(rows)


def _transpose(of_lane: Any) -> Any:
    """Return what emits a transposition; ``of_lane(context, builder, signature, args, lane)`` is the column's place."""

    def codegen(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        x, out = signature.args[0], signature.args[3]
        kind, single = vector(LANES_OF[x.dtype]), ir.VectorType(ir.FloatType(), LANES)
        rows = []
        for r in range(LANES):
            place = builder.add(args[1], builder.mul(args[2], _I64(r)))
            value = element_aligned(builder.load(pointer(context, builder, x, args[0], place, kind)), x)
            rows.append(value if value.type == single else builder.fptrunc(value, single))
        for lane, column in enumerate(interleave(builder, rows)):
            place = builder.add(args[4], builder.mul(args[5], of_lane(context, builder, signature, args, lane)))
            element_aligned(builder.store(column, pointer(context, builder, out, args[3], place, single)), out)
        return context.get_dummy_value()

    return codegen


@intrinsic
def transpose(typingctx: Any, x: Any, i: Any, width: Any, out: Any, o: Any, stride: Any) -> Any:
    """Write eight rows of eight lanes as eight columns of float32.

    ``out[o + lane stride + r] = x[i + r width + lane]`` for r and lane in 0 ... 7.
    """
    codegen = _transpose(lambda context, builder, signature, args, lane: _I64(lane))
    return types.void(x, types.intp, types.intp, out, types.intp, types.intp), codegen


@intrinsic
def transpose_to(
    typingctx: Any, x: Any, i: Any, width: Any, out: Any, o: Any, stride: Any, columns: Any, first: Any
) -> Any:
    """Do the same with other columns: ``out[o + columns[first + lane] stride + r] = x[i + r width + lane]``."""

    def of_lane(context: Any, builder: Any, signature: Any, args: Any, lane: int) -> Any:
        place = builder.add(args[7], _I64(lane))
        return builder.load(pointer(context, builder, columns, args[6], place, _I64))

    signature = types.void(x, types.intp, types.intp, out, types.intp, types.intp, columns, types.intp)
    return signature, _transpose(of_lane)
