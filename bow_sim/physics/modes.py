"""Linear analysis of the string: impulse response, mode frequencies and Q factors (paper section III.A, Figs 2-4).

A round trip of the string multiplies a wave by ``H_1(z) H_2(z)``, so the modes are the roots of ``H_1(z) H_2(z) = 1``.
A reflection function of taps and an exponential tail is a ratio of polynomials in 1/z, so these are the roots of a
polynomial, found to the accuracy of float64 and not read from an FFT. A mode at ``z = exp((-s + i w)/f_s)`` has the
frequency ``w/2 pi`` and ``Q = w/2s``.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from bow_sim.physics.parameters import Parameters
from bow_sim.physics.reflection import ends
from bow_sim.physics.reflection_text import Reflection

LOSSLESS = 1e-13
"""Loss a sample below which a root lies on the unit circle within rounding."""

NEWTON_STEPS = 4
"""Steps that improve a root from the accuracy of an eigenvalue to that of float64."""


class Modes(NamedTuple):
    """The modes of one kind of wave, in the order of their number.

    Parameters
    ----------
    number : ndarray of int, shape (modes,)
        Wavelengths in a round trip: 1 is the fundamental.
    frequency : ndarray, shape (modes,)
        Hz.
    q : ndarray, shape (modes,)
        Q factor; infinite for a mode without loss.
    """

    number: NDArray[np.int64]
    frequency: NDArray[np.float64]
    q: NDArray[np.float64]


def ratio(reflection: Reflection) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return a reflection function as a ratio of polynomials in 1/z.

    Returns
    -------
    numerator, denominator : ndarray, shape (powers,)
        Coefficients of ``z**0, z**-1, ...``.
    """
    numerator = np.zeros(reflection.first + len(reflection.taps))
    numerator[reflection.first :] = reflection.taps
    if not reflection.tail:
        return numerator, np.ones(1)
    denominator = np.array([1.0, -reflection.pole])
    numerator = np.convolve(numerator, denominator)
    tail = np.zeros(max(len(numerator), reflection.tail_first + 1))
    tail[reflection.tail_first] = reflection.tail
    tail[: len(numerator)] += numerator
    return tail, denominator


def impulse_response(one: Reflection, other: Reflection, admittance: float, samples: int) -> NDArray[np.float64]:
    """Return samples of g(t), the velocity at the bow after a unit impulse of force there, by equation (5).

    The series ``h_1 + h_2 + 2 h_1*h_2 + h_1*h_2*h_1 + ...`` is summed exactly: with the delta function of equation (1)
    it is ``(1 + H_1)(1 + H_2)/(1 - H_1 H_2)``, run as a recurrence.

    Parameters
    ----------
    one, other : Reflection
        The two ends.
    admittance : float
        Characteristic admittance Y_0 of the wave; the impulse itself is ``Y_0/2``.
    samples : int

    Returns
    -------
    ndarray, shape (samples,)
    """
    (n_1, d_1), (n_2, d_2) = ratio(one), ratio(other)
    forward = np.convolve(_sum(d_1, n_1), _sum(d_2, n_2)) * (admittance / 2)
    back = _sum(np.convolve(d_1, d_2), -np.convolve(n_1, n_2))
    memory = len(back) - 1
    g = np.zeros(memory + samples)  # at rest before t = 0
    backwards = back[:0:-1]
    for t in range(samples):
        x = forward[t] if t < len(forward) else 0.0
        g[memory + t] = x - backwards @ g[t : memory + t]
    return g[memory:]


def transverse_response(p: Parameters, samples: int) -> NDArray[np.float64]:
    """Return g(t) of transverse waves, Figs 2(a) and 2(b); shape (samples,)."""
    e = ends(p)
    return impulse_response(e.bridge, e.nut, e.y_t, samples)


def torsional_response(p: Parameters, samples: int) -> NDArray[np.float64]:
    """Return g(t) of torsional waves, Fig 2(c); shape (samples,)."""
    e = ends(p)
    return impulse_response(e.torsion_bridge, e.torsion_nut, e.y_r, samples)


