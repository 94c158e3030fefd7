"""Eight lanes as one value in compiled code: explicit SIMD for Numba.

Left to itself the compiler vectorises a loop over lanes only if it can prove that no two of some
twenty arrays overlap, which it cannot; the kernel would run four times slower. So the lanes are
a type here: ``load`` takes eight neighbours out of an array, ``+ - *``, comparisons, ``choose``,
``absolute`` and ``root`` work on all eight, ``store`` puts them back. LLVM maps the type to whatever
the machine has (one AVX-512 register, two AVX registers, four of SSE or NEON).

Every operation is exactly rounded, lane by lane, and none is ever fused or reordered, so a lane's
numbers do not depend on its neighbours. The same functions called from Python work on numbers and
NumPy arrays, so a formula written with them can be tested without compiling.
"""

from __future__ import annotations

import operator
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.core.datamodel import models
from numba.extending import intrinsic, overload, register_model

LANES = 8
"""Lanes in a value: doubles in the widest registers there are."""

_I64 = ir.IntType(64)


class LanesType(types.Type):
    """Type of eight floating-point lanes in compiled code."""

    def __init__(self, dtype: Any) -> None:
        self.dtype = dtype
        super().__init__(name=f"Lanes({dtype})")


class MaskType(types.Type):
    """Type of eight truth values in compiled code."""

    def __init__(self) -> None:
        super().__init__(name="Mask")


MASK = MaskType()
LANES_OF = {types.float64: LanesType(types.float64), types.float32: LanesType(types.float32)}
_ELEMENT = {types.float64: ir.DoubleType(), types.float32: ir.FloatType()}
_SUFFIX = {types.float64: "f64", types.float32: "f32"}


def _vector(lanes: LanesType) -> ir.VectorType:
    return ir.VectorType(_ELEMENT[lanes.dtype], LANES)


@register_model(LanesType)
class _LanesModel(models.PrimitiveModel):  # type: ignore[misc]
    def __init__(self, dmm: Any, fe_type: LanesType) -> None:
        super().__init__(dmm, fe_type, _vector(fe_type))


@register_model(MaskType)
class _MaskModel(models.PrimitiveModel):  # type: ignore[misc]
    def __init__(self, dmm: Any, fe_type: MaskType) -> None:
        super().__init__(dmm, fe_type, ir.VectorType(ir.IntType(1), LANES))


def _broadcast(builder: Any, scalar: Any, vector: ir.VectorType) -> Any:
    nothing = ir.Constant(vector, ir.Undefined)
    first = builder.insert_element(nothing, scalar, ir.Constant(ir.IntType(32), 0))
    return builder.shuffle_vector(first, nothing, ir.Constant(ir.VectorType(ir.IntType(32), LANES), [0] * LANES))


def _pointer(context: Any, builder: Any, array_type: Any, array: Any, index: Any, element: Any) -> Any:
    data = context.make_array(array_type)(context, builder, value=array).data
    return builder.bitcast(builder.gep(data, [index]), element.as_pointer())


def _aligned(instruction: Any, array_type: Any) -> Any:
    """Promise the alignment of one element only: buffers are aligned to cache lines, others' arrays may not be."""
    instruction.align = array_type.dtype.bitwidth // 8
    return instruction


# Memory


