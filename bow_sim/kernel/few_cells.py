"""The time loop for a few cells: one after the other, one number at a time, some of the work for eight steps at once.

Eight lanes of which one is needed cost as much as eight. Here the lanes are *steps*. From a side whose least lag is
large enough, what arrives is computed for eight steps at once, some steps before the first of them. From any other
side, what has left the bow before eight steps is summed for all of them, and what leaves it in a step is then added to
all the sums that it reaches. So each sum goes from the greatest lag to the least, as everywhere. The rest of a step is
computed as in :mod:`bow_sim.kernel.time_loop`, by the same functions, and the results are the same to the last bit.

Steps take as long as one waits for another. So what a step needs is known some steps before, except for what left the
bow in the steps just before; and that is added last.

This module holds compiled code only.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from bow_sim.kernel.arguments import Gesture
from bow_sim.kernel.body import of_body, reflect_one
from bow_sim.kernel.hair import pull_hair, with_hair
from bow_sim.physics.friction import solve, state_of
from bow_sim.simd.jit import INLINE, njit, part
from bow_sim.simd.lanes import LANES, choose, load, read, spread, store, write
from bow_sim.simd.steps import highest, lowest, recursion, rotated

FEW = 4
"""So many cells, and fewer, take less time here than as lanes."""

LEAD = 4
"""Eight steps are computed at once so many steps before the first of them, so that none has to wait."""

LEAST_LAG = LANES + LEAD
"""The least lag of a side from which eight steps can be computed at once, samples."""

SLOTS = 2 * LANES
"""What arrives in a step is kept at the step's number modulo this."""


class Sides(NamedTuple):
    """The four sides of the bow: a row for each cell of the first side, then for each cell of the next.

    Parameters
    ----------
    ready : ndarray of bool, shape (rows,)
        Whether eight steps can be computed at once.
    first, last : ndarray, shape (rows,)
        The least and the greatest lag of the taps; first > last where all taps are 0.
    depth : ndarray, shape (rows,)
        The lag up to which waves are added to sums one by one: that of `first`, at most 2.
    taps : ndarray, shape (rows, lags + 8)
        Coefficient of each lag from 0 on; 0 where nothing arrives.
    gain, pole, state : ndarray, shape (rows,)
        The exponential tail; gain 0 for none.
    tail_taps : ndarray, shape (rows, taps)
        What the tail is made of, the greatest lag first.
    tail_count, tail_last : ndarray, shape (rows,)
        How many these are, and the lag of the first.
    late_tail : ndarray of bool, shape (cells,)
        Whether a side that is not ready has a tail.
    wave : ndarray, shape (rows, past + samples)
        Outgoing wave: the last samples before a chunk, at least two, then those of the chunk.
    past : int
    sums : ndarray, shape (rows, 8)
        From a side that is not ready: what arrives in a step and in the next seven, without the latest `depth` waves.
    arrived : ndarray, shape (rows, 16)
        What arrives in the latest steps, and from a side that is ready in the next.
    """

    ready: Any
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
    late_tail: Any
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
    at = _place(sides, row, t - sides.tail_last[row])
    for k in range(sides.tail_count[row]):
        x = x + read(sides.tail_taps, row * sides.tail_taps.shape[1] + k, 0.0) * read(sides.wave, at + k, zero)
    return sides.gain[row] * x


@part(**INLINE)
def _look_ahead(sides: Any, body: Any, cell: Any, t: Any, lead: Any, slot: Any) -> None:
    """Compute what arrives in the eight steps that begin `lead` steps after t; or the sums for those that begin at t.

    Parameters
    ----------
    slot : int
        Where the first of the eight steps is kept.
    """
    for row in range(cell, sides.gain.size, sides.late_tail.size):
        taps = row * sides.taps.shape[1]
        total = spread(0.0)
        if sides.ready[row]:
            at = _place(sides, row, t + lead)
            last = sides.last[row]
            for k in range(last + 1 - sides.first[row]):
                total = total + read(sides.taps, taps + last - k, 0.0) * load(sides.wave, at - last + k)
            if sides.gain[row] != 0.0:
                z = recursion(sides.pole[row], sides.state[row], _to_tail(sides, row, t + lead, spread(0.0)))
                sides.state[row] = highest(z)
                total = total + z
            store(sides.arrived, row * SLOTS + slot, total)
            if row == cell and body is not None:
                for i in range(slot, slot + LANES):
                    x = reflect_one(body, read(sides.arrived, row * SLOTS + i, 0.0), cell, i)
                    write(sides.arrived, row * SLOTS + i, x)
        else:
            at = _place(sides, row, t)
            last = sides.last[row]
            for k in range(last - sides.depth[row]):
                total = total + load(sides.taps, taps + last - k) * read(sides.wave, at - last + k, 0.0)
            store(sides.sums, row * LANES, total)


@part(**INLINE)
def _begin(sides: Any, row: Any) -> Any:
    """Return what a side needs in every step, and what it leaves to the next.

    Returns
    -------
    fixed : tuple
        Whether the side is ready; the coefficients of eight lags from `depth` on.
    state : tuple
        The sums; where `depth` is 2, the outgoing wave that is added to them next; the latest outgoing wave.
    """
    near = load(sides.taps, row * sides.taps.shape[1] + sides.depth[row])
    before = read(sides.wave, _place(sides, row, -2), 0.0)
    latest = read(sides.wave, _place(sides, row, -1), 0.0)
    return (sides.ready[row], near), (load(sides.sums, row * LANES), before, latest)