def modes(one: Reflection, other: Reflection, sample_rate: float, count: int) -> Modes:
    """Return the first modes of waves between two ends.

    Parameters
    ----------
    one, other : Reflection
        The two ends.
    sample_rate : float
        Hz.
    count : int
        Modes wanted; fewer are returned where the string has fewer.

    Returns
    -------
    Modes
    """
    (n_1, d_1), (n_2, d_2) = ratio(one), ratio(other)
    roots = _polished(_sum(np.convolve(d_1, d_2), -np.convolve(n_1, n_2)))
    roots = roots[(roots.imag > 0) & (np.abs(roots) > 0)]
    number = _numbers(one, other, np.angle(roots))
    found: dict[int, complex] = {}
    for n, z in zip(number.tolist(), roots.tolist(), strict=True):
        # a long reflection function has strongly damped roots of its own between the modes
        if 1 <= n <= count and (n not in found or abs(z) > abs(found[n])):
            found[n] = z
    chosen = np.array(sorted(found), dtype=np.int64)
    z = np.array([found[n] for n in sorted(found)], dtype=np.complex128)
    w, s = np.angle(z), -np.log(np.abs(z))
    lossy = s > LOSSLESS
    q = np.where(lossy, w / (2 * np.where(lossy, s, 1.0)), math.inf)
    return Modes(chosen, w * sample_rate / (2 * math.pi), q)


def transverse_modes(p: Parameters, count: int = 30) -> Modes:
    """Return the first transverse modes of a model, Figs 3 and 4."""
    e = ends(p)
    return modes(e.bridge, e.nut, p.sample_rate, count)


def torsional_modes(p: Parameters, count: int = 8) -> Modes:
    """Return the first torsional modes of a model (section III.A)."""
    e = ends(p)
    return modes(e.torsion_bridge, e.torsion_nut, p.sample_rate, count)


def gaussian_q(number: NDArray[np.int64], p: Parameters) -> NDArray[np.float64]:
    """Return Q of torsional modes by the continuous Gaussian (Appendix).

    A round trip multiplies a wave by ``gain**2 exp(-(w tau)**2/2)``.

    Parameters
    ----------
    number : ndarray of int, shape (modes,)
    p : Parameters

    Returns
    -------
    ndarray, shape (modes,)
    """
    w = 2 * np.pi * number * p.torsion_speed / p.period
    loss = -2 * math.log(p.torsion_gain) + (w * p.torsion_width) ** 2 / 2
    return np.asarray(np.pi * number / loss)


def cremer_q(number: NDArray[np.int64], p: Parameters) -> NDArray[np.float64]:
    """Return Q of transverse modes by the continuous spring and dashpot (PHYSICS.md section 3).

    It is ``n pi R/2 (1 + (w_c/w_n)**2)``.

    Parameters
    ----------
    number : ndarray of int, shape (modes,)
    p : Parameters

    Returns
    -------
    ndarray, shape (modes,)
    """
    return np.asarray(number * np.pi * p.bridge_r / 2 * (1 + (p.bridge_w_c / number) ** 2))


def _sum(a: NDArray[np.float64], b: NDArray[np.float64]) -> NDArray[np.float64]:
    """Add two polynomials in 1/z."""
    total = np.zeros(max(len(a), len(b)))
    total[: len(a)] = a
    total[: len(b)] += b
    return total


def _polished(polynomial: NDArray[np.float64]) -> NDArray[np.complex128]:
    """Return the roots z of a polynomial in 1/z, by eigenvalues and then Newton's method."""
    z = np.roots(polynomial).astype(np.complex128)
    z = z[np.abs(z) > 1e-3]  # a root that decays within a sample is no mode, and 1/z must not overflow
    slope = -polynomial[1:] * np.arange(1, len(polynomial))
    for _ in range(NEWTON_STEPS):
        step = 1 / z
        f = np.polyval(polynomial[::-1], step)
        df = np.polyval(slope[::-1], step) * step * step
        with np.errstate(divide="ignore", invalid="ignore"):
            change = f / df
        z = np.where(np.isfinite(change) & (np.abs(change) < 1e-3), z - change, z)
    return z


def _numbers(one: Reflection, other: Reflection, w: NDArray[np.float64]) -> NDArray[np.int64]:
    """Return how often the phase of a round trip turns by 2 pi from w = 0 up to each frequency."""
    turns = 64 * (one.last + other.last)
    grid = np.linspace(0.0, math.pi, turns + 1)
    around = np.exp(1j * grid)
    phase = -np.unwrap(np.angle(one.response(around) * other.response(around)))
    return np.rint(np.interp(w, grid, phase - phase[0]) / (2 * math.pi)).astype(np.int64)
