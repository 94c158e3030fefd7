"""The time loop: eight cells at a time, each computed exactly as if it were alone.

This module holds compiled code only; :mod:`bow_sim.kernel.block` calls it. :func:`build` has the mathematics. One
source serves every model: Numba compiles it for the types that it is given, and where the taps are a tuple, their
number is part of the type.

A reflection function whose least lag is m can be applied to m future steps at once, since what arrives then has already
left the bow. So arrivals are computed ahead, up to eight steps, and each sample is read once; at each step only
friction and four sums remain. The outgoing waves are kept in short ring buffers, so that the state of eight cells stays
in the first-level cache.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numba import types

from bow_sim.kernel.arguments import Gesture, Output, State, String
from bow_sim.kernel.arriving import fill, fill_near, latest_before, with_latest
from bow_sim.kernel.body import of_body
from bow_sim.kernel.eight_steps import are_possible, eight_steps, sums_before
from bow_sim.kernel.hair import pull_hair, with_hair
from bow_sim.kernel.rings import STRIDE, TOTALS, row_of, shape_at
from bow_sim.physics.friction import solve, state_of
from bow_sim.simd.jit import INLINE, OVERLOAD, align_stack, njit, overload, part
from bow_sim.simd.lanes import (
    LANES,
    bits_of,
    choose,
    load,
    lowest_bit,
    mask_of,
    read,
    signs_of,
    store,
    write,
)
from bow_sim.simd.rows import transpose, transpose_to
from bow_sim.simd.signs import followed


@part(**INLINE)
def _sent(side: Any, group: Any, block: Any) -> Any:
    """Repeat eight steps of an outgoing wave before the ring, if they are at its end, and return the next position."""
    if block >= side.length - side.lead:
        row = (group * side.ring.shape[1] + side.lead + block) * LANES
        for i in range(row, row + STRIDE * LANES, LANES):
            store(side.ring, i - side.length * LANES, load(side.ring, i))
    block += STRIDE
    return 0 if block == side.length else block


def _keep(traces: Any, i: Any, waves: Any) -> None:
    """Write the waveforms of a step, if traces are asked for: lanes i ... i + 7 of each trace."""
    raise NotImplementedError


@overload(_keep, strict=False, jit_options=OVERLOAD)
def _overload_keep(traces: Any, i: Any, waves: Any) -> Any:
    if isinstance(traces, types.NoneType):
        return lambda traces, i, waves: None

    def keep(traces: Any, i: Any, waves: Any) -> None:
        size = traces.shape[1] * traces.shape[2]
        for k in range(len(waves)):
            store(traces, i + k * size, waves[k])

    return keep


@part(**INLINE)
def _note(early: Any, samples: Any, base: Any, state: Any, intervals: Any) -> None:
    """Note the slip intervals of a group in a chunk; a slip that continues beyond it is ended at its border.

    In the time loop this would cost more: whether a slip begins or ends in a step is known when its root is, and after
    a branch that was predicted wrongly the steps that follow would begin only then.
    """
    bits, edges, work = state.bits, state.edges, state.work
    offsets, onset, duration, slip = intervals
    width = bits.itemsize * 8
    unused = np.uint64(64 - width)
    steps = early + samples
    last = steps // width
    number = np.int64(offsets[base])
    for lane in range(LANES):
        count = 0
        before = np.uint64(0)  # as if sticking: a slip that continues is a new interval in this chunk
        for i in range(last + 1):
            after = np.uint64(bits[i, lane])
            if i == last:  # the latest step is the highest bit
                after = (after >> np.uint64(1)) >> np.uint64(width - 1 - steps % width)
            after = after << unused
            changed = after ^ ((after << np.uint64(1)) | (before << unused))
            before = after >> np.uint64(63)
            first = i * width - early - (64 - width)
            while changed != np.uint64(0):
                write(edges, count, np.uint32(first + lowest_bit(changed)))
                changed &= changed - np.uint64(1)
                count += 1
        for k in range(0, count, 2):
            begin, end = read(edges, k, np.uint32(0)), read(edges, k + 1, np.uint32(0))
            write(onset, number, begin)
            write(duration, number, np.uint32(end - begin))
            write(slip, number, np.float64(work[TOTALS + np.int64(end), lane]))
            number += 1
        offsets[base + lane + 1] = number


def _put_in_order(places: Any, intervals: Any) -> None:
    """Copy the slip intervals of all lanes to their places."""
    raise NotImplementedError


@overload(_put_in_order, strict=False, jit_options=OVERLOAD)
def _overload_put_in_order(places: Any, intervals: Any) -> Any:
    if isinstance(places, types.NoneType):
        return lambda places, intervals: None

    def put(places: Any, intervals: Any) -> None:
        rows, (to, onset, duration, slip) = places
        for lane in range(rows.size):
            to[rows[lane] + 1] = intervals.offsets[lane + 1] - intervals.offsets[lane]
        for row in range(rows.size):
            to[row + 1] += to[row]
        for lane in range(rows.size):
            first, number = np.int64(intervals.offsets[lane]), np.int64(to[rows[lane]])
            for k in range(np.int64(intervals.offsets[lane + 1]) - first):
                onset[number + k] = intervals.onset[first + k]
                duration[number + k] = intervals.duration[first + k]
                slip[number + k] = intervals.slip[first + k]

    return put


def _row(places: Any, lane: Any) -> Any:
    """Return the row in which a lane's bridge force is written."""
    raise NotImplementedError