@part(**INLINE)
def _renew(sides: Any, row: Any, state: Any) -> Any:
    """Return the state with the sums of :func:`_look_ahead`."""
    return load(sides.sums, row * LANES), state[1], state[2]


@part(**INLINE)
def _arriving(sides: Any, row: Any, slot: Any, fixed: Any, state: Any) -> Any:
    """Return what arrives from a side in a step, without a late tail, and the state."""
    ready, near = fixed
    sums, before, latest = state
    if ready:
        return read(sides.arrived, row * SLOTS + slot, 0.0), state
    if sides.depth[row] == 1:
        sums = sums + near * latest
        write(sides.arrived, row * SLOTS + slot, lowest(sums))  # a branch: a choice would always wait for `latest`
        return read(sides.arrived, row * SLOTS + slot, 0.0), (rotated(sums), before, latest)
    sums = sums + near * before
    return lowest(sums), (rotated(sums), latest, latest)


@part(**INLINE)
def _with_tails(sides: Any, cell: Any, t: Any, slot: Any, arriving: Any) -> Any:
    """Return what arrives from the four sides in a step, with late tails."""
    cells = sides.late_tail.size
    for side in range(4):
        write(sides.arrived, (side * cells + cell) * SLOTS + slot, arriving[side])
    for row in range(cell, sides.gain.size, cells):
        if not sides.ready[row] and sides.gain[row] != 0.0:
            z = sides.pole[row] * sides.state[row] + _to_tail(sides, row, t, 0.0)
            sides.state[row] = z
            write(sides.arrived, row * SLOTS + slot, read(sides.arrived, row * SLOTS + slot, 0.0) + z)
    return (
        read(sides.arrived, cell * SLOTS + slot, 0.0),
        read(sides.arrived, (cells + cell) * SLOTS + slot, 0.0),
        read(sides.arrived, (2 * cells + cell) * SLOTS + slot, 0.0),
        read(sides.arrived, (3 * cells + cell) * SLOTS + slot, 0.0),
    )


@part(**INLINE)
def _send(sides: Any, row: Any, t: Any, state: Any, wave: Any) -> Any:
    """Write a step of an outgoing wave, and return the state."""
    write(sides.wave, _place(sides, row, t), wave)
    return state[0], state[1], wave


@part(**INLINE)
def _keep(sides: Any, row: Any, samples: Any, state: Any) -> None:
    """Keep the sums, and move the end of an outgoing wave, after so many samples, to the beginning."""
    store(sides.sums, row * LANES, state[0])
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
            b, n, rb, rn = cell, cells + cell, 2 * cells + cell, 3 * cells + cell
            c_t, c_r = share_t[cell], share_r[cell]
            f_end, f_step, v_0, v_1 = gesture.f_end[cell], gesture.f_step[cell], gesture.v_0[cell], gesture.v_1[cell]
            shapes = gesture.force.shape[1] * min(cell, gesture.force.shape[0] - 1)
            slips = slipping[0, cell] != 0
            fixed_b, state_b = _begin(sides, b)
            fixed_n, state_n = _begin(sides, n)
            fixed_rb, state_rb = _begin(sides, rb)
            fixed_rn, state_rn = _begin(sides, rn)
            for chunk in range(slipping.shape[0] - 1):
                start = first + chunk * samples
                place, shape = (chunk * cells + cell) * samples, shapes + chunk * samples
                number = np.int64(offsets[chunk, cell])
                noted = False  # as if sticking: a slip that continues is a new interval in this chunk
                total = 0.0
                begin = 0
                while begin < samples:
                    now = start + begin
                    if (now + LEAD) & (LANES - 1) == 0 or now == 0:
                        lead = LEAD if now > 0 else 0
                        _look_ahead(sides, body, cell, begin, lead, (now + lead) & (SLOTS - 1))
                        state_b, state_n = _renew(sides, b, state_b), _renew(sides, n, state_n)
                        state_rb, state_rn = _renew(sides, rb, state_rb), _renew(sides, rn, state_rn)
                    end = min(begin + LANES - ((now + LEAD) & (LANES - 1)), samples)
                    for t in range(begin, end):
                        slot = (start + t) & (SLOTS - 1)
                        in_b, state_b = _arriving(sides, b, slot, fixed_b, state_b)
                        in_n, state_n = _arriving(sides, n, slot, fixed_n, state_n)
                        in_rb, state_rb = _arriving(sides, rb, slot, fixed_rb, state_rb)
                        in_rn, state_rn = _arriving(sides, rn, slot, fixed_rn, state_rn)
                        if sides.late_tail[cell]:
                            in_b, in_n, in_rb, in_rn = _with_tails(sides, cell, t, slot, (in_b, in_n, in_rb, in_rn))
                        if not fixed_b[0]:
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
                        state_b = _send(sides, b, t, state_b, out_b)
                        state_n = _send(sides, n, t, state_n, in_b + push_t)
                        state_rb = _send(sides, rb, t, state_rb, in_rn + push_r)
                        state_rn = _send(sides, rn, t, state_rn, in_rb + push_r)
                        write(bridge_force, place + t, np.float32(out_b))
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
                _keep(sides, b, samples, state_b)
                _keep(sides, n, samples, state_n)
                _keep(sides, rb, samples, state_rb)
                _keep(sides, rn, samples, state_rn)
        return version

    return advance
