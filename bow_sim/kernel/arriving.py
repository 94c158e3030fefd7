"""What arrives at the bow from one side, some steps at once as far as it has left: compiled code only."""

from __future__ import annotations

from typing import Any

from numba import types

from bow_sim.kernel.body import reflect_at_body
from bow_sim.kernel.rings import STRIDE, row_of
from bow_sim.simd.jit import INLINE, OVERLOAD, overload, part
from bow_sim.simd.lanes import LANES, load, store
from bow_sim.simd.rows import fir_each_of, fir_of

_fir1, _fir2, _fir8 = fir_of(1), fir_of(2), fir_of(8)
_fir_each1, _fir_each2, _fir_each4, _fir_each8 = fir_each_of(1), fir_each_of(2), fir_each_of(4), fir_each_of(8)

NEAR = 4
"""Torsion that comes back from the bridge after fewer steps is taken from registers: it takes long to read what has
just been written."""


def _convolve(taps: Any, count: Any, group: Any, x: Any, i: Any, out: Any, u: Any, n: Any) -> None:
    """Compute rows u ... u + n - 1 of ``out``; the window of the first begins at flat index i of x."""
    raise NotImplementedError


@overload(_convolve, strict=False, jit_options=OVERLOAD)
def _overload_convolve(taps: Any, count: Any, group: Any, x: Any, i: Any, out: Any, u: Any, n: Any) -> Any:
    if isinstance(taps, types.BaseTuple):

        def common(taps: Any, count: Any, group: Any, x: Any, i: Any, out: Any, u: Any, n: Any) -> None:
            if n == STRIDE:
                _fir8(taps, x, i, out, u * LANES, LANES)
            elif n == 2:
                _fir2(taps, x, i, out, u * LANES, LANES)
            else:
                _fir1(taps, x, i, out, u * LANES, LANES)

        return common

    def each(taps: Any, count: Any, group: Any, x: Any, i: Any, out: Any, u: Any, n: Any) -> None:
        needed = count[group]
        base = group * taps.shape[1] * LANES
        if n == STRIDE:
            _fir_each8(taps, base, needed, x, i, out, u * LANES)
        elif n == 2:
            _fir_each2(taps, base, needed, x, i, out, u * LANES)
        else:
            _fir_each1(taps, base, needed, x, i, out, u * LANES)

    return each


def _delayed(side: Any, taps: Any, group: Any, row: Any, n: Any) -> Any:
    """Return an array, and the row from which on it has what is added to a tail in n steps.

    The window of the first step begins at a row of all rings.
    """
    raise NotImplementedError


@overload(_delayed, strict=False, jit_options=OVERLOAD)
def _overload_delayed(side: Any, taps: Any, group: Any, row: Any, n: Any) -> Any:
    if isinstance(taps, types.NoneType):
        return lambda side, taps, group, row, n: (side.ring, row)

    def select(side: Any, taps: Any, group: Any, row: Any, n: Any) -> Any:
        rows = STRIDE if n > 2 else n  # nobody reads those from n on
        _convolve(taps, side.tail.count, group, side.ring, row * LANES, side.delayed, 0, rows)
        return side.delayed, 0

    return select


def _add_tail(side: Any, tail: Any, group: Any, block: Any, u: Any, n: Any) -> None:
    """Add the exponential tail, if there is one, to rows u ... u + n - 1 of what arrives."""
    raise NotImplementedError


@overload(_add_tail, strict=False, jit_options=OVERLOAD)
def _overload_add_tail(side: Any, tail: Any, group: Any, block: Any, u: Any, n: Any) -> Any:
    if isinstance(tail, types.NoneType):
        return lambda side, tail, group, block, u, n: None

    def add(side: Any, tail: Any, group: Any, block: Any, u: Any, n: Any) -> None:
        if not tail.used[group]:
            return
        z = load(tail.state, group * LANES)
        pole, gain = load(tail.pole, group * LANES), load(tail.gain, group * LANES)
        x, first = _delayed(side, tail.taps, group, row_of(side, group, block + u - tail.last[group]), n)
        for r in range(n):
            z = pole * z + gain * load(x, (first + r) * LANES)
            store(side.arrived, (u + r) * LANES, load(side.arrived, (u + r) * LANES) + z)
        store(tail.state, group * LANES, z)

    return add


@part(**INLINE)
def fill(side: Any, group: Any, u: Any, end: Any, block: Any) -> Any:
    """Compute what arrives from step u on, as far as it has already left, and return the first step not computed.

    Where all eight steps have left, all are computed, also those before u and from `end` on, which nobody reads.
    """
    ahead = side.ahead[group]
    whole = ahead >= STRIDE
    n = min(ahead if whole else min(ahead, 2), end - u)
    first = 0 if whole else u
    oldest = row_of(side, group, block + first - side.last[group])
    _convolve(side.taps, side.count, group, side.ring, oldest * LANES, side.arrived, first, STRIDE if whole else n)
    _add_tail(side, side.tail, group, block, u, n)
    reflect_at_body(side.body, side.arrived, group, u, n)
    return u + n


@part(**INLINE)
def _is_near(side: Any, group: Any) -> Any:
    return side.ahead[group] < NEAR and not side.tail.used[group]


def fill_near(side: Any, taps: Any, group: Any, u: Any, end: Any, block: Any) -> Any:
    """Do the same for torsion at the bridge; each cell's own taps of lags below `NEAR` are left to `with_latest`."""
    raise NotImplementedError


@overload(fill_near, strict=False, jit_options=OVERLOAD)
def _overload_fill_near(side: Any, taps: Any, group: Any, u: Any, end: Any, block: Any) -> Any:
    if isinstance(taps, types.BaseTuple):
        return lambda side, taps, group, u, end, block: fill(side, group, u, end, block)

    def near(side: Any, taps: Any, group: Any, u: Any, end: Any, block: Any) -> Any:
        if not _is_near(side, group):
            return fill(side, group, u, end, block)
        first, count = u & -NEAR, side.last[group] + 1 - NEAR
        oldest = row_of(side, group, block + first - side.last[group]) * LANES
        _fir_each4(taps, group * taps.shape[1] * LANES, count, side.ring, oldest, side.arrived, first * LANES)
        return min(first + NEAR, end)

    return near


@part(**INLINE)
def latest_before(side: Any, group: Any, position: Any) -> Any:
    """Return the latest three samples, the oldest first, that left before the step at a position of a ring."""
    i = row_of(side, group, position - 3) * LANES
    return load(side.ring, i), load(side.ring, i + LANES), load(side.ring, i + 2 * LANES)


def with_latest(side: Any, taps: Any, group: Any, x: Any, latest: Any) -> Any:
    """Add, to what `fill_near` has computed for a step, what left in the latest three steps before it."""
    raise NotImplementedError


@overload(with_latest, strict=False, jit_options=OVERLOAD)
def _overload_with_latest(side: Any, taps: Any, group: Any, x: Any, latest: Any) -> Any:
    if isinstance(taps, types.BaseTuple):
        return lambda side, taps, group, x, latest: x

    def add(side: Any, taps: Any, group: Any, x: Any, latest: Any) -> Any:
        if _is_near(side, group):
            i = (group * taps.shape[1] + side.last[group] + 1 - NEAR) * LANES
            x = x + load(taps, i) * latest[0] + load(taps, i + LANES) * latest[1]
            if side.ahead[group] == 1:  # else these taps are 0, and each step would wait for the one before
                x = x + load(taps, i + 2 * LANES) * latest[2]
        return x

    return add
