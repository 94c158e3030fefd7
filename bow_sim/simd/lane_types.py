"""The types of eight lanes in compiled code, and what LLVM knows of them; see :mod:`bow_sim.simd.lanes`."""

from __future__ import annotations

from typing import Any

from llvmlite import ir
from numba import types
from numba.core.datamodel import models

from bow_sim.simd.jit import register_model

LANES = 8
"""Lanes in a value: the number of float64 in the widest registers, those of AVX-512."""


class LanesType(types.Type):
    """Type of eight floating-point lanes in compiled code."""

    def __init__(self, dtype: Any) -> None:
        self.dtype = dtype
        super().__init__(name=f"Lanes({dtype})")


class MaskType(types.Type):
    """Type of eight truth values in compiled code."""

    def __init__(self) -> None:
        super().__init__(name="Mask")


class SignsType(types.Type):
    """Type of eight truth values in compiled code, each the sign bit of an integer as wide as a lane.

    A `MaskType` is eight single bits. A machine without mask registers makes each of these from the lanes of a
    comparison and back by a chain of instructions; sign bits stay where the arithmetic put them.
    """

    def __init__(self, dtype: Any) -> None:
        self.dtype = dtype
        super().__init__(name=f"Signs({dtype})")


MASK = MaskType()
LANES_OF: dict[Any, Any] = {types.float64: LanesType(types.float64), types.float32: LanesType(types.float32)}
SIGNS_OF: dict[Any, Any] = {dtype: SignsType(dtype) for dtype in LANES_OF}
ELEMENT = {types.float64: ir.DoubleType(), types.float32: ir.FloatType()}
SUFFIX = {types.float64: "f64", types.float32: "f32"}


def vector(lanes: LanesType) -> ir.VectorType:
    """Return LLVM's type of eight lanes."""
    return ir.VectorType(ELEMENT[lanes.dtype], LANES)


def integers(signs: Any) -> ir.VectorType:
    """Return LLVM's type of the sign bits of lanes, or of the bits of lanes."""
    return ir.VectorType(ir.IntType(signs.dtype.bitwidth), LANES)


def in_halves(context: Any, lanes: Any) -> bool:
    """Return whether eight lanes are two registers of the machine that is compiled for."""
    return lanes.dtype is types.float64 and not has_avx512(context)


def has_avx512(context: Any) -> bool:
    """Return whether the machine that is compiled for has AVX-512: 32 registers, and registers for masks."""
    _, _, features = context.codegen().magic_tuple()
    return "+avx512f" in features.split(",")


def half(builder: Any, value: Any, number: int) -> Any:
    """Emit code for the lower (0) or upper (1) half of eight lanes."""
    size = LANES // 2
    places = ir.Constant(ir.VectorType(ir.IntType(32), size), [number * size + i for i in range(size)])
    return builder.shuffle_vector(value, ir.Constant(value.type, ir.Undefined), places)


@register_model(LanesType)
class _LanesModel(models.PrimitiveModel):
    def __init__(self, dmm: Any, fe_type: LanesType) -> None:
        super().__init__(dmm, fe_type, vector(fe_type))


@register_model(MaskType)
class _MaskModel(models.PrimitiveModel):
    def __init__(self, dmm: Any, fe_type: MaskType) -> None:
        super().__init__(dmm, fe_type, ir.VectorType(ir.IntType(1), LANES))


@register_model(SignsType)
class _SignsModel(models.PrimitiveModel):
    def __init__(self, dmm: Any, fe_type: SignsType) -> None:
        super().__init__(dmm, fe_type, integers(fe_type))


def broadcast(builder: Any, scalar: Any, kind: ir.VectorType) -> Any:
    """Emit code that repeats a number in all lanes of a type."""
    nothing = ir.Constant(kind, ir.Undefined)
    first = builder.insert_element(nothing, scalar, ir.Constant(ir.IntType(32), 0))
    places = ir.Constant(ir.VectorType(ir.IntType(32), kind.count), [0] * kind.count)
    return builder.shuffle_vector(first, nothing, places)


def pointer(context: Any, builder: Any, array_type: Any, array: Any, index: Any, element: Any) -> Any:
    """Emit code for the address of ``array.flat[index]``, as a pointer to ``element``."""
    data = context.make_array(array_type)(context, builder, value=array).data
    return builder.bitcast(builder.gep(data, [index]), element.as_pointer())


def element_aligned(instruction: Any, array_type: Any) -> Any:
    """Set the alignment of a load or store to that of one element: not all arrays begin at a cache line."""
    instruction.align = array_type.dtype.bitwidth // 8
    return instruction


def lanes_of(a: Any, b: Any) -> Any:
    """Return which of two types is that of lanes."""
    return a if isinstance(a, LanesType) else b


def widened(context: Any, builder: Any, lanes: LanesType, values: Any, kinds: Any) -> list[Any]:
    """Emit code that repeats those values that are numbers, after rounding them to the lanes' type."""
    return [
        value
        if isinstance(kind, LanesType)
        else broadcast(builder, context.cast(builder, value, kind, lanes.dtype), vector(lanes))
        for value, kind in zip(values, kinds, strict=True)
    ]


def is_lanes(a: Any, b: Any) -> bool:
    """Return whether both are lanes of one type, or one is lanes and the other a number."""
    kinds = [x for x in (a, b) if isinstance(x, LanesType)]
    others = [x for x in (a, b) if not isinstance(x, LanesType)]
    return bool(kinds) and all(k is kinds[0] for k in kinds) and all(isinstance(x, types.Number) for x in others)
