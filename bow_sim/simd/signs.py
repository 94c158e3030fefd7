"""The sign of one value given to another, for lanes, numbers and arrays."""

from __future__ import annotations

from typing import Any

from llvmlite import ir
from numba import types

from bow_sim.simd.jit import intrinsic
from bow_sim.simd.lane_types import LANES, SIGNS_OF, LanesType, integers
from bow_sim.simd.lanes import choose, define, negative


def with_sign(s: Any, d: Any) -> Any:
    """Return s, or -s where d is below zero; in compiled code where its sign bit is set, without a choice."""
    return choose(negative(d), -s, s)


def _same(s: Any, d: Any) -> Any:
    return s if s is d and (s is types.float64 or isinstance(s, LanesType)) else None


def _emit(context: Any, builder: Any, signature: Any, args: Any) -> Any:
    kind = signature.return_type
    if isinstance(kind, LanesType):
        bits, sign = integers(SIGNS_OF[kind.dtype]), [1 << kind.dtype.bitwidth - 1] * LANES
    else:
        bits, sign = ir.IntType(kind.bitwidth), 1 << kind.bitwidth - 1
    s, d = (builder.bitcast(x, bits) for x in args)
    return builder.bitcast(builder.xor(s, builder.and_(d, ir.Constant(bits, sign))), args[0].type)


define(with_sign, [(LanesType, LanesType), (types.Float, types.Float)], _same, _emit)


@intrinsic
def followed(typingctx: Any, past: Any, signs: Any) -> Any:
    """Return the past states of lanes, as bits of the lanes, followed by one more; the latest is the highest bit."""
    if not isinstance(past, LanesType) or signs is not SIGNS_OF[past.dtype]:
        return None

    def codegen(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        bits, top = integers(signs), past.dtype.bitwidth - 1
        before = builder.lshr(builder.bitcast(args[0], bits), ir.Constant(bits, [1] * LANES))
        latest = builder.and_(args[1], ir.Constant(bits, [1 << top] * LANES))
        return builder.bitcast(builder.or_(before, latest), args[0].type)

    return past(past, signs), codegen