@intrinsic
def load(typingctx: Any, array: Any, index: Any) -> Any:
    """Take eight neighbours from a C-contiguous array, from a flat index on."""
    if not (isinstance(array, types.Array) and array.dtype in LANES_OF and array.layout == "C"):
        return None
    lanes = LANES_OF[array.dtype]

    def codegen(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        return _aligned(builder.load(_pointer(context, builder, array, *args, _vector(lanes))), array)

    return lanes(array, types.intp), codegen


@intrinsic
def store(typingctx: Any, array: Any, index: Any, value: Any) -> Any:
    """Put eight lanes into a C-contiguous array, from a flat index on."""
    if not (isinstance(array, types.Array) and value is LANES_OF.get(array.dtype) and array.layout == "C"):
        return None

    def codegen(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        _aligned(builder.store(args[2], _pointer(context, builder, array, args[0], args[1], _vector(value))), array)
        return context.get_dummy_value()

    return types.void(array, types.intp, value), codegen


@intrinsic
def spread(typingctx: Any, value: Any) -> Any:
    """Repeat a floating-point number in eight lanes."""
    if value not in LANES_OF:
        return None
    lanes = LANES_OF[value]

    def codegen(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        return _broadcast(builder, args[0], _vector(lanes))

    return lanes(value), codegen


@intrinsic
def mask_of(typingctx: Any, bits: Any) -> Any:
    """Make a mask of a byte, lane 0 in the lowest bit."""

    def codegen(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        return builder.bitcast(args[0], ir.VectorType(ir.IntType(1), LANES))

    return MASK(types.uint8), codegen


@intrinsic
def bits_of(typingctx: Any, mask: Any) -> Any:
    """Make a byte of a mask, lane 0 in the lowest bit."""

    def codegen(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        return builder.bitcast(args[0], ir.IntType(8))

    return types.uint8(MASK), codegen


@intrinsic
def lowest_bit(typingctx: Any, word: Any) -> Any:
    """Return the place of the lowest bit set in a word that is not 0."""

    def codegen(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        return builder.cttz(args[0], ir.Constant(ir.IntType(1), 1))

    return types.int64(types.uint64), codegen


# Arithmetic


def _binary(operation: Callable[[Any, Any, Any], Any], mask: bool = False) -> Any:
    """Make an intrinsic of two lanes, or of lanes and a number, which is rounded to the lanes' type first."""

    @intrinsic
    def compute(typingctx: Any, a: Any, b: Any) -> Any:
        lanes = a if isinstance(a, LanesType) else b

        def codegen(context: Any, builder: Any, signature: Any, args: Any) -> Any:
            values = []
            for value, kind in zip(args, (a, b), strict=True):
                if not isinstance(kind, LanesType):
                    value = _broadcast(builder, context.cast(builder, value, kind, lanes.dtype), _vector(lanes))
                values.append(value)
            return operation(builder, *values)

        return (MASK if mask else lanes)(a, b), codegen

    return compute


def _is_lanes(a: Any, b: Any) -> bool:
    """Whether this is an operation of lanes with the same lanes, or with a number."""
    kinds = [x for x in (a, b) if isinstance(x, LanesType)]
    others = [x for x in (a, b) if not isinstance(x, LanesType)]
    return bool(kinds) and all(k is kinds[0] for k in kinds) and all(isinstance(x, types.Number) for x in others)


def _define(symbol: Any, operation: Callable[[Any, Any, Any], Any], mask: bool = False) -> None:
    compute = _binary(operation, mask)

    @overload(symbol, strict=False, jit_options={"_nrt": False, "forceinline": True})
    def choose_operation(a: Any, b: Any) -> Any:
        return (lambda a, b: compute(a, b)) if _is_lanes(a, b) else None


_define(operator.add, lambda builder, a, b: builder.fadd(a, b))
_define(operator.sub, lambda builder, a, b: builder.fsub(a, b))
_define(operator.mul, lambda builder, a, b: builder.fmul(a, b))
_define(operator.truediv, lambda builder, a, b: builder.fdiv(a, b))
_define(operator.gt, lambda builder, a, b: builder.fcmp_ordered(">", a, b), mask=True)
_define(operator.lt, lambda builder, a, b: builder.fcmp_ordered("<", a, b), mask=True)
_define(operator.ge, lambda builder, a, b: builder.fcmp_ordered(">=", a, b), mask=True)
_define(operator.le, lambda builder, a, b: builder.fcmp_ordered("<=", a, b), mask=True)


@intrinsic
def _and(typingctx: Any, a: Any, b: Any) -> Any:
    return MASK(MASK, MASK), lambda context, builder, signature, args: builder.and_(*args)


@intrinsic
def _or(typingctx: Any, a: Any, b: Any) -> Any:
    return MASK(MASK, MASK), lambda context, builder, signature, args: builder.or_(*args)


@overload(operator.and_, strict=False, jit_options={"_nrt": False, "forceinline": True})
def _overload_and(a: Any, b: Any) -> Any:
    return (lambda a, b: _and(a, b)) if a is MASK and b is MASK else None


@overload(operator.or_, strict=False, jit_options={"_nrt": False, "forceinline": True})
def _overload_or(a: Any, b: Any) -> Any:
    return (lambda a, b: _or(a, b)) if a is MASK and b is MASK else None


def _unary(name: str) -> Any:
    """Make an intrinsic of LLVM's own vector function, exactly rounded."""

    @intrinsic
    def compute(typingctx: Any, a: Any) -> Any:
        def codegen(context: Any, builder: Any, signature: Any, args: Any) -> Any:
            kind = ir.FunctionType(_vector(a), [_vector(a)])
            full = f"llvm.{name}.v{LANES}{_SUFFIX[a.dtype]}"
            return builder.call(cgutils.get_or_insert_function(builder.module, kind, full), args)

        return a(a), codegen

    return compute


_absolute, _root = _unary("fabs"), _unary("sqrt")


@intrinsic
def _negative(typingctx: Any, a: Any) -> Any:
    return a(a), lambda context, builder, signature, args: builder.fneg(args[0])


@overload(operator.neg, strict=False, jit_options={"_nrt": False, "forceinline": True})
def _overload_neg(a: Any) -> Any:
    return (lambda a: _negative(a)) if isinstance(a, LanesType) else None


def absolute(x: Any) -> Any:
    """Magnitude of lanes, numbers or arrays."""
    return np.abs(x)


def root(x: Any) -> Any:
    """Square root of lanes, numbers or arrays; NaN below zero."""
    with np.errstate(invalid="ignore"):
        return np.sqrt(x)


def choose(mask: Any, yes: Any, no: Any) -> Any:
    """Take ``yes`` where the mask holds, else ``no``, lane by lane; one of the two may be a number."""
    return np.where(mask, yes, no)[()]


@overload(absolute, strict=False, jit_options={"_nrt": False, "forceinline": True})
def _overload_absolute(x: Any) -> Any:
    return (lambda x: _absolute(x)) if isinstance(x, LanesType) else None


@overload(root, strict=False, jit_options={"_nrt": False, "forceinline": True})
def _overload_root(x: Any) -> Any:
    return (lambda x: _root(x)) if isinstance(x, LanesType) else None


@overload(choose, strict=False, jit_options={"_nrt": False, "forceinline": True})
def _overload_choose(mask: Any, yes: Any, no: Any) -> Any:
    return (lambda mask, yes, no: _select(mask, yes, no)) if mask is MASK and _is_lanes(yes, no) else None


@intrinsic
def _select(typingctx: Any, mask: Any, yes: Any, no: Any) -> Any:
    lanes = yes if isinstance(yes, LanesType) else no

    def codegen(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        values = []
        for value, kind in zip(args[1:], (yes, no), strict=True):
            if not isinstance(kind, LanesType):
                value = _broadcast(builder, context.cast(builder, value, kind, lanes.dtype), _vector(lanes))
            values.append(value)
        return builder.select(args[0], *values)

    return lanes(mask, yes, no), codegen


# Two operations on blocks of rows


def fir_of(rows: int) -> Any:
    """Make the convolution of ``rows`` successive steps, unrolled over the taps.

    ``out[o + r w : + 8] = 0 + taps[0] x[i + r w] + taps[1] x[i + (r + 1) w] + ...`` with ``w = width``, each sum from
    left to right. Doing several steps at once reads each sample and each tap once instead of ``rows`` times.
    The number of taps is part of their type, a tuple, so a kernel is compiled for each.
    """

    @intrinsic
    def fir(typingctx: Any, taps: Any, x: Any, i: Any, out: Any, o: Any, width: Any) -> Any:
        lanes = LANES_OF[x.dtype]

        def codegen(context: Any, builder: Any, signature: Any, args: Any) -> Any:
            tap_values, x_value, i_value, out_value, o_value, w = args
            vector = _vector(lanes)

            def row(array_type: Any, array: Any, start: Any, number: int) -> Any:
                index = builder.add(start, builder.mul(w, ir.Constant(_I64, number)))
                return _pointer(context, builder, array_type, array, index, vector)

            zero = ir.Constant(vector, [ir.Constant(vector.element, 0.0)] * LANES)
            sums = [zero] * rows
            window: list[Any] = []
            for k in range(taps.count):
                tap = _broadcast(builder, builder.extract_value(tap_values, k), vector)
                for r in range(rows):
                    if k + r == len(window):
                        window.append(_aligned(builder.load(row(x, x_value, i_value, k + r)), x))
                    sums[r] = builder.fadd(sums[r], builder.fmul(tap, window[k + r]))
            for r in range(rows):
                _aligned(builder.store(sums[r], row(out, out_value, o_value, r)), out)
            return context.get_dummy_value()

        return types.void(taps, x, types.intp, out, types.intp, types.intp), codegen

    return fir


def _interleave(builder: Any, rows: Sequence[Any]) -> list[Any]:
    """Transpose eight vectors of eight in three rounds of shuffles."""
    index = ir.VectorType(ir.IntType(32), LANES)
    low = ir.Constant(index, [i // 2 + LANES * (i % 2) for i in range(LANES)])
    high = ir.Constant(index, [LANES // 2 + i // 2 + LANES * (i % 2) for i in range(LANES)])
    for _ in range(3):
        half = LANES // 2
        pairs = [(rows[i], rows[i + half]) for i in range(half)]
        rows = [builder.shuffle_vector(a, b, order) for a, b in pairs for order in (low, high)]
    return list(rows)


@intrinsic
def transpose(typingctx: Any, x: Any, i: Any, width: Any, out: Any, o: Any, stride: Any) -> Any:
    """Write eight rows of eight lanes as eight columns of float32.

    ``out[o + lane stride + r] = x[i + r width + lane]`` for r and lane in 0 ... 7.
    """
    lanes = LANES_OF[x.dtype]

    def codegen(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        x_value, i_value, w, out_value, o_value, s = args
        single = ir.VectorType(ir.FloatType(), LANES)

        def place(start: Any, step: Any, number: int) -> Any:
            return builder.add(start, builder.mul(step, ir.Constant(_I64, number)))

        rows = []
        for r in range(LANES):
            value = _aligned(
                builder.load(_pointer(context, builder, x, x_value, place(i_value, w, r), _vector(lanes))), x
            )
            rows.append(builder.fptrunc(value, single) if lanes.dtype is types.float64 else value)
        for lane, column in enumerate(_interleave(builder, rows)):
            _aligned(builder.store(column, _pointer(context, builder, out, out_value, place(o_value, s, lane), single)), out)
        return context.get_dummy_value()

    return types.void(x, types.intp, types.intp, out, types.intp, types.intp), codegen


def aligned(shape: tuple[int, ...], dtype: Any) -> Any:
    """Return zeros that begin at a cache line, which halves the cost of wide loads.

    Parameters
    ----------
    shape : tuple of int
    dtype : dtype

    Returns
    -------
    ndarray, C-contiguous
    """
    kind = np.dtype(dtype)
    size = int(np.prod(shape)) * kind.itemsize
    raw = np.zeros(size + 64, np.uint8)
    start = -raw.ctypes.data % 64
    return raw[start : start + size].view(kind).reshape(shape)
