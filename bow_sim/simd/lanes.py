"""Eight lanes as one value in compiled code: explicit SIMD for Numba.

The compiler vectorises a loop over lanes only if it can prove that none of some twenty arrays overlap, which it cannot;
the kernel would be four times slower. So here eight lanes are a type: ``load`` reads eight neighbouring elements of an
array, ``+ - * /``, comparisons, ``choose``, ``absolute`` and ``root`` work on all eight, ``store`` writes them. LLVM
maps the type to the registers of the machine (one of AVX-512, two of AVX, four of SSE or NEON).

Every operation is exactly rounded, lane by lane, and none is fused or reordered, so a lane's numbers do not depend on
its neighbours. The functions can also be called from Python with numbers and NumPy arrays, so that a formula can be
tested without compiling it.
"""

from __future__ import annotations

import operator
from collections.abc import Callable
from typing import Any

import numpy as np
from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.core.datamodel import models

from bow_sim.simd.jit import INLINE, intrinsic, overload, register_model

LANES = 8
"""Lanes in a value: the number of float64 in the widest registers, those of AVX-512."""

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
LANES_OF: dict[Any, Any] = {types.float64: LanesType(types.float64), types.float32: LanesType(types.float32)}
_ELEMENT = {types.float64: ir.DoubleType(), types.float32: ir.FloatType()}
_SUFFIX = {types.float64: "f64", types.float32: "f32"}


def vector(lanes: LanesType) -> ir.VectorType:
    """Return LLVM's type of eight lanes."""
    return ir.VectorType(_ELEMENT[lanes.dtype], LANES)


@register_model(LanesType)
class _LanesModel(models.PrimitiveModel):
    def __init__(self, dmm: Any, fe_type: LanesType) -> None:
        super().__init__(dmm, fe_type, vector(fe_type))


@register_model(MaskType)
class _MaskModel(models.PrimitiveModel):
    def __init__(self, dmm: Any, fe_type: MaskType) -> None:
        super().__init__(dmm, fe_type, ir.VectorType(ir.IntType(1), LANES))


def broadcast(builder: Any, scalar: Any, kind: ir.VectorType) -> Any:
    """Emit code that repeats a number in eight lanes."""
    nothing = ir.Constant(kind, ir.Undefined)
    first = builder.insert_element(nothing, scalar, ir.Constant(ir.IntType(32), 0))
    return builder.shuffle_vector(first, nothing, ir.Constant(ir.VectorType(ir.IntType(32), LANES), [0] * LANES))


def pointer(context: Any, builder: Any, array_type: Any, array: Any, index: Any, element: Any) -> Any:
    """Emit code for the address of ``array.flat[index]``, as a pointer to ``element``."""
    data = context.make_array(array_type)(context, builder, value=array).data
    return builder.bitcast(builder.gep(data, [index]), element.as_pointer())


def element_aligned(instruction: Any, array_type: Any) -> Any:
    """Set the alignment of a load or store to that of one element: not all arrays begin at a cache line."""
    instruction.align = array_type.dtype.bitwidth // 8
    return instruction


# Memory


