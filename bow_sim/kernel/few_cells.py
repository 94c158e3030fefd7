"""The time loop for a few cells: one after the other, one number at a time, some of the work for eight steps at once.

Eight lanes of which one is needed cost as much as eight. Here the lanes are *steps*. From a side whose least lag is
large enough, what arrives is computed for eight steps at once, some steps before the first of them. From any other
side, what has left the bow before eight steps is summed for all of them, and what leaves it in a step is then added to
all the sums that it reaches. So each sum goes from the greatest lag to the least, as everywhere. The sums of one side,
where torsional waves come back from the bridge, stay in registers; mostly it is the only one of this kind. The rest of
a step is computed as in :mod:`bow_sim.kernel.time_loop`, by the same functions, and the results are the same to the
last bit.

Steps take as long as one waits for another. So what a step needs is known some steps before, except for what left the
bow in the steps just before; and that is added last.

This module holds compiled code only.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from bow_sim.kernel.arguments import SIDES, Gesture
from bow_sim.kernel.body import of_body, reflect_one
from bow_sim.kernel.hair import pull_hair, with_hair
from bow_sim.physics.friction import solve, state_of
from bow_sim.simd.jit import INLINE, njit, part
from bow_sim.simd.lanes import LANES, choose, load, read, spread, store, write
from bow_sim.simd.steps import highest, lowest, recursion, rotated

FEW = 4
"""So many cells, and fewer, take less time here than as lanes."""

LEAD = 3
"""Eight steps are computed at once so many steps before the first of them, so that none has to wait."""

LEAST_LAG = LANES + LEAD
"""The least lag of a side from which eight steps can be computed at once, samples."""

ROWS = len(SIDES)
"""So many rows has each cell in `Sides`: one for each side of the bow."""

NEAR = SIDES.index("torsion_bridge")
"""The number of the side whose sums stay in registers: waves come back from it first, in most cases."""

SLOTS = 2 * LANES
"""What arrives in a step is kept at the step's number modulo this."""


class Sides(NamedTuple):
    """The four sides of the bow: four rows for each cell.

    Parameters
    ----------
    first, last : ndarray, shape (rows,)
        The least and the greatest lag of the taps; first > last where all taps are 0.
    depth : ndarray, shape (rows,)
        0 for a side that is ready: eight steps can be computed at once. For any other, the lag up to which waves are
        added to sums one by one: the least lag, of side `NEAR` at most 2.
    taps : ndarray, shape (rows, lags + 8)
        Coefficient of each lag from 0 on; 0 where nothing arrives.
    gain, pole, state : ndarray, shape (rows,)
        The exponential tail; gain 0 for none.
    tail_taps : ndarray, shape (rows, taps)
        What the tail is made of, the greatest lag first.
    tail_count, tail_last : ndarray, shape (rows,)
        How many these are, and the lag of the first.
    late_count : ndarray, shape (cells,)
        How many sides are not ready; side `NEAR` counts if it has a tail.
    late : ndarray, shape (cells, 4)
        The numbers of these sides.
    following : ndarray, shape (cells,)
        If side `NEAR` is not ready: what arrives from it in the next step, without its tail.
    wave : ndarray, shape (rows, past + samples)
        Outgoing wave: the last samples before a chunk, then those of the chunk.
    past : int
    sums : ndarray, shape (rows, 8)
        From a side that is not ready: what arrives in a step and in the next seven, without the latest `depth` waves.
        Between chunks, of side `NEAR` one step later and with all waves.
    arrived : ndarray, shape (rows, 16)
        What arrives in the latest steps, and from a side that is ready in the next.
    """

    first: Any
    last: Any
    depth: Any
    taps: Any
    gain: Any
    pole: Any
    state: Any
    tail_taps: Any
    tail_count: Any
    tail_last: Any
    late_count: Any
    late: Any
    following: Any
    wave: Any
    past: Any
    sums: Any
    arrived: Any


class String(NamedTuple):
    """The string at the bow, as :class:`bow_sim.kernel.arguments.String`, for cells one by one."""

    sides: Any
    body: Any
    law: Any
    share_t: Any
    share_r: Any
    hair: Any


class Output(NamedTuple):
    """Where some chunks are written.

    Parameters
    ----------
    bridge_force : ndarray of float32, shape (chunks, cells, samples)
    slipping : ndarray of uint8, shape (chunks + 1, cells)
        After the last step before each chunk, and after all.
    offsets : ndarray of uint32, shape (chunks, cells + 1)
        Where each cell's slip intervals begin among those of its chunk.
    onset, duration, slip : ndarray, shape (chunks, most)
        As in :class:`bow_sim.kernel.arguments.Intervals`, those of all cells of a chunk one after the other.
    traces : ndarray, shape (chunks, waveforms, samples, cells), or (0, waveforms, samples, cells) for none
    """

    bridge_force: Any
    slipping: Any
    offsets: Any
    onset: Any
    duration: Any
    slip: Any
    traces: Any


