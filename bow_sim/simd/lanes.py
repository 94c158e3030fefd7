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
from typing import Any, ClassVar

import numpy as np
from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.core.typing.templates import AbstractTemplate, infer_global

from bow_sim.simd.jit import intrinsic, lower_builtin
from bow_sim.simd.lane_types import (
    LANES,
    LANES_OF,
    MASK,
    SIGNS_OF,
    SUFFIX,
    LanesType,
    MaskType,
    SignsType,
    broadcast,
    element_aligned,
    half,
    in_halves,
    integers,
    is_lanes,
    lanes_of,
    pointer,
    vector,
    widened,
)

_I64 = ir.IntType(64)

# Memory


def _emit_load(context: Any, builder: Any, signature: Any, args: Any) -> Any:
    """Emit code that reads lanes, or a number, from an array."""
    array, kind = signature.args[0], context.get_data_type(signature.return_type)
    return element_aligned(builder.load(pointer(context, builder, array, args[0], args[1], kind)), array)


def _emit_store(context: Any, builder: Any, signature: Any, args: Any) -> Any:
    """Emit code that writes lanes, or a number, into an array."""
    array, _, value = signature.args
    place = pointer(context, builder, array, args[0], args[1], context.get_data_type(value))
    element_aligned(builder.store(args[2], place), array)
    return context.get_dummy_value()


@intrinsic
def load(typingctx: Any, array: Any, index: Any) -> Any:
    """Read eight neighbouring elements of a C-contiguous array, from a flat index on."""
    if not (isinstance(array, types.Array) and array.dtype in LANES_OF and array.layout == "C"):
        return None
    lanes = LANES_OF[array.dtype]

    return lanes(array, types.intp), _emit_load


@intrinsic
def store(typingctx: Any, array: Any, index: Any, value: Any) -> Any:
    """Write eight lanes into a C-contiguous array, from a flat index on."""
    if not (isinstance(array, types.Array) and array.dtype in LANES_OF and array.layout == "C"):
        return None
    if value is not LANES_OF[array.dtype]:
        return None

    return types.void(array, types.intp, value), _emit_store


@intrinsic
def read(typingctx: Any, array: Any, index: Any, like: Any) -> Any:
    """Read eight elements, as `load` does, where `like` is lanes; where it is a number, one element."""
    if not (isinstance(array, types.Array) and array.layout == "C" and array.dtype is getattr(like, "dtype", like)):
        return None

    return like(array, types.intp, like), _emit_load


