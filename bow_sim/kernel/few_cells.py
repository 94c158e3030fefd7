"""The time loop for a few cells: one after the other, one number at a time, some of the work for eight steps at once.

Eight lanes of which one is needed cost as much as eight. Here the lanes are *steps*: at the beginning of eight steps,
what has left the bow before is summed for all of them at once. Where the least lag is less than eight samples, what
leaves the bow in a step is then added to all those of the eight steps that it reaches. So each sum goes from the
greatest lag to the least, as everywhere. The rest of a step is computed as in :mod:`bow_sim.kernel.time_loop`, by the
same functions, and the results are the same to the last bit.

This module holds compiled code only.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from bow_sim.kernel.arguments import Gesture, String
from bow_sim.kernel.body import of_body, reflect_one
from bow_sim.kernel.hair import pull_hair, with_hair
from bow_sim.physics.friction import solve, state_of
from bow_sim.simd.jit import INLINE, njit, part
from bow_sim.simd.lanes import LANES, choose, load, read, spread, store, write

FEW = 4
"""So many cells, and fewer, take less time here than as lanes."""


class Side(NamedTuple):
    """One side of the bow, as :class:`bow_sim.kernel.arguments.Side`, for cells one by one.

    Parameters
    ----------
    ready : ndarray of bool, shape (cells,)
        Whether all that arrives in eight steps has left the bow before them.
    soonest : ndarray, shape (cells,)
        The least lag.
    taps : ndarray, shape (cells, taps)
        Coefficients of a cell that is ready, that of the greatest lag first.
    count, last : ndarray, shape (cells,)
        How many these are, and the greatest lag.
    reach : ndarray, shape (cells, last + 8, 8)
        Coefficients of a cell that is not ready: from each of the samples before eight steps, and then from each of
        these, to each of these. 0 where nothing arrives.
    gain, pole, state : ndarray, shape (cells,)
        The exponential tail; gain 0 for none.
    tail_taps : ndarray, shape (cells, taps)
        What the tail is made of, the greatest lag first.
    tail_count, tail_last : ndarray, shape (cells,)
        How many these are, and the lag of the first.
    body : Body or None
    wave : ndarray, shape (cells, past + samples)
        Outgoing wave: the last samples before these, then these.
    past : int
    arrived : ndarray, shape (8,)
        Incoming wave in the current eight steps, as far as it is known.
    """

    ready: Any
    soonest: Any
    taps: Any
    count: Any
    last: Any
    reach: Any
    gain: Any
    pole: Any
    state: Any
    tail_taps: Any
    tail_count: Any
    tail_last: Any
    body: Any
    wave: Any
    past: Any
    arrived: Any


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
def _keep(side: Any, cell: Any, samples: Any) -> None:
    """Move the end of an outgoing wave, after so many samples, to the beginning."""
    first = cell * side.wave.shape[1]
    for t in range(first, first + side.past):
        write(side.wave, t, read(side.wave, t + samples, 0.0))


@part(**INLINE)
def _finish(side: Any, cell: Any, t: Any, u: Any) -> Any:
    """Return what arrives in a step, after tail and body."""
    total = read(side.arrived, u, 0.0)
    if side.gain[cell] != 0.0:
        x = 0.0
        at = cell * side.wave.shape[1] + side.past + t - side.tail_last[cell]
        for k in range(side.tail_count[cell]):
            x += read(side.tail_taps, cell * side.tail_taps.shape[1] + k, 0.0) * read(side.wave, at + k, 0.0)
        z = side.pole[cell] * side.state[cell] + side.gain[cell] * x
        side.state[cell] = z
        total += z
    return reflect_one(side.body, total, cell, u)


@part(**INLINE)
def _look_ahead(side: Any, cell: Any, t0: Any, steps: Any) -> None:
    """Sum over all that has left the bow before eight steps, a lane for each; if that is all, finish these steps."""
    total = spread(0.0)
    now = cell * side.wave.shape[1] + side.past + t0
    last = side.last[cell]
    if side.ready[cell]:
        first = cell * side.taps.shape[1]
        for k in range(side.count[cell]):
            total = total + read(side.taps, first + k, 0.0) * load(side.wave, now - last + k)
        store(side.arrived, 0, total)
        if side.gain[cell] != 0.0 or side.body is not None:
            for u in range(steps):
                write(side.arrived, u, _finish(side, cell, t0 + u, u))
    else:
        first = cell * side.reach.shape[1] * LANES
        for k in range(last):
            total = total + load(side.reach, first + k * LANES) * read(side.wave, now - last + k, 0.0)
        store(side.arrived, 0, total)


@part(**INLINE)
def _reach(side: Any, cell: Any, t: Any, u: Any) -> None:
    """Add what left the bow in the step before to all those of the eight steps that it reaches."""
    if u > 0:
        reach = load(side.reach, (cell * side.reach.shape[1] + side.last[cell] + u - 1) * LANES)
        wave = read(side.wave, cell * side.wave.shape[1] + side.past + t - 1, 0.0)
        store(side.arrived, 0, load(side.arrived, 0) + reach * wave)


@part(**INLINE)
def _arriving(side: Any, cell: Any, t: Any, u: Any) -> Any:
    """Return what arrives from a side in a step; without waiting for the step before, where that does not matter."""
    if side.ready[cell]:
        return read(side.arrived, u, 0.0)
    if side.soonest[cell] > 1:
        arrived = _finish(side, cell, t, u)
        _reach(side, cell, t, u)
        return arrived
    _reach(side, cell, t, u)
    return _finish(side, cell, t, u)


@part(**INLINE)
def _send(side: Any, cell: Any, t: Any, wave: Any) -> None:
    """Write a step of an outgoing wave."""
    write(side.wave, cell * side.wave.shape[1] + side.past + t, wave)


def build(version: int) -> Any:
    """Make the loop: the compiled function ``advance(samples, string, gesture, output)``.

    It computes some chunks of all cells, each of `samples` samples. `string` has sides of this module; the shapes of
    the gesture have the shape (1, chunks x samples), or (cells, chunks x samples) where each cell has its own.
    :func:`bow_sim.kernel.time_loop.build` has the mathematics and `version`.
    """

    @njit(nogil=True, cache=version != 0, error_model="numpy", _nrt=False)
    def advance(samples: int, string: String, gesture: Gesture, output: Output) -> int:
        bridge, nut, torsion_bridge, torsion_nut, law, share_t, share_r, hair = string
        bridge_force, slipping, offsets, onset, duration, slip, traces = output
        cells = bridge.wave.shape[0]
        offsets[:, 0] = 0
        for cell in range(cells):
            c_t, c_r = share_t[cell], share_r[cell]
            f_end, f_step, v_0, v_1 = gesture.f_end[cell], gesture.f_step[cell], gesture.v_0[cell], gesture.v_1[cell]
            shapes = gesture.force.shape[1] * min(cell, gesture.force.shape[0] - 1)
            slips = slipping[0, cell] != 0
            for chunk in range(slipping.shape[0] - 1):
                start = chunk * samples
                rows = (chunk * cells + cell) * samples
                number = np.int64(offsets[chunk, cell])
                noted = False  # as if sticking: a slip that continues is a new interval in this chunk
                total = 0.0
                for t0 in range(0, samples, LANES):
                    steps = min(LANES, samples - t0)
                    _look_ahead(bridge, cell, start + t0, steps)
                    _look_ahead(nut, cell, start + t0, steps)
                    _look_ahead(torsion_bridge, cell, start + t0, steps)
                    _look_ahead(torsion_nut, cell, start + t0, steps)
                    for u in range(steps):
                        t = start + t0 + u
                        in_b, in_n = _arriving(bridge, cell, t, u), _arriving(nut, cell, t, u)
                        in_rb, in_rn = _arriving(torsion_bridge, cell, t, u), _arriving(torsion_nut, cell, t, u)
                        f_b = f_end + f_step * read(gesture.force, shapes + t, 0.0)
                        v_b = v_0 + v_1 * read(gesture.speed, shapes + t, 0.0)
                        v_h = in_b + in_n + in_rn + in_rb
                        v_b = with_hair(hair, cell, v_b)
                        d = v_b - v_h
                        s, slips = solve(law, cell, d, f_b, slips)
                        push = d - s  # Y f
                        push_t, push_r = c_t * push, c_r * push
                        out_b = in_n + push_t
                        _send(bridge, cell, t, out_b)
                        _send(nut, cell, t, in_b + push_t)
                        _send(torsion_bridge, cell, t, in_rn + push_r)
                        _send(torsion_nut, cell, t, in_rb + push_r)
                        write(bridge_force, rows + t0 + u, np.float32(out_b))
                        if slips != noted:
                            noted = slips
                            if slips:
                                onset[chunk, number] = t0 + u
                            else:
                                duration[chunk, number] = t0 + u - onset[chunk, number]
                                slip[chunk, number] = total
                                number += 1
                        total = choose(slips, total + s, 0.0)
                        v = pull_hair(hair, cell, push, v_h, v_b - s)
                        if traces.shape[0] > 0:
                            waves = (out_b, v, v_h, in_b + in_n + push_t, push, choose(slips, 1.0, 0.0))
                            waves = waves + of_body(bridge.body, u, push) + state_of(law, cell, push)
                            for k in range(len(waves)):
                                traces[chunk, k, t0 + u, cell] = waves[k]
                if noted:
                    duration[chunk, number] = samples - onset[chunk, number]
                    slip[chunk, number] = total
                    number += 1
                offsets[chunk, cell + 1] = number
                slipping[chunk + 1, cell] = slips
            whole = (slipping.shape[0] - 1) * samples
            _keep(bridge, cell, whole)
            _keep(nut, cell, whole)
            _keep(torsion_bridge, cell, whole)
            _keep(torsion_nut, cell, whole)
        return version

    return advance
