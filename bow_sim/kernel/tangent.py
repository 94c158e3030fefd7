"""The linearised motion of a string beside a real one (PHYSICS.md section 15): how an infinitesimal change goes on.

Waves, tails and modes of the body obey the same linear equations as the motion itself. At the bow, a change ``dv_h`` of
what arrives changes the friction force by ``df = -dv_h (1 - d)/Y``. Sticking, d is 0. Slipping on the hyperbola,
``d = (s + a)/(2 s + a + A - |D|)``, the derivative of the law in :mod:`bow_sim.physics.friction`. Steps at which the
string begins or ends to slip do not move under an infinitesimal change.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from bow_sim.physics.body import resonators
from bow_sim.physics.reflection import Body, Ends
from bow_sim.physics.reflection_text import Reflection
from bow_sim.simd.jit import njit, part


class Side(NamedTuple):
    """A reflection function for :func:`advance`; fields as in :class:`bow_sim.physics.reflection_text.Reflection`."""

    taps: Any
    first: int
    tail: float
    pole: float
    tail_first: int
    tail_taps: Any


class Modes(NamedTuple):
    """The body at the bridge for :func:`advance`; arrays of shape (modes,). PHYSICS.md section 11 has the names."""

    b0: Any
    a1: Any
    a2: Any
    sum_b: float
    den: float
    rho: float
    gain: float
    pole: float


class Tangent(NamedTuple):
    """A linearised motion.

    Parameters
    ----------
    growth : ndarray, shape (periods,)
        Natural logarithm of the norm after each period over that after the period before. The first, of the period of
        the kick, is the logarithm of the norm itself.
    force : ndarray, shape (periods * period,)
        The outgoing wave to the bridge. In period n it is in units of the norm after period n - 1.
    """

    growth: NDArray[np.float64]
    force: NDArray[np.float64]


def slope(a: float, slide: float, s: ArrayLike, d: ArrayLike, f_b: ArrayLike, slipping: ArrayLike) -> NDArray[Any]:
    """Return dv/dv_h under the bow, for the hyperbola; arrays are over samples.

    Parameters
    ----------
    a, slide : float
        As in :class:`bow_sim.physics.friction.Hyperbola`: ``v_b - v_mid``, and ``Y mu_d``.
    s, d : array_like
        Slip speed ``v_b - v``, and ``v_b - v_h``, with their signs.
    f_b : array_like
        Bow force.
    slipping : array_like of bool
    """
    size, x = np.abs(np.asarray(s, float)), np.abs(np.asarray(d, float))
    with np.errstate(divide="ignore", invalid="ignore"):
        sliding = (size + a) / (2 * size + a + np.asarray(f_b, float) * slide - x)
    return np.where(slipping, sliding, 0.0)


def follow(ends: Ends, period: int, slopes: ArrayLike, kick: ArrayLike, fallen: float = math.inf) -> Tangent:
    """Compute the linearised motion that a small force under the bow leaves.

    Parameters
    ----------
    ends : Ends
        The string.
    period : int
        Nominal period, samples. Each period the norm, the r.m.s. of both outgoing transverse waves, is made 1.
    slopes : array_like, shape (samples,)
        :func:`slope` of the real motion.
    kick : array_like, shape (period,)
        Friction force added in the first period. A force, not a state: a random state would move the ends of the string
        against each other, which does not decay.
    fallen : float
        Stop where the norm has fallen by exp(fallen).

    Returns
    -------
    Tangent
        Of the whole periods in `slopes`, or as many as it took.
    """
    rows = np.ascontiguousarray(slopes, np.float64)
    sides = tuple(_side(r) for r in (ends.bridge, ends.nut, ends.torsion_bridge, ends.torsion_nut))
    modes = _modes(ends.body)
    length = max(r.last for r in (ends.bridge, ends.nut, ends.torsion_bridge, ends.torsion_nut))
    growth, force = np.zeros(len(rows) // period), np.zeros(len(rows) // period * period)
    state = (np.zeros((4, length)), np.zeros(4), np.zeros((2, len(modes.b0))), np.zeros(2))
    shares = (ends.y, ends.y_t / 2 / ends.y, ends.y_r / 2 / ends.y)
    blow = np.ascontiguousarray(kick, np.float64)
    done = advance(rows, blow, period, sides, modes, shares, state, fallen, growth, force)
    return Tangent(growth[:done], force[: done * period])


def _side(r: Reflection) -> Side:
    taps, tail_taps = np.array(r.taps, np.float64), np.array(r.tail_taps, np.float64)
    return Side(taps, int(r.first), float(r.tail), float(r.pole), int(r.tail_first), tail_taps)


def _modes(body: Body | None) -> Modes:
    if body is None:
        nothing = np.zeros(0)
        return Modes(nothing, nothing, nothing, 0.0, 0.0, 0.0, 0.0, 0.0)
    b0, a1, a2 = (np.ascontiguousarray(x, np.float64) for x in resonators(body.modes, body.sample_rate))
    sum_b = math.fsum(b0)
    den = 1 / (1 + (1 + body.rho) * sum_b / 2)
    return Modes(b0, a1, a2, sum_b, den, float(body.rho), float(body.gain), float(body.pole))


@njit(nogil=True, cache=True, error_model="numpy", _nrt=False)
def advance(
    slopes: Any,
    kick: Any,
    period: Any,
    sides: Any,
    modes: Any,
    shares: Any,
    state: Any,
    fallen: Any,
    growth: Any,
    force: Any,
) -> Any:
    """Compute period after period; return how many. Called by :func:`follow`, which has the parameters.

    Parameters
    ----------
    sides : tuple of Side
        Bridge, nut, and both of torsion.
    modes : Modes
        Without any, the bridge reflects as its side says.
    shares : tuple of float
        ``Y``, ``Y_T/2Y``, ``Y_R/2Y``.
    state : tuple of ndarray
        Zeros, changed in place: outgoing waves as rings (4, greatest lag), tails (4,), modes (2, modes), and the sum of
        the first row of these with Cremer's tail (2,).
    growth, force : ndarray
        Changed in place, see `Tangent`.
    """
    y, share_t, share_r = shares
    rings, tails, z, others = state
    length, count = rings.shape[1], modes.b0.shape[0]
    total = 0.0
    for number in range(growth.shape[0]):
        squares = 0.0
        for u in range(period):
            t = number * period + u
            in_b = _arrive(sides[0], rings[0], tails, 0, t, length)
            in_n = _arrive(sides[1], rings[1], tails, 1, t, length)
            in_rb = _arrive(sides[2], rings[2], tails, 2, t, length)
            in_rn = _arrive(sides[3], rings[3], tails, 3, t, length)
            if count:
                in_b = _reflect(modes, z, others, in_b)
            push = (slopes[t] - 1.0) * (in_b + in_n + in_rb + in_rn)
            if not number:
                push += y * kick[u]
            at = t % length
            out_b, out_n = in_n + share_t * push, in_b + share_t * push
            rings[0, at], rings[1, at] = out_b, out_n
            rings[2, at], rings[3, at] = in_rn + share_r * push, in_rb + share_r * push
            force[t] = out_b
            squares += out_b * out_b + out_n * out_n
        norm = math.sqrt(squares / (2 * period))
        growth[number] = math.log(norm)
        if number:
            total += growth[number]
        if not norm > 0.0 or total < -fallen:
            return number + 1
        for side in range(4):
            for k in range(length):
                rings[side, k] /= norm
            tails[side] /= norm
        others[0] /= norm
        others[1] /= norm
        for k in range(count):
            z[0, k] /= norm
            z[1, k] /= norm
    return growth.shape[0]


@part(nogil=True, _nrt=False)
def _arrive(side: Any, ring: Any, tails: Any, which: Any, t: Any, length: Any) -> Any:
    """Return what arrives now from one side."""
    total = 0.0
    for k in range(side.taps.shape[0]):
        total += side.taps[k] * ring[(t - side.first - k) % length]
    if side.tail != 0.0:
        x = 0.0
        for k in range(side.tail_taps.shape[0]):
            x += side.tail_taps[k] * ring[(t - side.tail_first - k) % length]
        tails[which] = side.pole * tails[which] + side.tail * x
        total += tails[which]
    return total


@part(nogil=True, _nrt=False)
def _reflect(modes: Any, z: Any, others: Any, x: Any) -> Any:
    """Return what the body sends back (PHYSICS.md section 11)."""
    force = ((1.0 + modes.rho) * (x - others[0] / 2) + modes.gain * others[1]) * modes.den
    v_m = modes.sum_b * force + others[0]
    left = x - v_m / 2
    back = v_m / 2 - modes.rho * left - modes.gain * others[1]
    others[1] = modes.pole * others[1] + left
    total = 0.0
    for k in range(modes.b0.shape[0]):
        b = modes.b0[k] * force
        out = b + z[0, k]
        z[0, k] = z[1, k] - modes.a1[k] * out
        z[1, k] = -b - modes.a2[k] * out
        total += z[0, k]
    others[0] = total
    return back
