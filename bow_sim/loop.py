"""The time loop: eight cells at a time, each exactly as if it were alone.

Compiled code only; :mod:`bow_sim.kernel` is its face. One source serves every model: a kernel is
compiled for the types it is given, and the number of taps is part of the type.

A reflection function whose first lag is m can be applied to m future steps at once, since what
arrives then has already left. So the arrivals are computed ahead, up to eight steps, with each
sample read once, and the only work left in a step is friction and four sums. The outgoing waves live in
rings as short as the longest lag allows, so that the state of eight cells stays in the first-level cache.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numba import njit
from numba.extending import overload
from numba import types

from bow_sim.friction import solve
from bow_sim.simd import LANES, bits_of, choose, fir_of, load, lowest_bit, mask_of, spread, store, transpose

STRIDE = 8
"""Steps that are computed between two transpositions; as many as there are lanes, for squares."""


class Tail(NamedTuple):
    """Exponential tails of a reflection function, arrays over groups and lanes; see :class:`Side`.

    ``state = pole state + gain x[t - first]``, with x filtered by ``taps`` where the lag differs between lanes.
    """

    gain: Any
    pole: Any
    state: Any
    first: Any
    taps: Any


class Side(NamedTuple):
    """One way out of the bow and back, for all groups of eight cells.

    Parameters
    ----------
    taps : tuple of float, or ndarray, shape (groups, taps, 8)
        Coefficients, the greatest lag first: common to all cells, or each cell's own.
    last : ndarray, shape (groups,)
        The greatest lag, samples.
    ahead : ndarray, shape (groups,)
        The least lag of taps and tail: how many steps can be computed at once.
    tail : Tail or None
    ring : ndarray, shape (groups, length + guard, 8)
        Outgoing wave; ``length`` rows, of which the first ``guard`` are repeated at the end, so that a
        window of rows never has to wrap.
    length, guard : int
        Rows.
    arrived : ndarray, shape (8, 8)
        Incoming wave in the eight steps under way.
    """

    taps: Any
    last: Any
    ahead: Any
    tail: Any
    ring: Any
    length: Any
    guard: Any
    arrived: Any


class Gesture(NamedTuple):
    """``f_b = f_end + f_step force(t)``, ``v_b = v_0 + v_1 speed(t)``; shapes (samples,) or (groups, samples, 8)."""

    f_end: Any
    f_step: Any
    v_0: Any
    v_1: Any
    force: Any
    speed: Any


_fir1, _fir2, _fir8 = fir_of(1), fir_of(2), fir_of(8)


def _convolve(taps: Any, group: Any, x: Any, i: Any, out: Any, u: Any, n: Any) -> None:
    """Fill rows u ... u + n - 1 of ``out``, the window of the first beginning at flat index i of x."""
    raise NotImplementedError


@overload(_convolve, strict=False, jit_options={"_nrt": False, "forceinline": True})
def _convolve_overload(taps: Any, group: Any, x: Any, i: Any, out: Any, u: Any, n: Any) -> Any:
    if isinstance(taps, types.BaseTuple):

        def common(taps: Any, group: Any, x: Any, i: Any, out: Any, u: Any, n: Any) -> None:
            if n == STRIDE:
                _fir8(taps, x, i, out, u * LANES, LANES)
            else:
                r = 0
                while r + 2 <= n:
                    _fir2(taps, x, i + r * LANES, out, (u + r) * LANES, LANES)
                    r += 2
                if r < n:
                    _fir1(taps, x, i + r * LANES, out, (u + r) * LANES, LANES)

        return common

    nothing = getattr(np, str(taps.dtype))(0)

    def each(taps: Any, group: Any, x: Any, i: Any, out: Any, u: Any, n: Any) -> None:
        count = taps.shape[1]
        base = group * count * LANES
        zero = spread(nothing)
        r = 0
        while r + 4 <= n:
            a = b = c = d = zero
            j = i + r * LANES
            for k in range(count):
                tap = load(taps, base + k * LANES)
                a = a + tap * load(x, j)
                b = b + tap * load(x, j + LANES)
                c = c + tap * load(x, j + 2 * LANES)
                d = d + tap * load(x, j + 3 * LANES)
                j += LANES
            store(out, (u + r) * LANES, a)
            store(out, (u + r + 1) * LANES, b)
            store(out, (u + r + 2) * LANES, c)
            store(out, (u + r + 3) * LANES, d)
            r += 4
        while r < n:
            a = zero
            j = i + r * LANES
            for k in range(count):
                a = a + load(taps, base + k * LANES) * load(x, j)
                j += LANES
            store(out, (u + r) * LANES, a)
            r += 1

    return each


def _shape(table: Any, t: Any, group: Any) -> Any:
    """Return a gesture's shape at a step, for eight cells."""
    raise NotImplementedError


