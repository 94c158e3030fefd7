"""The arguments of the time loop, as named tuples of arrays.

Cells are computed in groups of eight lanes, so *groups* is the number of cells over eight, rounded up, and *lanes* is
eight times that; an array of shape (lanes,) holds a number for each cell. Numba compiles the time loop for the types of
the fields: for a field that is None, it compiles a kernel without that part.
"""

from __future__ import annotations

from typing import Any, NamedTuple

SIDES = ("bridge", "nut", "torsion_bridge", "torsion_nut")
"""The four sides of the bow, as in `String`."""


class Tail(NamedTuple):
    """Exponential tail of a reflection function: ``z = pole z + gain x[t - last]`` is added to what arrives.

    Parameters
    ----------
    gain, pole, state : ndarray, shape (lanes,)
    last : ndarray, shape (groups,)
        The lag at which the tail begins, samples; with ``taps``, the lag of the first of them.
    taps : None, or ndarray, shape (groups, taps, 8)
        Selects each lane's own lag: 1 at that lag, 0 at the others; or interpolates between lags.
    count : ndarray, shape (groups,)
        How many of these are needed; beyond them all are 0.
    used : ndarray of bool, shape (groups,)
        False where all lanes have a gain of 0.
    """

    gain: Any
    pole: Any
    state: Any
    last: Any
    taps: Any
    count: Any
    used: Any


class Body(NamedTuple):
    """Modes of the body behind the bridge (PHYSICS.md section 11): each a resonator with two numbers of state.

    Parameters
    ----------
    b0, a1, a2 : ndarray, shape (1, modes, 8) or (groups, modes, 8)
        Coefficients: common to all cells, or each cell's own.
    stride : int
        Elements from one group to the next in these; 0 if they are common.
    z1, z2 : ndarray, shape (groups, modes, 8)
        State.
    sum_b, den, rho, gain, pole : ndarray, shape (lanes,)
        The sum of b0, ``1/(1 + (1 + rho) sum_b/2)``, and Cremer's reflection of what the modes leave.
    sum_z, tail : ndarray, shape (lanes,)
        The sum of z1, and the state of Cremer's reflection.
    force, velocity : ndarray, shape (8, 8)
        Force on the bridge over Z_0, and its velocity, in the current eight steps.
    """

    b0: Any
    a1: Any
    a2: Any
    stride: Any
    z1: Any
    z2: Any
    sum_b: Any
    den: Any
    rho: Any
    gain: Any
    pole: Any
    sum_z: Any
    tail: Any
    force: Any
    velocity: Any


class Hair(NamedTuple):
    """The bow hair, a spring with a dashpot beside it (PHYSICS.md section 12).

    Parameters
    ----------
    share : ndarray, shape (lanes,)
        ``2 Z_0/(R Y')`` with the dashpot R and the admittance Y' at the bow, hair included.
    string : ndarray, shape (lanes,)
        ``Y/Y'``: what of the speed difference the string takes.
    decay : ndarray, shape (lanes,)
        ``exp(-k/(R sample_rate))`` with the spring k.
    state : ndarray, shape (lanes,)
        Velocity of the spring.
    """

    share: Any
    string: Any
    decay: Any
    state: Any


class Side(NamedTuple):
    """One side of the bow: outgoing wave, reflection function and incoming wave, for all groups of eight cells.

    Parameters
    ----------
    taps : tuple of float, or ndarray, shape (groups, taps, 8)
        Coefficients, that of the greatest lag first: common to all cells, or each cell's own, then an even number.
    count : ndarray, shape (groups,)
        How many of each cell's own taps are needed; beyond them all are 0.
    last : ndarray, shape (groups,)
        The greatest lag of the taps, samples.
    ahead : ndarray, shape (groups,)
        The least lag, samples: how many steps can be computed at once.
    tail : Tail or None
    body : Body or None
        If not None, taps and tail give what arrives at the bridge, and the body what it sends back.
    ring : ndarray, shape (groups, at least lead + length, 8)
        Outgoing wave, a ring buffer of ``length`` rows. Its last ``lead`` rows are repeated before it, so that any
        window of rows is contiguous. Rows behind it stay 0.
    length, lead : int
        Rows, multiples of eight: eight steps that begin at such a number are not divided.
    arrived : ndarray, shape (8, 8), or (16, 8) for the torsional bridge
        Incoming wave in the current eight steps, and in those after them: rows of the workspace in `State`.
    delayed : None, or ndarray, shape (8, 8)
        With a tail that has taps, workspace for what these select in eight steps.
    table : None, or ndarray, shape (taps,)
        Taps that are common to all cells, as an array.
    """

    taps: Any
    count: Any
    last: Any
    ahead: Any
    tail: Any
    body: Any
    ring: Any
    length: Any
    lead: Any
    arrived: Any
    delayed: Any
    table: Any


