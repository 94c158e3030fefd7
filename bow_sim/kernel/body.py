"""The body at the bridge, for the time loops: compiled code only (PHYSICS.md section 11)."""

from __future__ import annotations

from typing import Any

from numba import types

from bow_sim.simd.jit import INLINE, OVERLOAD, overload, part
from bow_sim.simd.lanes import LANES, load, read, store, write


@part(**INLINE)
def _constants(body: Any, base: Any, like: Any) -> Any:
    return (
        read(body.sum_b, base, like),
        read(body.den, base, like),
        read(body.rho, base, like),
        read(body.gain, base, like),
        read(body.pole, base, like),
    )


@part(**INLINE)
def _reflect(body: Any, constants: Any, own: Any, mine: Any, x: Any, z: Any, tail: Any) -> Any:
    """Return what the body sends back in a step, the force on the bridge, and z and tail for the next step.

    For lanes, or for a number; own and mine are the flat indices of its first coefficient and of its first state.
    """
    sum_b, den, rho, gain, pole = constants
    force = ((rho + 1.0) * (x - z * 0.5) + gain * tail) * den
    v_m = sum_b * force + z
    left = x - v_m * 0.5
    back = v_m * 0.5 - rho * left - gain * tail
    tail = pole * tail + left
    z = x * 0.0
    for k in range(0, body.z1.shape[1] * LANES, LANES):
        b = read(body.b0, own + k, x) * force
        y = b + read(body.z1, mine + k, x)
        z1 = read(body.z2, mine + k, x) - read(body.a1, own + k, x) * y
        write(body.z1, mine + k, z1)
        write(body.z2, mine + k, -b - read(body.a2, own + k, x) * y)
        z = z + z1
    return back, force, z, tail


def reflect_at_body(body: Any, arrived: Any, group: Any, u: Any, n: Any) -> None:
    """Turn what arrives at the bridge into what the body sends back, if there is one, in rows u ... u + n - 1."""
    raise NotImplementedError


@overload(reflect_at_body, strict=False, jit_options=OVERLOAD)
def _overload_reflect_at_body(body: Any, arrived: Any, group: Any, u: Any, n: Any) -> Any:
    if isinstance(body, types.NoneType):
        return lambda body, arrived, group, u, n: None

    def reflect(body: Any, arrived: Any, group: Any, u: Any, n: Any) -> None:
        base = group * LANES
        z, tail = load(body.sum_z, base), load(body.tail, base)
        constants = _constants(body, base, z)
        for r in range(u, u + n):
            x = load(arrived, r * LANES)
            back, force, z, tail = _reflect(body, constants, group * body.stride, base * body.z1.shape[1], x, z, tail)
            store(arrived, r * LANES, back)
            store(body.force, r * LANES, force)
            store(body.velocity, r * LANES, x + back)
        store(body.sum_z, base, z)
        store(body.tail, base, tail)

    return reflect


def reflect_one(body: Any, x: Any, cell: Any, u: Any) -> Any:
    """Return what the body sends back of x, a number, to one cell in step u of eight; x where there is no body."""
    raise NotImplementedError


@overload(reflect_one, strict=False, jit_options=OVERLOAD)
def _overload_reflect_one(body: Any, x: Any, cell: Any, u: Any) -> Any:
    if isinstance(body, types.NoneType):
        return lambda body, x, cell, u: x

    def reflect(body: Any, x: Any, cell: Any, u: Any) -> Any:
        group, lane = cell // LANES, cell % LANES
        own, mine = group * body.stride + lane, group * LANES * body.z1.shape[1] + lane
        z, tail = read(body.sum_z, cell, x), read(body.tail, cell, x)
        back, force, z, tail = _reflect(body, _constants(body, cell, x), own, mine, x, z, tail)
        write(body.sum_z, cell, z)
        write(body.tail, cell, tail)
        write(body.force, u, force)
        write(body.velocity, u, x + back)
        return back

    return reflect


def of_body(body: Any, place: Any, like: Any) -> Any:
    """Return velocity of the bridge and force on it, waveforms of a step at a flat index; () without a body."""
    raise NotImplementedError


@overload(of_body, strict=False, jit_options=OVERLOAD)
def _overload_of_body(body: Any, place: Any, like: Any) -> Any:
    if isinstance(body, types.NoneType):
        return lambda body, place, like: ()
    return lambda body, place, like: (read(body.velocity, place, like), read(body.force, place, like))
