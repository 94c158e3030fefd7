"""Eight whole steps of the time loop, for processors with AVX-512: compiled code only.

With 32 registers of eight lanes, the order of the operations limits the speed: those that wait for a square root keep
later ones out of the processor's queues. So here

- each sample of the torsional wave towards the bridge is added to all sums that it is part of, which stay in registers
  while the coefficients are read from memory (`push`); the general loop reads ten rows of the ring for each step;
- it is added at once only to the sum that it completes (`completed`), and to the others a step later, when it is known:
  operations that wait for it would keep others waiting;
- a step's root is begun before the step before is ended;
- where torsion comes back from the bridge after two samples, as in the paper, it is taken from a register: to read what
  has just been written takes 11 cycles.

The terms of each sum and their order are those of the general loop, and so is every bit of the results.
"""

from __future__ import annotations

from typing import Any

from numba import types
from numba.core.registry import cpu_target

from bow_sim.kernel.rings import STRIDE, TOTALS, row_of, shape_at
from bow_sim.physics.friction import solve
from bow_sim.simd.jit import INLINE, OVERLOAD, overload, part
from bow_sim.simd.lane_types import has_avx512
from bow_sim.simd.lanes import LANES, choose, load, signs_of, store
from bow_sim.simd.rows import completed, fir_of, nothing_summed, push
from bow_sim.simd.signs import followed

_FAR = ("bridge", "nut", "torsion_nut")
_fir = fir_of(STRIDE)

NEAREST = 2
"""The least lag of torsion at the bridge with which eight steps are possible."""


def _fields(kind: Any) -> dict[str, Any]:
    """Return the types of a named tuple's fields."""
    return dict(zip(kind.fields, kind.types, strict=True))


def _are_possible(string: Any, traces: Any) -> bool:
    """Return whether the types of a kernel's arguments are those of `eight_steps`."""
    fields = _fields(string)
    far = [_fields(fields[name]) for name in _FAR]
    near = _fields(fields["torsion_bridge"])
    taps = [side["taps"] for side in (*far, near)]
    absent = [fields["hair"], traces, far[0]["body"], near["tail"]]
    return (
        has_avx512(cpu_target.target_context)
        and all(isinstance(x, types.BaseTuple) for x in taps)
        and all(isinstance(x, types.NoneType) for x in absent)
        and near["taps"].count > 1
    )


def are_possible(string: Any, traces: Any, group: Any) -> bool:
    """Return whether `eight_steps` can compute a group: three sides are eight steps away or more, torsion 2 ... 7."""
    raise NotImplementedError


@overload(are_possible, strict=False, jit_options=OVERLOAD)
def _overload_are_possible(string: Any, traces: Any, group: Any) -> Any:
    if not _are_possible(string, traces):
        return lambda string, traces, group: False

    def far_enough(string: Any, traces: Any, group: Any) -> bool:
        far = min(string.bridge.ahead[group], string.nut.ahead[group], string.torsion_nut.ahead[group])
        return far >= STRIDE and NEAREST <= string.torsion_bridge.ahead[group] < STRIDE

    return far_enough


def sums_before(string: Any, traces: Any, group: Any, at: Any, zero: Any) -> Any:
    """Return the sums of what leaves, as torsion, towards the bridge before the step at a position of its ring.

    The latest one that is complete; the others as `push` returns them, without the latest sample; and this sample. What
    is complete is also written where it arrives. None where `eight_steps` are not possible.
    """
    raise NotImplementedError


@overload(sums_before, strict=False, jit_options=OVERLOAD)
def _overload_sums_before(string: Any, traces: Any, group: Any, at: Any, zero: Any) -> Any:
    if not _are_possible(string, traces):
        return lambda string, traces, group, at, zero: None

    def summed(string: Any, traces: Any, group: Any, at: Any, zero: Any) -> Any:
        side = string.torsion_bridge
        ahead = side.ahead[group]
        samples = len(side.taps) - 1 + ahead
        first = row_of(side, group, at - samples)
        sums = zero, nothing_summed(side.taps, zero), zero
        for k in range(samples):
            others, latest = push(side.table, sums[1], sums[2]), load(side.ring, (first + k) * LANES)
            sums = completed(side.table, others, latest), others, latest
            store(side.arrived, max(0, k + ahead - samples) * LANES, sums[0])  # the first ones arrived before
        return sums

    return summed