class Gesture(NamedTuple):
    """``f_b(t) = f_end + f_step force(t)`` and ``v_b(t) = v_0 + v_1 speed(t)``; see :mod:`bow_sim.physics.gesture`.

    Parameters
    ----------
    f_end, f_step, v_0, v_1 : ndarray, shape (lanes,)
    force, speed : ndarray, shape (samples,), or each cell's own, (groups, samples, 8)
    """

    f_end: Any
    f_step: Any
    v_0: Any
    v_1: Any
    force: Any
    speed: Any


class String(NamedTuple):
    """The string at the bow, for all groups of eight cells.

    Parameters
    ----------
    bridge, nut, torsion_bridge, torsion_nut : Side
    law : NamedTuple of ndarray, shape (lanes,)
        Friction law, see :mod:`bow_sim.physics.friction`.
    share_t, share_r : ndarray, shape (lanes,)
        ``Y_T/2Y'`` and ``Y_R/2Y'``; ``Y' = Y`` where the hair is rigid.
    hair : Hair or None
    """

    bridge: Any
    nut: Any
    torsion_bridge: Any
    torsion_nut: Any
    law: Any
    share_t: Any
    share_r: Any
    hair: Any


class State(NamedTuple):
    """What a chunk leaves to the next, beside the rings and tails of the sides.

    Parameters
    ----------
    slipping : ndarray of uint8, shape (groups,)
        After the latest step, one bit a lane.
    work : ndarray, shape (41 + samples, 8)
        Workspace of a group: what arrives from each of the four sides in eight steps, and the sums of the slip speed
        before each step of the chunk and after them.
    states, bits : ndarray, shape (words, 8)
        Workspace of a group: the states of each lane in as many steps as a lane has bits, the first step lowest; as
        lanes, and the same memory as unsigned integers.
    edges : ndarray of uint32, shape (samples + 1,)
        Workspace of a lane: steps of the chunk in which a slip begins or ends.
    """

    slipping: Any
    work: Any
    states: Any
    bits: Any
    edges: Any


class Intervals(NamedTuple):
    """The slip intervals of a chunk, those of all lanes one after the other; see `bow_sim.kernel.block.ChunkResult`.

    Parameters
    ----------
    offsets : ndarray of uint32, shape (lanes + 1,)
        Where those of each lane begin; the first is 0.
    onset, duration : ndarray of uint32, shape (most,)
    slip : ndarray of float64, shape (most,)
    """

    offsets: Any
    onset: Any
    duration: Any
    slip: Any


class Places(NamedTuple):
    """Where the lanes are written, which need not be in the order of the cells.

    Parameters
    ----------
    rows : ndarray, shape (lanes,)
        The row of each lane in `Output.bridge_force`.
    intervals : Intervals
        The slip intervals in the order of these rows.
    """

    rows: Any
    intervals: Any


class Output(NamedTuple):
    """Where a chunk is written.

    Parameters
    ----------
    bridge_force : ndarray of float32, shape (lanes, samples)
    intervals : Intervals
        In the order of the lanes.
    places : Places or None
        None: lanes are in the order of the cells.
    traces : None, or ndarray, shape (waveforms, samples, lanes)
        See :data:`bow_sim.kernel.block.TRACES`.
    """

    bridge_force: Any
    intervals: Any
    places: Any
    traces: Any