@overload(_shape, strict=False, jit_options={"_nrt": False, "forceinline": True})
def _shape_overload(table: Any, t: Any, group: Any) -> Any:
    if table.ndim == 1:
        return lambda table, t, group: spread(table[t])
    return lambda table, t, group: load(table, (group * table.shape[1] + t) * LANES)


@njit(nogil=True, _nrt=False, forceinline=True)
def _row(position: Any, length: Any) -> Any:
    return position + length if position < 0 else position


def _add_tail(
    tail: Any, group: Any, ring: Any, start: Any, length: Any, position: Any, out: Any, u: Any, n: Any
) -> None:
    """Add the exponential tail to rows u ... u + n - 1 of ``out``, if there is one."""
    raise NotImplementedError


@overload(_add_tail, strict=False, jit_options={"_nrt": False, "forceinline": True})
def _overload_add_tail(
    tail: Any, group: Any, ring: Any, start: Any, length: Any, position: Any, out: Any, u: Any, n: Any
) -> Any:
    if isinstance(tail, types.NoneType):
        return lambda tail, group, ring, start, length, position, out, u, n: None

    def add(
        tail: Any, group: Any, ring: Any, start: Any, length: Any, position: Any, out: Any, u: Any, n: Any
    ) -> None:
        z = load(tail.state, group * LANES)
        pole, gain = load(tail.pole, group * LANES), load(tail.gain, group * LANES)
        for r in range(n):
            x = load(ring, (start + _row(position + r - tail.first, length)) * LANES)
            z = pole * z + gain * x
            store(out, (u + r) * LANES, load(out, (u + r) * LANES) + z)
        store(tail.state, group * LANES, z)

    return add


@njit(nogil=True, _nrt=False, forceinline=True)
def _fill(side: Any, group: Any, u: Any, steps: Any, position: Any) -> Any:
    """Compute what arrives in steps u ... and return the first step that has to wait."""
    n = min(side.ahead[group], steps - u)
    ring, length = side.ring, side.length
    start = group * (length + side.guard)
    oldest = _row(position - side.last[group], length)
    _convolve(side.taps, group, ring, (start + oldest) * LANES, side.arrived, u, n)
    _add_tail(side.tail, group, ring, start, length, position, side.arrived, u, n)
    return u + n


@njit(nogil=True, _nrt=False, forceinline=True)
def _send(side: Any, group: Any, position: Any, wave: Any) -> Any:
    """Put a step of an outgoing wave into its ring and return the next row."""
    row = group * (side.length + side.guard) + position
    store(side.ring, row * LANES, wave)
    if position < side.guard:
        store(side.ring, (row + side.length) * LANES, wave)
    position += 1
    return 0 if position == side.length else position