@part(**INLINE)
def _place(sides: Any, row: Any, t: Any) -> Any:
    """Return the flat index of a step in the outgoing waves."""
    return row * sides.wave.shape[1] + sides.past + t


@part(**INLINE)
def _to_tail(sides: Any, row: Any, t: Any, zero: Any) -> Any:
    """Return what is added to a tail in step t, or in eight from t on if `zero` is lanes."""
    x = zero
    at = _place(sides, row, t - read(sides.tail_last, row, row))
    for k in range(read(sides.tail_count, row, row)):
        x = x + read(sides.tail_taps, row * sides.tail_taps.shape[1] + k, 0.0) * read(sides.wave, at + k, zero)
    return read(sides.gain, row, 0.0) * x


@part(**INLINE)
def _look_ahead(sides: Any, body: Any, cell: Any, t: Any, lead: Any, slot: Any) -> None:
    """Compute what arrives in the eight steps that begin `lead` steps after t; or the sums for those that begin at t.

    Parameters
    ----------
    slot : int
        Where the first of the eight steps is kept.
    """
    bridge = ROWS * cell
    for row in range(bridge, bridge + ROWS):
        taps = row * sides.taps.shape[1]
        last, depth = read(sides.last, row, row), read(sides.depth, row, row)
        total = spread(0.0)
        if depth == 0:
            at = _place(sides, row, t + lead)
            for k in range(last + 1 - read(sides.first, row, row)):
                total = total + read(sides.taps, taps + last - k, 0.0) * load(sides.wave, at - last + k)
            if read(sides.gain, row, 0.0) != 0.0:
                x = _to_tail(sides, row, t + lead, spread(0.0))
                z = recursion(read(sides.pole, row, 0.0), read(sides.state, row, 0.0), x)
                write(sides.state, row, highest(z))
                total = total + z
            store(sides.arrived, row * SLOTS + slot, total)
            if row == bridge and body is not None:
                for i in range(slot, slot + LANES):
                    x = reflect_one(body, read(sides.arrived, row * SLOTS + i, 0.0), cell, i)
                    write(sides.arrived, row * SLOTS + i, x)
        else:
            at = _place(sides, row, t)
            if row == bridge + NEAR:
                depth = 0  # what left the bow before t is known, and added here
            for k in range(last - depth):
                total = total + load(sides.taps, taps + last - k) * read(sides.wave, at - last + k, 0.0)
            store(sides.sums, row * LANES, total)


@part(**INLINE)
def _arriving(sides: Any, first: Any, late: Any, t: Any, place: Any, in_rb: Any) -> Any:
    """Return what arrives from the four sides in a step, if some are not ready; in_rb: from `NEAR`, without its tail.

    Parameters
    ----------
    first, late : int
        The row of the cell's first side, and how many are not ready.
    place : int
        The flat index of what arrives from the first side in this step.
    """
    write(sides.arrived, place + NEAR * SLOTS, in_rb)
    for i in range(late):
        side = read(sides.late, first + i, first)
        row = first + side
        x = in_rb
        if side != NEAR:
            depth = read(sides.depth, row, row)
            wave = read(sides.wave, _place(sides, row, t - depth), 0.0)
            sums = load(sides.sums, row * LANES) + load(sides.taps, row * sides.taps.shape[1] + depth) * wave
            store(sides.sums, row * LANES, rotated(sums))
            x = lowest(sums)
        if read(sides.gain, row, 0.0) != 0.0:
            z = read(sides.pole, row, 0.0) * read(sides.state, row, 0.0) + _to_tail(sides, row, t, 0.0)
            write(sides.state, row, z)
            x = x + z
        write(sides.arrived, place + side * SLOTS, x)
    return _arrived(sides, place)


@part(**INLINE)
def _arrived(sides: Any, place: Any) -> Any:
    """Return what is kept of what arrives from the four sides in a step; `place` as in :func:`_arriving`."""
    return (
        read(sides.arrived, place, 0.0),
        read(sides.arrived, place + SLOTS, 0.0),
        read(sides.arrived, place + 2 * SLOTS, 0.0),
        read(sides.arrived, place + 3 * SLOTS, 0.0),
    )


@part(**INLINE)
def _keep(sides: Any, row: Any, samples: Any) -> None:
    """Move the end of an outgoing wave, after so many samples, to the beginning."""
    for t in range(-sides.past, 0):
        write(sides.wave, _place(sides, row, t), read(sides.wave, _place(sides, row, t + samples), 0.0))


