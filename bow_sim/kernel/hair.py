"""The bow hair, for the time loops: compiled code only (PHYSICS.md section 12); for lanes, or a number and its cell."""

from __future__ import annotations

from typing import Any

from numba import types

from bow_sim.simd.jit import OVERLOAD, overload
from bow_sim.simd.lanes import read, write


def with_hair(hair: Any, base: Any, v_b: Any) -> Any:
    """Return the speed of the hair's end when no force acts: that of the bow and of the spring."""
    raise NotImplementedError


@overload(with_hair, strict=False, jit_options=OVERLOAD)
def _overload_with_hair(hair: Any, base: Any, v_b: Any) -> Any:
    if isinstance(hair, types.NoneType):
        return lambda hair, base, v_b: v_b
    return lambda hair, base, v_b: v_b + read(hair.state, base, v_b)


def pull_hair(hair: Any, base: Any, push: Any, v_h: Any, v: Any) -> Any:
    """Advance the spring by a step, and return the velocity of the string's surface; v is that with a rigid bow."""
    raise NotImplementedError


@overload(pull_hair, strict=False, jit_options=OVERLOAD)
def _overload_pull_hair(hair: Any, base: Any, push: Any, v_h: Any, v: Any) -> Any:
    if isinstance(hair, types.NoneType):
        return lambda hair, base, push, v_h, v: v

    def pull(hair: Any, base: Any, push: Any, v_h: Any, v: Any) -> Any:
        end = read(hair.share, base, push) * push  # where the velocity tends to under a constant force
        write(hair.state, base, end + (read(hair.state, base, push) - end) * read(hair.decay, base, push))
        return v_h + read(hair.string, base, push) * push

    return pull
