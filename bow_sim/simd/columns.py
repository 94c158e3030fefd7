"""Transposition of eight rows of samples, so that eight cells are computed at once, each in its own lane."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, NamedTuple

from llvmlite import ir
from numba import types
from numba.core import cgutils

from bow_sim.simd.jit import intrinsic
from bow_sim.simd.lane_types import LANES, LANES_OF, LanesType, element_aligned, half, in_halves, pointer, vector

_I64 = ir.IntType(64)

_FOUR = 4
"""Samples that are read from a row at once. Two rounds of shuffles transpose those of four rows; in a register of eight
lanes, one half of it has four rows and the other half the four after them."""


def _order(*places: int) -> ir.Constant:
    return ir.Constant(ir.VectorType(ir.IntType(32), len(places)), places)


def _transposed(builder: Any, rows: list[Any]) -> list[Any]:
    """Transpose each half of four registers, of eight or four lanes, in two rounds of shuffles.

    Those of float64 are shuffled so that the first round stays within pairs of lanes, and the second moves pairs.
    """
    a, b, c, d = rows
    size = a.type.count

    def both(*places: int) -> ir.Constant:
        """Return the order that shuffles each half of two registers alike; places 4 ... 7 are of the second."""
        halves = range(0, size, _FOUR)
        return _order(*(place % _FOUR + first + place // _FOUR * size for first in halves for place in places))

    wide = isinstance(a.type.element, ir.DoubleType)
    orders = (both(0, 4, 2, 6), both(1, 5, 3, 7)) if wide else (both(0, 4, 1, 5), both(2, 6, 3, 7))
    pairs = [(builder.shuffle_vector(a, b, order), builder.shuffle_vector(c, d, order)) for order in orders]
    orders = both(0, 1, 4, 5), both(2, 3, 6, 7)
    found = [builder.shuffle_vector(*pair, order) for pair in pairs for order in orders]
    return [found[k] for k in (0, 2, 1, 3)] if wide else found


class _Source(NamedTuple):
    """Eight rows of an array, for code that is emitted: types of the arrays, and values."""

    context: Any
    builder: Any
    x: Any
    x_value: Any
    width: Any
    rows: Any

    def columns(self, i: Any, less: Any, first: int) -> Iterator[Any]:
        """Emit code that reads eight samples of the rows from `first` on, less their levels; yield column by column.

        `less` is one register: as many rows are read as it has lanes.
        """
        context, builder, kind = self.context, self.builder, less.type
        four = ir.VectorType(ir.FloatType(), _FOUR)
        last = builder.sub(self.rows, _I64(1))

        def read(row: int, begin: int) -> Any:
            present = builder.select(builder.icmp_signed("<", last, _I64(row)), last, _I64(row))
            place = builder.add(builder.add(i, builder.mul(self.width, present)), _I64(begin))
            return element_aligned(builder.load(pointer(context, builder, self.x, self.x_value, place, four)), self.x)

        for begin in range(0, LANES, _FOUR):
            rows = [read(first + row, begin) for row in range(_FOUR)]
            if kind.count == LANES:
                both = _order(*range(LANES))
                rows = [builder.shuffle_vector(row, read(_FOUR + k, begin), both) for k, row in enumerate(rows)]
                yield from (builder.fsub(builder.fpext(column, kind), less) for column in _transposed(builder, rows))
            else:  # a load converts as it reads
                levels = [builder.shuffle_vector(less, less, _order(*[row] * _FOUR)) for row in range(_FOUR)]
                rows = [builder.fpext(row, kind) for row in rows]
                yield from _transposed(builder, [builder.fsub(*pair) for pair in zip(rows, levels, strict=True)])

    def write_columns(self, i: Any, out: Any, out_value: Any, o: Any, less: Any, first: int) -> Iterator[Any]:
        """Emit code that writes these columns as rows of an array, too."""
        for t, value in enumerate(self.columns(i, less, first)):
            place = self.builder.add(o, _I64(LANES * t + first))
            target = pointer(self.context, self.builder, out, out_value, place, less.type)
            element_aligned(self.builder.store(value, target), out)
            yield value


def _parts(context: Any, builder: Any, level: Any, less: Any) -> list[tuple[int, Any]]:
    """Return the first row and the levels of each part of eight rows that is one register of the machine."""
    if not in_halves(context, level):
        return [(0, less)]
    return [(number * _FOUR, half(builder, less, number)) for number in (0, 1)]


def _can(x: Any, level: Any, out: Any) -> bool:
    return x.dtype is types.float32 and out.dtype is types.float64 and level is LANES_OF[types.float64]


@intrinsic
def columns(typingctx: Any, x: Any, i: Any, width: Any, rows: Any, level: Any, out: Any, o: Any) -> Any:
    """Write eight samples of eight rows of float32, less each row's level, as eight rows of float64.

    ``out[o + 8 t + row] = x[i + row width + t] - level[row]`` for t and row in 0 ... 7; where `rows` is less than
    eight, the last one stands for those that are missing. This is exact: float64 holds the difference of two float32
    numbers of about the same size.
    """
    if not _can(x, level, out):
        return None

    def codegen(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        x_value, i_value, w, rows_value, less, out_value, o_value = args
        source = _Source(context, builder, x, x_value, w, rows_value)
        for first, levels in _parts(context, builder, level, less):
            for _ in source.write_columns(i_value, out, out_value, o_value, levels, first):
                pass
        return context.get_dummy_value()

    return types.void(x, types.intp, types.intp, types.intp, level, out, types.intp), codegen


@intrinsic
def summed_columns(typingctx: Any, x: Any, i: Any, width: Any, rows: Any, n: Any, level: Any, out: Any, o: Any) -> Any:
    """Do what `columns` does for n samples, a multiple of eight; return four sums of what is written.

    These are the sum and the sum of squares of the columns t = 0, 2, 4 ..., and then of the others; each takes them in
    their order.
    """
    if not _can(x, level, out):
        return None

    def codegen(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        x_value, i_value, w, rows_value, total, less, out_value, o_value = args
        source = _Source(context, builder, x, x_value, w, rows_value)
        found = []
        for first, levels in _parts(context, builder, level, less):
            zero = ir.Constant(levels.type, [ir.Constant(ir.DoubleType(), 0.0)] * levels.type.count)
            slots = [cgutils.alloca_once_value(builder, zero) for _ in range(4)]
            for slot in slots:
                builder.store(zero, slot)
            with cgutils.for_range_slice(builder, _I64(0), total, _I64(LANES)) as (t, _):
                sums = [builder.load(slot) for slot in slots]
                i_now, o_now = builder.add(i_value, t), builder.add(o_value, builder.mul(t, _I64(LANES)))
                for k, value in enumerate(source.write_columns(i_now, out, out_value, o_now, levels, first)):
                    at = k % 2 * 2
                    sums[at] = builder.fadd(sums[at], value)
                    sums[at + 1] = builder.fadd(sums[at + 1], builder.fmul(value, value))
                for value, slot in zip(sums, slots, strict=True):
                    builder.store(value, slot)
            found.append([builder.load(slot) for slot in slots])
        whole = found[0]
        if len(found) > 1:
            whole = [builder.shuffle_vector(a, b, _order(*range(LANES))) for a, b in zip(*found, strict=True)]
        return context.make_tuple(builder, signature.return_type, whole)

    result = types.UniTuple(level, 4)
    return result(x, types.intp, types.intp, types.intp, types.intp, level, out, types.intp), codegen


@intrinsic
def sums_of_eight(typingctx: Any, x: Any, i: Any, level: Any) -> Any:
    """Return the sums of eight times eight successive samples of float32, each less a level.

    Lane k has ``((y[0] + y[1]) + (y[2] + y[3])) + ((y[4] + y[5]) + (y[6] + y[7]))`` with ``y[t] = x[i + 8 k + t] -
    level[k]``.
    """
    if not (x.dtype is types.float32 and level is LANES_OF[types.float64]):
        return None

    def codegen(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        x_value, i_value, less = args
        source = _Source(context, builder, x, x_value, _I64(LANES), _I64(LANES))
        found = []
        for first, levels in _parts(context, builder, level, less):
            values = list(source.columns(i_value, levels, first))
            while len(values) > 1:
                values = [builder.fadd(a, b) for a, b in zip(values[::2], values[1::2], strict=True)]
            found += values
        return found[0] if len(found) == 1 else builder.shuffle_vector(*found, _order(*range(LANES)))

    return level(x, types.intp, level), codegen


@intrinsic
def four_twice(typingctx: Any, x: Any, i: Any) -> Any:
    """Read four elements of an array of float64 into lanes 0 ... 3, and again into lanes 4 ... 7."""
    if x.dtype is not types.float64:
        return None
    lanes = LANES_OF[x.dtype]

    def codegen(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        four = ir.VectorType(ir.DoubleType(), _FOUR)
        value = element_aligned(builder.load(pointer(context, builder, x, args[0], args[1], four)), x)
        return builder.shuffle_vector(value, value, _order(*range(LANES)))

    return lanes(x, types.intp), codegen


@intrinsic
def transposed_halves(typingctx: Any, a: Any, b: Any, c: Any, d: Any) -> Any:
    """Transpose lanes 0 ... 3 of four values of lanes, and lanes 4 ... 7; return a tuple of four."""
    if not (isinstance(a, LanesType) and a is b and b is c and c is d):
        return None
    result = types.UniTuple(a, _FOUR)

    def codegen(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        return context.make_tuple(builder, result, _transposed(builder, list(args)))

    return result(a, b, c, d), codegen


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