def build(version: int) -> Any:
    """Make the kernel; ``version`` is the hash of its sources, so that a cached one is never stale.

    (Numba's cache looks at the date of one file only, and this kernel is made of several; but what a closure
    holds is part of the cache's key.)
    """

    @njit(nogil=True, cache=True, error_model="numpy", _nrt=False)
    def advance(
        start: Any, samples: Any, bridge: Any, nut: Any, torsion_bridge: Any, torsion_nut: Any, law: Any,
        gesture: Any, share_t: Any, share_r: Any, slipping: Any, totals: Any, out: Any, intervals: Any, traces: Any,
    ) -> Any:
        if version == 0:
            return 0
        count, onset, duration, slip = intervals
        for group in range(slipping.shape[0]):
            base = group * LANES
            c_t, c_r = load(share_t, base), load(share_r, base)
            f_end, f_step = load(gesture.f_end, base), load(gesture.f_step, base)
            v_0, v_1 = load(gesture.v_0, base), load(gesture.v_1, base)
            slips = mask_of(slipping[group])
            before = np.uint64(0)  # a slip that goes on begins again at the border
            total = c_t * 0.0
            count[base : base + LANES] = 0
            at_b, at_n = start % bridge.length, start % nut.length
            at_rb, at_rn = start % torsion_bridge.length, start % torsion_nut.length
            for t0 in range(0, samples, STRIDE):
                steps = min(STRIDE, samples - t0)
                due_b = due_n = due_rb = due_rn = 0
                word = np.uint64(0)
                first = at_b
                store(totals, 0, total)
                for u in range(steps):
                    if u == due_b:
                        due_b = _fill(bridge, group, u, steps, at_b)
                    if u == due_n:
                        due_n = _fill(nut, group, u, steps, at_n)
                    if u == due_rb:
                        due_rb = _fill(torsion_bridge, group, u, steps, at_rb)
                    if u == due_rn:
                        due_rn = _fill(torsion_nut, group, u, steps, at_rn)
                    in_b, in_n = load(bridge.arrived, u * LANES), load(nut.arrived, u * LANES)
                    in_rb, in_rn = load(torsion_bridge.arrived, u * LANES), load(torsion_nut.arrived, u * LANES)
                    f_b = f_end + f_step * _shape(gesture.force, t0 + u, group)
                    v_b = v_0 + v_1 * _shape(gesture.speed, t0 + u, group)
                    v_h = in_b + in_n + in_rn + in_rb
                    d = v_b - v_h
                    s, slips = solve(law, base, d, f_b, slips)
                    push = d - s  # Y f
                    push_t, push_r = c_t * push, c_r * push
                    at_b = _send(bridge, group, at_b, in_n + push_t)
                    at_n = _send(nut, group, at_n, in_b + push_t)
                    at_rb = _send(torsion_bridge, group, at_rb, in_rn + push_r)
                    at_rn = _send(torsion_nut, group, at_rn, in_rb + push_r)
                    total = choose(slips, total + s, 0.0)
                    store(totals, (u + 1) * LANES, total)
                    word |= np.uint64(bits_of(slips)) << np.uint64(LANES * u)
                    if traces is not None:
                        n = traces.shape[2] * traces.shape[1]
                        i = (t0 + u) * traces.shape[2] + base
                        store(traces, i, in_n + push_t)
                        store(traces, i + n, v_b - s)
                        store(traces, i + 2 * n, v_h)
                        store(traces, i + 3 * n, in_b + in_n + push_t)
                        store(traces, i + 4 * n, push)
                        store(traces, i + 5 * n, choose(slips, c_t * 0.0 + 1.0, 0.0))
                i = (group * (bridge.length + bridge.guard) + first) * LANES
                if steps == STRIDE:
                    transpose(bridge.ring, i, LANES, out, base * samples + t0, samples)
                else:
                    ring = bridge.ring.reshape(-1)
                    for u in range(steps):
                        for lane in range(LANES):
                            out[base + lane, t0 + u] = ring[i + u * LANES + lane]
                edges = word ^ ((word << np.uint64(LANES)) | before)
                if steps < STRIDE:
                    edges &= (np.uint64(1) << np.uint64(LANES * steps)) - np.uint64(1)
                before = word >> np.uint64(LANES * (steps - 1))
                while edges != np.uint64(0):
                    place = lowest_bit(edges)
                    edges &= edges - np.uint64(1)
                    u, lane = place // LANES, place % LANES
                    cell = base + lane
                    k = count[cell]
                    if (word >> np.uint64(place)) & np.uint64(1):
                        onset[cell, k] = t0 + u
                    else:
                        duration[cell, k] = t0 + u - onset[cell, k]
                        slip[cell, k] = totals[u, lane]
                        count[cell] = k + 1
            slipping[group] = bits_of(slips)
            store(totals, 0, total)
            for lane in range(LANES):
                if (slipping[group] >> lane) & 1:
                    cell = base + lane
                    k = count[cell]
                    duration[cell, k] = samples - onset[cell, k]
                    slip[cell, k] = totals[0, lane]
                    count[cell] = k + 1
        return 0

    return advance


@njit(nogil=True, cache=True, _nrt=False)
def collect(
    intervals: Any, offsets: Any, onset: Any, duration: Any, slip: Any
) -> None:
    """Put the intervals of all cells one after another."""
    _, onsets, durations, slips = intervals
    for cell in range(offsets.shape[0] - 1):
        start = offsets[cell]
        for k in range(offsets[cell + 1] - start):
            onset[start + k] = onsets[cell, k]
            duration[start + k] = durations[cell, k]
            slip[start + k] = slips[cell, k]