@overload(_row, strict=False, jit_options=OVERLOAD)
def _overload_row(places: Any, lane: Any) -> Any:
    if isinstance(places, types.NoneType):
        return lambda places, lane: lane
    return lambda places, lane: places.rows[lane]


def _write_eight(ring: Any, i: Any, out: Any, places: Any, base: Any, t0: Any) -> None:
    """Write eight rows from flat index i of a ring into ``out`` (cells, samples) as float32."""
    raise NotImplementedError


@overload(_write_eight, strict=False, jit_options=OVERLOAD)
def _overload_write_eight(ring: Any, i: Any, out: Any, places: Any, base: Any, t0: Any) -> Any:
    if isinstance(places, types.NoneType):
        return lambda ring, i, out, places, base, t0: transpose(
            ring, i, LANES, out, base * out.shape[1] + t0, out.shape[1]
        )
    return lambda ring, i, out, places, base, t0: transpose_to(ring, i, LANES, out, t0, out.shape[1], places.rows, base)


@part(**INLINE)
def _write(ring: Any, i: Any, begin: Any, end: Any, out: Any, places: Any, base: Any, t0: Any) -> None:
    """Write rows begin ... end - 1 of these eight."""
    if end - begin == STRIDE:
        _write_eight(ring, i, out, places, base, t0)
    else:
        nothing = ring[0, 0, 0]
        for u in range(begin, end):
            for lane in range(LANES):
                place = _row(places, base + lane) * out.shape[1] + t0 + u
                write(out, place, np.float32(read(ring, i + u * LANES + lane, nothing)))


