"""The body at the bridge, for the time loop: compiled code only (PHYSICS.md section 11)."""

from __future__ import annotations

from typing import Any

from numba import types

from bow_sim.simd.jit import OVERLOAD, overload
from bow_sim.simd.lanes import LANES, load, store


def reflect_at_body(body: Any, arrived: Any, group: Any, u: Any, n: Any) -> None:
    """Turn what arrives at the bridge into what the body sends back, if there is one, in rows u ... u + n - 1."""
    raise NotImplementedError


@overload(reflect_at_body, strict=False, jit_options=OVERLOAD)
def _overload_reflect_at_body(body: Any, arrived: Any, group: Any, u: Any, n: Any) -> Any:
    if isinstance(body, types.NoneType):
        return lambda body, arrived, group, u, n: None

    def reflect(body: Any, arrived: Any, group: Any, u: Any, n: Any) -> None:
        base, modes = group * LANES, body.z1.shape[1]
        own, mine = group * body.stride, base * modes
        sum_b, den = load(body.sum_b, base), load(body.den, base)
        rho, gain, pole = load(body.rho, base), load(body.gain, base), load(body.pole, base)
        z, tail = load(body.sum_z, base), load(body.tail, base)
        for r in range(u, u + n):
            x = load(arrived, r * LANES)
            force = ((rho + 1.0) * (x - z * 0.5) + gain * tail) * den
            v_m = sum_b * force + z
            left = x - v_m * 0.5
            back = v_m * 0.5 - rho * left - gain * tail
            tail = pole * tail + left
            z = x * 0.0
            for k in range(0, modes * LANES, LANES):
                b = load(body.b0, own + k) * force
                y = b + load(body.z1, mine + k)
                z1 = load(body.z2, mine + k) - load(body.a1, own + k) * y
                store(body.z1, mine + k, z1)
                store(body.z2, mine + k, -b - load(body.a2, own + k) * y)
                z = z + z1
            store(arrived, r * LANES, back)
            store(body.force, r * LANES, force)
            store(body.velocity, r * LANES, x + back)
        store(body.sum_z, base, z)
        store(body.tail, base, tail)

    return reflect


def of_body(body: Any, u: Any) -> Any:
    """Return velocity of the bridge and force on it, waveforms of a step; () without a body."""
    raise NotImplementedError


@overload(of_body, strict=False, jit_options=OVERLOAD)
def _overload_of_body(body: Any, u: Any) -> Any:
    if isinstance(body, types.NoneType):
        return lambda body, u: ()
    return lambda body, u: (load(body.velocity, u * LANES), load(body.force, u * LANES))