@part(**INLINE)
def _window(side: Any, group: Any, at: Any) -> Any:
    """Return the flat index of the oldest sample in the window of the step at a position; sum the windows of eight."""
    first = row_of(side, group, at - side.last[group]) * LANES
    if len(side.taps) > 1:
        _fir(side.taps, side.ring, first, side.arrived, 0, LANES)
    return first


@part(**INLINE)
def _sum(side: Any, first: Any, i: Any) -> Any:
    """Return the sum of a window, i elements from the first on."""
    if len(side.taps) > 1:
        return load(side.arrived, i)
    return load(side.ring, first + i) * side.taps[0] + 0.0


def _tail_before(side: Any, tail: Any, group: Any, at: Any) -> Any:
    """Return state, pole and gain of an exponential tail, and the flat index of its first sample; None without one."""
    raise NotImplementedError


@overload(_tail_before, strict=False, jit_options=OVERLOAD)
def _overload_tail_before(side: Any, tail: Any, group: Any, at: Any) -> Any:
    if isinstance(tail, types.NoneType):
        return lambda side, tail, group, at: None

    def before(side: Any, tail: Any, group: Any, at: Any) -> Any:
        i = group * LANES
        first = row_of(side, group, at - tail.last[group]) * LANES
        return load(tail.state, i), load(tail.pole, i), load(tail.gain, i), first

    return before


def _with_tail(side: Any, x: Any, i: Any, tail: Any) -> Any:
    """Return what arrives with its exponential tail, if there is one, and the tail after this step."""
    raise NotImplementedError


@overload(_with_tail, strict=False, jit_options=OVERLOAD)
def _overload_with_tail(side: Any, x: Any, i: Any, tail: Any) -> Any:
    if isinstance(tail, types.NoneType):
        return lambda side, x, i, tail: (x, tail)

    def with_tail(side: Any, x: Any, i: Any, tail: Any) -> Any:
        z, pole, gain, first = tail
        z = pole * z + gain * load(side.ring, first + i)
        return x + z, (z, pole, gain, first)

    return with_tail


def _keep_tail(tail: Any, group: Any, after: Any) -> None:
    """Write the state of an exponential tail, if there is one."""
    raise NotImplementedError


@overload(_keep_tail, strict=False, jit_options=OVERLOAD)
def _overload_keep_tail(tail: Any, group: Any, after: Any) -> Any:
    if isinstance(tail, types.NoneType):
        return lambda tail, group, after: None
    return lambda tail, group, after: store(tail.state, group * LANES, after[0])


@part(**INLINE)
def _meet(
    string: Any, gesture: Any, group: Any, levels: Any, windows: Any, t0: Any, u: Any, slips: Any, near: Any, tails: Any
) -> Any:
    """Return what arrives in step u, and where string and friction meet; near is the torsion completed last."""
    f_end, f_step, v_0, v_1 = levels
    i = u * LANES
    in_b, tail_b = _with_tail(string.bridge, _sum(string.bridge, windows[0], i), i, tails[0])
    in_n, tail_n = _with_tail(string.nut, _sum(string.nut, windows[1], i), i, tails[1])
    in_rn, tail_rn = _with_tail(string.torsion_nut, _sum(string.torsion_nut, windows[2], i), i, tails[2])
    in_rb = near  # what left two steps before was added last
    if string.torsion_bridge.ahead[group] > NEAREST or u == 0:
        in_rb = load(string.torsion_bridge.arrived, i)
    f_b = f_end + f_step * shape_at(gesture.force, group, t0 + u)
    v_b = v_0 + v_1 * shape_at(gesture.speed, group, t0 + u)
    v_h = in_b + in_n + in_rn + in_rb  # in the order of the general loop
    d = v_b - v_h
    s, state = solve(string.law, group * LANES, d, f_b, slips)
    return (d, s, signs_of(state, s), in_b, in_n, in_rb, in_rn), (tail_b, tail_n, tail_rn)