def build(version: int) -> Any:
    """Make the loop: the compiled function ``advance(first, samples, string, gesture, output)``.

    It computes some chunks of all cells, each of `samples` samples; `first` is the number of the first sample. The
    shapes of the gesture have the shape (1, chunks x samples), or (cells, chunks x samples) where each cell has its
    own. :func:`bow_sim.kernel.time_loop.build` has the mathematics and `version`.
    """

    @njit(nogil=True, cache=version != 0, error_model="numpy", _nrt=False)
    def advance(first: int, samples: int, string: String, gesture: Gesture, output: Output) -> int:
        sides, body, law, share_t, share_r, hair = string
        bridge_force, slipping, offsets, onset, duration, slip, traces = output
        cells = slipping.shape[1]
        offsets[:, 0] = 0
        for cell in range(cells):
            b = ROWS * cell
            n, rb, rn = b + 1, b + NEAR, b + 3
            depth = sides.depth[rb]
            near = load(sides.taps, rb * sides.taps.shape[1] + depth)
            sums = load(sides.sums, rb * LANES)
            following = sides.following[cell]
            late = sides.late_count[cell]
            c_t, c_r = share_t[cell], share_r[cell]
            f_end, f_step, v_0, v_1 = gesture.f_end[cell], gesture.f_step[cell], gesture.v_0[cell], gesture.v_1[cell]
            shapes = gesture.force.shape[1] * min(cell, gesture.force.shape[0] - 1)
            slips = slipping[0, cell] != 0
            for chunk in range(slipping.shape[0] - 1):
                start = first + chunk * samples
                out, shape = (chunk * cells + cell) * samples, shapes + chunk * samples
                number = np.int64(offsets[chunk, cell])
                noted = False  # as if sticking: a slip that continues is a new interval in this chunk
                total = 0.0
                begin = 0
                while begin < samples:
                    now = start + begin
                    if (now + LEAD) & (LANES - 1) == 0 or now == 0:
                        lead = LEAD if now > 0 else 0
                        _look_ahead(sides, body, cell, begin, lead, (now + lead) & (SLOTS - 1))
                        sums = load(sides.sums, rb * LANES)
                        following, sums = lowest(sums), rotated(sums)
                    end = min(begin + LANES - ((now + LEAD) & (LANES - 1)), samples)
                    for t in range(begin, end):
                        slot = (start + t) & (SLOTS - 1)
                        place = ROWS * SLOTS * cell + slot
                        in_b, in_n, in_rb, in_rn = _arrived(sides, place)
                        if depth != 0:
                            in_rb = following
                        if late > 0:
                            in_b, in_n, in_rb, in_rn = _arriving(sides, b, late, t, place, in_rb)
                            if sides.depth[b] != 0:
                                in_b = reflect_one(body, in_b, cell, slot)
                        f_b = f_end + f_step * read(gesture.force, shape + t, 0.0)
                        v_b = v_0 + v_1 * read(gesture.speed, shape + t, 0.0)
                        v_h = in_b + in_n + in_rn + in_rb
                        v_b = with_hair(hair, cell, v_b)
                        d = v_b - v_h
                        s, slips = solve(law, cell, d, f_b, slips)
                        push = d - s  # Y f
                        push_t, push_r = c_t * push, c_r * push
                        out_b = in_n + push_t
                        out_rb = in_rn + push_r
                        if depth == 2:  # the next step does not wait for this one
                            following, sums = lowest(sums), rotated(sums) + near * out_rb
                        if depth == 1:
                            sums = sums + near * out_rb
                            following, sums = lowest(sums), rotated(sums)
                        write(sides.wave, _place(sides, b, t), out_b)
                        write(sides.wave, _place(sides, n, t), in_b + push_t)
                        write(sides.wave, _place(sides, rb, t), out_rb)
                        write(sides.wave, _place(sides, rn, t), in_rb + push_r)
                        write(bridge_force, out + t, np.float32(out_b))
                        if slips != noted:
                            noted = slips
                            if slips:
                                onset[chunk, number] = t
                            else:
                                duration[chunk, number] = t - onset[chunk, number]
                                slip[chunk, number] = total
                                number += 1
                        total = choose(slips, total + s, 0.0)
                        v = pull_hair(hair, cell, push, v_h, v_b - s)
                        if traces.shape[0] > 0:
                            waves = (out_b, v, v_h, in_b + in_n + push_t, push, choose(slips, 1.0, 0.0))
                            waves = waves + of_body(body, slot, push) + state_of(law, cell, push)
                            for k in range(len(waves)):
                                traces[chunk, k, t, cell] = waves[k]
                    begin = end
                if noted:
                    duration[chunk, number] = samples - onset[chunk, number]
                    slip[chunk, number] = total
                    number += 1
                offsets[chunk, cell + 1] = number
                slipping[chunk + 1, cell] = slips
                store(sides.sums, rb * LANES, sums)
                sides.following[cell] = following
                for row in range(b, b + ROWS):
                    _keep(sides, row, samples)
        return version

    return advance
