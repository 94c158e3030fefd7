"""Eight lanes that are eight steps of one number; in compiled code only."""

from __future__ import annotations

from typing import Any

from llvmlite import ir

from bow_sim.simd.jit import intrinsic
from bow_sim.simd.lane_types import LANES, LanesType

_I32 = ir.IntType(32)


@intrinsic
def lowest(typingctx: Any, lanes: Any) -> Any:
    """Return lane 0."""
    return _lane(lanes, 0)


@intrinsic
def highest(typingctx: Any, lanes: Any) -> Any:
    """Return lane 7."""
    return _lane(lanes, LANES - 1)


def _lane(lanes: Any, number: int) -> Any:
    if not isinstance(lanes, LanesType):
        return None

    def codegen(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        return builder.extract_element(args[0], _I32(number))

    return lanes.dtype(lanes), codegen


@intrinsic
def rotated(typingctx: Any, lanes: Any) -> Any:
    """Return lanes 1 ... 7 as lanes 0 ... 6, and lane 0 as lane 7."""
    if not isinstance(lanes, LanesType):
        return None

    def codegen(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        places = ir.Constant(ir.VectorType(_I32, LANES), [(lane + 1) % LANES for lane in range(LANES)])
        return builder.shuffle_vector(args[0], ir.Constant(args[0].type, ir.Undefined), places)

    return lanes(lanes), codegen


@intrinsic
def recursion(typingctx: Any, pole: Any, z: Any, x: Any) -> Any:
    """Return ``z = pole z + x`` after each of eight steps; z and pole are numbers, x is lanes."""
    if not isinstance(x, LanesType) or pole is not x.dtype or z is not x.dtype:
        return None

    def codegen(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        pole, z, x = args
        result = ir.Constant(x.type, ir.Undefined)
        for lane in map(_I32, range(LANES)):
            z = builder.fadd(builder.fmul(pole, z), builder.extract_element(x, lane))
            result = builder.insert_element(result, z, lane)
        return result

    return x(pole, z, x), codegen