@part(**INLINE)
def _leave(string: Any, work: Any, group: Any, shares: Any, rows: Any, t0: Any, u: Any, met: Any, carried: Any) -> Any:
    """Write the waves that leave the bow in step u; return sums of slip speed and of torsion, and the past states."""
    c_t, c_r = shares
    d, s, slips, in_b, in_n, in_rb, in_rn = met
    total, sums, past = carried
    near = string.torsion_bridge
    i = u * LANES
    force = d - s  # Y f
    push_t, push_r = c_t * force, c_r * force
    out_rb = in_rn + push_r
    store(string.bridge.ring, rows[0] + i, in_n + push_t)
    store(string.nut.ring, rows[1] + i, in_b + push_t)
    store(near.ring, rows[2] + i, out_rb)
    store(string.torsion_nut.ring, rows[3] + i, in_rb + push_r)
    others = push(near.table, sums[1], sums[2])
    sums = completed(near.table, others, out_rb), others, out_rb
    store(near.arrived, near.ahead[group] * LANES + i, sums[0])
    total = choose(slips, total + s, 0.0)
    store(work, (TOTALS + 1 + t0) * LANES + i, total)
    return total, sums, followed(past, slips)


def eight_steps(
    string: Any, gesture: Any, work: Any, group: Any, constants: Any, rows: Any, at: Any, t0: Any, carried: Any
) -> Any:
    """Compute eight steps of a group from t0 on, and write the waves that leave the bow.

    Parameters
    ----------
    string, gesture, work
        As in :mod:`bow_sim.kernel.arguments`.
    group : int
    constants : tuple
        ``c_t, c_r``, and ``f_end, f_step, v_0, v_1``, lanes.
    rows, at : tuple of int
        Flat index of the first row to be written, and position in the ring, of the four sides.
    t0 : int
        The first step, from the beginning of the chunk.
    carried : tuple
        Where the string slips (signs), the sum of the slip speed (lanes), the sums of `sums_before`, and the states
        until now (lanes; see :func:`bow_sim.simd.signs.followed`).

    Returns
    -------
    tuple
        `carried` for the next steps.
    """
    raise NotImplementedError


@overload(eight_steps, strict=False, jit_options=OVERLOAD)
def _overload_eight_steps(
    string: Any, gesture: Any, work: Any, group: Any, constants: Any, rows: Any, at: Any, t0: Any, carried: Any
) -> Any:
    if isinstance(carried.types[2], types.NoneType):
        return lambda string, gesture, work, group, constants, rows, at, t0, carried: carried

    def eight(
        string: Any, gesture: Any, work: Any, group: Any, constants: Any, rows: Any, at: Any, t0: Any, carried: Any
    ) -> Any:
        bridge, nut, near, torsion_nut = string.bridge, string.nut, string.torsion_bridge, string.torsion_nut
        shares, levels = constants
        slips, total, sums, past = carried
        windows = _window(bridge, group, at[0]), _window(nut, group, at[1]), _window(torsion_nut, group, at[3])
        tails = (
            _tail_before(bridge, bridge.tail, group, at[0]),
            _tail_before(nut, nut.tail, group, at[1]),
            _tail_before(torsion_nut, torsion_nut.tail, group, at[3]),
        )
        left = total, sums, past
        met, tails = _meet(string, gesture, group, levels, windows, t0, 0, slips, sums[0], tails)
        for u in range(1, STRIDE):
            later, tails = _meet(string, gesture, group, levels, windows, t0, u, met[2], left[1][0], tails)
            left = _leave(string, work, group, shares, rows, t0, u - 1, met, left)
            met = later
        total, sums, past = _leave(string, work, group, shares, rows, t0, STRIDE - 1, met, left)
        _keep_tail(bridge.tail, group, tails[0])
        _keep_tail(nut.tail, group, tails[1])
        _keep_tail(torsion_nut.tail, group, tails[2])
        for i in range(0, (STRIDE - 1) * LANES, LANES):  # what arrives in the next steps
            store(near.arrived, i, load(near.arrived, STRIDE * LANES + i))
        return met[2], total, sums, past

    return eight