@intrinsic
def load(typingctx: Any, array: Any, index: Any) -> Any:
    """Read eight neighbouring elements of a C-contiguous array, from a flat index on."""
    if not (isinstance(array, types.Array) and array.dtype in LANES_OF and array.layout == "C"):
        return None
    lanes = LANES_OF[array.dtype]

    def codegen(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        return element_aligned(builder.load(pointer(context, builder, array, args[0], args[1], vector(lanes))), array)

    return lanes(array, types.intp), codegen


@intrinsic
def store(typingctx: Any, array: Any, index: Any, value: Any) -> Any:
    """Write eight lanes into a C-contiguous array, from a flat index on."""
    if not (isinstance(array, types.Array) and array.dtype in LANES_OF and array.layout == "C"):
        return None
    if value is not LANES_OF[array.dtype]:
        return None

    def codegen(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        element_aligned(
            builder.store(args[2], pointer(context, builder, array, args[0], args[1], vector(value))), array
        )
        return context.get_dummy_value()

    return types.void(array, types.intp, value), codegen


@intrinsic
def spread(typingctx: Any, value: Any) -> Any:
    """Repeat a floating-point number in eight lanes."""
    if value not in LANES_OF:
        return None
    lanes = LANES_OF[value]

    def codegen(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        return broadcast(builder, args[0], vector(lanes))

    return lanes(value), codegen


@intrinsic
def mask_of(typingctx: Any, bits: Any) -> Any:
    """Convert a byte to a mask, lane 0 in the lowest bit."""

    def codegen(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        return builder.bitcast(args[0], ir.VectorType(ir.IntType(1), LANES))

    return MASK(types.uint8), codegen


@intrinsic
def bits_of(typingctx: Any, mask: Any) -> Any:
    """Convert a mask to a byte, lane 0 in the lowest bit."""

    def codegen(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        return builder.bitcast(args[0], ir.IntType(8))

    return types.uint8(MASK), codegen


@intrinsic
def lowest_bit(typingctx: Any, bits: Any) -> Any:
    """Return the place of the lowest bit that is set in a number of 64 bits that is not 0."""

    def codegen(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        return builder.cttz(args[0], ir.Constant(ir.IntType(1), 1))

    return types.int64(types.uint64), codegen


# Arithmetic


def _widened(context: Any, builder: Any, lanes: LanesType, values: Any, kinds: Any) -> list[Any]:
    """Emit code that repeats those values that are numbers, after rounding them to the lanes' type."""
    return [
        value
        if isinstance(kind, LanesType)
        else broadcast(builder, context.cast(builder, value, kind, lanes.dtype), vector(lanes))
        for value, kind in zip(values, kinds, strict=True)
    ]


def _binary(operation: Callable[[Any, Any, Any], Any], mask: bool = False) -> Any:
    """Return the intrinsic of an operation on two values of lanes, or on lanes and a number."""

    @intrinsic
    def compute(typingctx: Any, a: Any, b: Any) -> Any:
        lanes = a if isinstance(a, LanesType) else b

        def codegen(context: Any, builder: Any, signature: Any, args: Any) -> Any:
            return operation(builder, *_widened(context, builder, lanes, args, (a, b)))

        return (MASK if mask else lanes)(a, b), codegen

    return compute


def _is_lanes(a: Any, b: Any) -> bool:
    """Return whether both are lanes of one type, or one is lanes and the other a number."""
    kinds = [x for x in (a, b) if isinstance(x, LanesType)]
    others = [x for x in (a, b) if not isinstance(x, LanesType)]
    return bool(kinds) and all(k is kinds[0] for k in kinds) and all(isinstance(x, types.Number) for x in others)


def _define(symbol: Any, operation: Callable[[Any, Any, Any], Any], mask: bool = False) -> None:
    compute = _binary(operation, mask)

    @overload(symbol, strict=False, jit_options=INLINE)
    def choose_operation(a: Any, b: Any) -> Any:
        def compiled(a: Any, b: Any) -> Any:
            return compute(a, b)

        return compiled if _is_lanes(a, b) else None


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


@overload(operator.and_, strict=False, jit_options=INLINE)
def _overload_and(a: Any, b: Any) -> Any:
    def compiled(a: Any, b: Any) -> Any:
        return _and(a, b)

    return compiled if a is MASK and b is MASK else None


@overload(operator.or_, strict=False, jit_options=INLINE)
def _overload_or(a: Any, b: Any) -> Any:
    def compiled(a: Any, b: Any) -> Any:
        return _or(a, b)

    return compiled if a is MASK and b is MASK else None


def _unary(name: str) -> Any:
    """Return the intrinsic of one of LLVM's vector functions, exactly rounded."""

    @intrinsic
    def compute(typingctx: Any, a: Any) -> Any:
        def codegen(context: Any, builder: Any, signature: Any, args: Any) -> Any:
            kind = ir.FunctionType(vector(a), [vector(a)])
            full = f"llvm.{name}.v{LANES}{_SUFFIX[a.dtype]}"
            return builder.call(cgutils.get_or_insert_function(builder.module, kind, full), args)

        return a(a), codegen

    return compute


_absolute, _root = _unary("fabs"), _unary("sqrt")


@intrinsic
def _negative(typingctx: Any, a: Any) -> Any:
    return a(a), lambda context, builder, signature, args: builder.fneg(args[0])


@overload(operator.neg, strict=False, jit_options=INLINE)
def _overload_neg(a: Any) -> Any:
    def compiled(a: Any) -> Any:
        return _negative(a)

    return compiled if isinstance(a, LanesType) else None


def absolute(x: Any) -> Any:
    """Return the magnitude of lanes, numbers or arrays."""
    return np.abs(x)


def root(x: Any) -> Any:
    """Return the square root of lanes, numbers or arrays; NaN below zero."""
    with np.errstate(invalid="ignore"):
        return np.sqrt(x)


def choose(mask: Any, yes: Any, no: Any) -> Any:
    """Return ``yes`` where the mask is true, else ``no``, lane by lane; one of the two may be a number."""
    return np.where(mask, yes, no)[()]


@overload(absolute, strict=False, jit_options=INLINE)
def _overload_absolute(x: Any) -> Any:
    def compiled(x: Any) -> Any:
        return _absolute(x)

    return compiled if isinstance(x, LanesType) else None


@overload(root, strict=False, jit_options=INLINE)
def _overload_root(x: Any) -> Any:
    def compiled(x: Any) -> Any:
        return _root(x)

    return compiled if isinstance(x, LanesType) else None


@overload(choose, strict=False, jit_options=INLINE)
def _overload_choose(mask: Any, yes: Any, no: Any) -> Any:
    def compiled(mask: Any, yes: Any, no: Any) -> Any:
        return _select(mask, yes, no)

    return compiled if mask is MASK and _is_lanes(yes, no) else None


@intrinsic
def _select(typingctx: Any, mask: Any, yes: Any, no: Any) -> Any:
    lanes = yes if isinstance(yes, LanesType) else no

    def codegen(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        return builder.select(args[0], *_widened(context, builder, lanes, args[1:], (yes, no)))

    return lanes(mask, yes, no), codegen


def aligned(shape: tuple[int, ...], dtype: Any) -> Any:
    """Return zeros that begin at a cache line, which halves the time of loads of eight.

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
