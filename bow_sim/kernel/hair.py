"""The bow hair, for the time loop: compiled code only (PHYSICS.md section 12)."""

from __future__ import annotations

from typing import Any

from numba import types

from bow_sim.simd.jit import OVERLOAD, overload
from bow_sim.simd.lanes import load, store


def with_hair(hair: Any, base: Any, v_b: Any) -> Any:
    """Return the speed of the hair's end when no force acts: that of the bow and of the spring."""
    raise NotImplementedError


@overload(with_hair, strict=False, jit_options=OVERLOAD)
def _overload_with_hair(hair: Any, base: Any, v_b: Any) -> Any:
    if isinstance(hair, types.NoneType):
        return lambda hair, base, v_b: v_b
    return lambda hair, base, v_b: v_b + load(hair.state, base)


def pull_hair(hair: Any, base: Any, push: Any, v_h: Any, v: Any) -> Any:
    """Advance the spring by a step, and return the velocity of the string's surface; v is that with a rigid bow."""
    raise NotImplementedError


@overload(pull_hair, strict=False, jit_options=OVERLOAD)
def _overload_pull_hair(hair: Any, base: Any, push: Any, v_h: Any, v: Any) -> Any:
    if isinstance(hair, types.NoneType):
        return lambda hair, base, push, v_h, v: v

    def pull(hair: Any, base: Any, push: Any, v_h: Any, v: Any) -> Any:
        end = load(hair.share, base) * push  # where the velocity tends to under a constant force
        store(hair.state, base, end + (load(hair.state, base) - end) * load(hair.decay, base))
        return v_h + load(hair.string, base) * push

    return pull