def build(version: int) -> Any:
    """Make the kernel: the compiled function ``advance(start, samples, string, gesture, state, output)``.

    It computes one sample of each cell after another, as section II of the paper says; PHYSICS.md section 2 has the
    order. With Y_T and Y_R the transverse and torsional admittances and Y = (Y_T + Y_R)/2, a step is::

        in_b = h_b * out_b,  in_n = h_n * out_n,  in_rb = h_rb * out_rb,  in_rn = h_rn * out_rn
        v_h = in_b + in_n + in_rn + in_rb                                       equations (4), (5) and (7)
        v = v_h + Y f  and the friction curve  f(v_b - v, f_b)  meet in  v, f   equation (3), Fig 1
        out_b  = in_n  + Y_T/2 f,    out_n  = in_b  + Y_T/2 f
        out_rb = in_rn + Y_R/2 f,    out_rn = in_rb + Y_R/2 f

    where ``h * out`` is the convolution of an outgoing wave with a reflection function, f_b and v_b are the gesture's
    force and speed, and :func:`bow_sim.physics.friction.solve` finds the slip speed ``s = v_b - v`` and whether the
    string slips. ``out_b`` is the bridge force. In the code, ``push = Y f = v_b - v_h - s``, of which the share
    Y_T/2Y goes into each transverse wave and Y_R/2Y into each torsional one. With elastic hair, the velocity of its
    spring is added to v_b, and Y' stands for Y (PHYSICS.md section 12).

    Parameters
    ----------
    version : int
        Hash of its sources. Numba's cache watches only the file that defines a function, and this one contains
        functions of several files; but the values of a closure are part of the cache's key, so a cached kernel is
        never older than its sources. 0 for a kernel that is not cached, with a friction law that other processes may
        not know.

    Returns
    -------
    function
        ``advance(start, samples, string, gesture, state, output)``: first sample, number of samples, `String`,
        `Gesture`, `State` and `Output`; the last two, rings and tails are changed in place.
    """

    @njit(nogil=True, cache=version != 0, error_model="numpy", _nrt=False)
    def advance(start: int, samples: int, string: String, gesture: Gesture, state: State, output: Output) -> int:
        align_stack()
        bridge, nut, torsion_bridge, torsion_nut, law, share_t, share_r, hair = string
        slipping, work, states = state.slipping, state.work, state.states
        bridge_force, intervals, places, traces = output
        for group in range(slipping.shape[0]):
            base = group * LANES
            c_t, c_r = load(share_t, base), load(share_r, base)
            f_end, f_step = load(gesture.f_end, base), load(gesture.f_step, base)
            v_0, v_1 = load(gesture.v_0, base), load(gesture.v_1, base)
            slips = signs_of(mask_of(slipping[group]), c_t)
            zero = c_t * 0.0
            total = past = zero
            early = start % STRIDE  # eight steps begin where the number of samples is a multiple of eight
            at_b, at_n = (start - early) % bridge.length, (start - early) % nut.length
            at_rb, at_rn = (start - early) % torsion_bridge.length, (start - early) % torsion_nut.length
            latest = latest_before(torsion_bridge, group, start % torsion_bridge.length)
            constants = (c_t, c_r), (f_end, f_step, v_0, v_1)
            whole = are_possible(string, traces, group)
            for t0 in range(-early, samples, STRIDE):
                begin, end = max(0, -t0), min(STRIDE, samples - t0)
                row_b, row_n = row_of(bridge, group, at_b) * LANES, row_of(nut, group, at_n) * LANES
                row_rb = row_of(torsion_bridge, group, at_rb) * LANES
                row_rn = row_of(torsion_nut, group, at_rn) * LANES
                totals = (TOTALS + 1 + t0) * LANES
                if whole and end - begin == STRIDE:
                    if t0 < STRIDE:  # the first whole eight
                        sums = sums_before(string, traces, group, at_rb, zero)
                    rows, at = (row_b, row_n, row_rb, row_rn), (at_b, at_n, at_rb, at_rn)
                    carried = slips, total, sums, past
                    carried = eight_steps(string, gesture, work, group, constants, rows, at, t0, carried)
                    slips, total, sums, past = carried
                else:
                    due = due_b = due_n = due_rb = due_rn = begin
                    for u in range(begin, end):
                        if u == due:
                            if u == due_b:
                                due_b = fill(bridge, group, u, end, at_b)
                            if u == due_n:
                                due_n = fill(nut, group, u, end, at_n)
                            if u == due_rb:
                                due_rb = fill_near(torsion_bridge, torsion_bridge.taps, group, u, end, at_rb)
                            if u == due_rn:
                                due_rn = fill(torsion_nut, group, u, end, at_rn)
                            due = min(due_b, due_n, due_rb, due_rn)
                        i = u * LANES
                        in_b, in_n = load(work, i), load(work, STRIDE * LANES + i)
                        in_rn, in_rb = load(work, 2 * STRIDE * LANES + i), load(work, 3 * STRIDE * LANES + i)
                        in_rb = with_latest(torsion_bridge, torsion_bridge.taps, group, in_rb, latest)
                        f_b = f_end + f_step * shape_at(gesture.force, group, t0 + u)
                        v_b = v_0 + v_1 * shape_at(gesture.speed, group, t0 + u)
                        v_h = in_b + in_n + in_rn + in_rb  # the one that is computed last is added last
                        v_b = with_hair(hair, base, v_b)
                        d = v_b - v_h
                        s, state_now = solve(law, base, d, f_b, slips)
                        slips = signs_of(state_now, s)
                        push = d - s  # Y f
                        push_t, push_r = c_t * push, c_r * push
                        out_b = in_n + push_t
                        store(bridge.ring, row_b + i, out_b)
                        store(nut.ring, row_n + i, in_b + push_t)
                        latest = latest[1], latest[2], in_rn + push_r
                        store(torsion_bridge.ring, row_rb + i, latest[2])
                        store(torsion_nut.ring, row_rn + i, in_rb + push_r)
                        total = choose(slips, total + s, 0.0)
                        store(work, totals + i, total)
                        past = followed(past, slips)
                        v = pull_hair(hair, base, push, v_h, v_b - s)
                        waves = (out_b, v, v_h, in_b + in_n + push_t, push, choose(slips, zero + 1.0, 0.0))
                        waves = waves + of_body(bridge.body, i, push) + state_of(law, base, push)
                        _keep(traces, (t0 + u) * slipping.shape[0] * LANES + base, waves)
                _write(bridge.ring, row_b, begin, end, bridge_force, places, base, t0)
                store(states, (t0 + early) // (states.itemsize * 8) * LANES, past)
                at_b, at_n = _sent(bridge, group, at_b), _sent(nut, group, at_n)
                at_rb, at_rn = _sent(torsion_bridge, group, at_rb), _sent(torsion_nut, group, at_rn)
            slipping[group] = bits_of(slips)
            _note(early, samples, base, state, intervals)
        _put_in_order(places, intervals)
        return version

    return advance