@intrinsic
def write(typingctx: Any, array: Any, index: Any, value: Any) -> Any:
    """Write eight lanes, as `store` does, or a number."""
    if not (isinstance(array, types.Array) and array.layout == "C" and array.dtype is getattr(value, "dtype", value)):
        return None

    return types.void(array, types.intp, value), _emit_store


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
    """Convert a mask or signs to a byte, lane 0 in the lowest bit."""
    byte = ir.IntType(8)

    def codegen(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        if mask is MASK:
            return builder.bitcast(args[0], byte)
        if not in_halves(context, mask):
            return builder.bitcast(_is_negative(builder, args[0]), byte)
        low, high = (
            builder.zext(builder.bitcast(_is_negative(builder, half(builder, args[0], n)), ir.IntType(4)), byte)
            for n in (0, 1)
        )
        return builder.or_(low, builder.shl(high, byte(LANES // 2)))

    return (types.uint8(mask), codegen) if isinstance(mask, (MaskType, SignsType)) else None


@intrinsic
def signs_of(typingctx: Any, mask: Any, like: Any) -> Any:
    """Convert a mask, or signs, to signs as wide as the lanes `like`."""
    if not isinstance(like, LanesType) or not (mask is MASK or mask is SIGNS_OF[like.dtype]):
        return None
    signs = SIGNS_OF[like.dtype]

    def codegen(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        return _widened_mask(builder, args[0], mask, signs)

    return signs(mask, like), codegen


def _widened_mask(builder: Any, value: Any, kind: Any, signs: SignsType) -> Any:
    """Emit code that makes signs of a mask, and leaves signs as they are."""
    return builder.sext(value, integers(signs)) if kind is MASK else value


def _is_negative(builder: Any, integers: Any) -> Any:
    return builder.icmp_signed("<", integers, ir.Constant(integers.type, [0] * integers.type.count))


@intrinsic
def lowest_bit(typingctx: Any, bits: Any) -> Any:
    """Return the place of the lowest bit that is set in a number of 64 bits that is not 0."""

    def codegen(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        return builder.cttz(args[0], ir.Constant(ir.IntType(1), 1))

    return types.int64(types.uint64), codegen


# Arithmetic


_PAIRS = ((LanesType, LanesType), (LanesType, types.Number), (types.Number, LanesType))


def define(symbol: Any, kinds: Any, result: Callable[..., Any], emit: Callable[..., Any]) -> None:
    """Define an operator or function of lanes as code that is put where it is used.

    With `overload` it would be a function of its own for every type, compiled, linked and inlined for the sake of one
    instruction.

    Parameters
    ----------
    symbol : callable
    kinds : sequence of tuple of type
        The types of arguments that it takes.
    result : callable
        ``result(*types)`` returns the type of the result; None for types that are none of its.
    emit : callable
        ``emit(context, builder, signature, args)`` emits the code.
    """

    @infer_global(symbol)
    class _Typing(AbstractTemplate):
        metadata: ClassVar[dict[str, str]] = {"target": "cpu"}  # before Numba's own operators, of which there are many

        def generic(self, args: Any, kws: Any) -> Any:
            found = result(*args) if len(args) == len(kinds[0]) and not kws else None
            return None if found is None else found(*args)

    for kind in kinds:
        lower_builtin(symbol, *kind)(emit)


def _define_binary(symbol: Any, operation: Callable[[Any, Any, Any], Any], mask: bool = False) -> None:
    """Define an operator for two values of lanes, or for lanes and a number."""

    def result(a: Any, b: Any) -> Any:
        return (MASK if mask else lanes_of(a, b)) if is_lanes(a, b) else None

    def emit(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        return operation(builder, *widened(context, builder, lanes_of(*signature.args), args, signature.args))

    define(symbol, _PAIRS, result, emit)


_define_binary(operator.add, lambda builder, a, b: builder.fadd(a, b))
_define_binary(operator.sub, lambda builder, a, b: builder.fsub(a, b))
_define_binary(operator.mul, lambda builder, a, b: builder.fmul(a, b))
_define_binary(operator.truediv, lambda builder, a, b: builder.fdiv(a, b))
_define_binary(operator.gt, lambda builder, a, b: builder.fcmp_ordered(">", a, b), mask=True)
_define_binary(operator.lt, lambda builder, a, b: builder.fcmp_ordered("<", a, b), mask=True)
_define_binary(operator.ge, lambda builder, a, b: builder.fcmp_ordered(">=", a, b), mask=True)
_define_binary(operator.le, lambda builder, a, b: builder.fcmp_ordered("<=", a, b), mask=True)


def _define_of_masks(symbol: Any, operation: Callable[[Any, Any, Any], Any]) -> None:
    """Define an operator for two masks or signs; of one of each it makes signs."""

    def result(a: Any, b: Any) -> Any:
        if not all(isinstance(x, (MaskType, SignsType)) for x in (a, b)):
            return None
        signs = {x for x in (a, b) if x is not MASK}
        return None if len(signs) > 1 else signs.pop() if signs else MASK

    def emit(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        if signature.return_type is not MASK:
            args = [
                _widened_mask(builder, x, kind, signature.return_type)
                for x, kind in zip(args, signature.args, strict=True)
            ]
        return operation(builder, *args)

    pairs = [(a, b) for a in (MaskType, SignsType) for b in (MaskType, SignsType)]
    define(symbol, pairs, result, emit)


_define_of_masks(operator.and_, lambda builder, a, b: builder.and_(a, b))
_define_of_masks(operator.or_, lambda builder, a, b: builder.or_(a, b))


def absolute(x: Any) -> Any:
    """Return the magnitude of lanes, numbers or arrays."""
    return np.abs(x)


def root(x: Any) -> Any:
    """Return the square root of lanes, numbers or arrays; NaN below zero."""
    with np.errstate(invalid="ignore"):
        return np.sqrt(x)


def negative(x: Any) -> Any:
    """Return where lanes, numbers or arrays are below zero; for lanes their sign bits, so of -0 and NaN too."""
    return x < 0


def not_negative(x: Any) -> Any:
    """Return the opposite of `negative`."""
    return x >= 0


def choose(mask: Any, yes: Any, no: Any) -> Any:
    """Return ``yes`` where the mask is true, else ``no``, lane by lane; one of the two may be a number."""
    return np.where(mask, yes, no)[()]


def _define_unary(symbol: Any, operation: Callable[[Any, Any, LanesType], Any]) -> None:
    def result(a: Any) -> Any:
        return a if isinstance(a, LanesType) else None

    def emit(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        return operation(builder, args[0], signature.args[0])

    define(symbol, [(LanesType,)], result, emit)


def _llvm(name: str) -> Callable[[Any, Any, LanesType], Any]:
    """Return what emits a call of one of LLVM's vector functions, exactly rounded."""

    def call(builder: Any, value: Any, lanes: LanesType) -> Any:
        kind = ir.FunctionType(vector(lanes), [vector(lanes)])
        full = f"llvm.{name}.v{LANES}{SUFFIX[lanes.dtype]}"
        return builder.call(cgutils.get_or_insert_function(builder.module, kind, full), [value])

    return call


_define_unary(operator.neg, lambda builder, a, lanes: builder.fneg(a))
_define_unary(absolute, _llvm("fabs"))
_define_unary(root, _llvm("sqrt"))


def _define_signs(symbol: Any, operation: Callable[[Any, Any], Any]) -> None:
    def result(a: Any) -> Any:
        return SIGNS_OF[a.dtype] if isinstance(a, LanesType) else None

    def emit(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        return operation(builder, builder.bitcast(args[0], integers(signature.return_type)))

    define(symbol, [(LanesType,)], result, emit)


def _define_for_numbers(symbol: Any, result: Any, emit: Callable[[Any, Any], Any]) -> None:
    """Define a function of lanes for a number, too: float64, as a number's operations with constants are float64."""

    def typed(a: Any) -> Any:
        return result if a is types.float64 else None

    define(symbol, [(types.Float,)], typed, lambda context, builder, signature, args: emit(builder, args[0]))


def _number(name: str) -> Callable[[Any, Any], Any]:
    def call(builder: Any, value: Any) -> Any:
        double = ir.DoubleType()
        kind = ir.FunctionType(double, [double])
        return builder.call(cgutils.get_or_insert_function(builder.module, kind, f"llvm.{name}.f64"), [value])

    return call


def _sign(relation: str) -> Callable[[Any, Any], Any]:
    return lambda builder, value: builder.icmp_signed(relation, builder.bitcast(value, _I64), ir.Constant(_I64, 0))


_define_for_numbers(absolute, types.float64, _number("fabs"))
_define_for_numbers(root, types.float64, _number("sqrt"))
_define_for_numbers(negative, types.boolean, _sign("<"))
_define_for_numbers(not_negative, types.boolean, _sign(">="))
define(
    choose,
    [(types.Boolean, types.Float, types.Float)],
    lambda mask, yes, no: types.float64 if (mask, yes, no) == (types.boolean, types.float64, types.float64) else None,
    lambda context, builder, signature, args: builder.select(*args),
)
_define_signs(negative, lambda builder, bits: bits)
_define_signs(not_negative, lambda builder, bits: builder.not_(bits))


def _chosen(mask: Any, yes: Any, no: Any) -> Any:
    if not is_lanes(yes, no):
        return None
    lanes = lanes_of(yes, no)
    return lanes if mask is MASK or mask is SIGNS_OF[lanes.dtype] else None


def _emit_choice(context: Any, builder: Any, signature: Any, args: Any) -> Any:
    values = widened(context, builder, signature.return_type, args[1:], signature.args[1:])
    mask = args[0] if signature.args[0] is MASK else _is_negative(builder, args[0])
    return builder.select(mask, *values)


define(choose, [(mask, *pair) for mask in (MaskType, SignsType) for pair in _PAIRS], _chosen, _emit_choice)


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
