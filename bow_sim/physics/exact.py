"""Elementary functions with the same bits on every machine: the exact value of each, rounded once to float64.

The functions of a C library and of NumPy are not rounded correctly, and differ between libraries, their releases and
the processors that they find. What a waveform depends on is computed here, by MPFR: correctly rounded by definition.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import Any

import gmpy2
import numpy as np
from numpy.typing import NDArray

_DOUBLE = gmpy2.context(precision=53, emin=-1073, emax=1024, subnormalize=True)
"""The numbers of float64, subnormal ones too."""

_LONG = gmpy2.context(precision=200)
"""For results of several operations, which are rounded once at the end."""

_GREAT = 1e290
"""Products of numbers up to this one are made of halves."""


def exp(x: float) -> float:
    """Return e**x."""
    return float(_DOUBLE.exp(x))


def power(base: float, exponent: float) -> float:
    """Return base**exponent, base >= 0."""
    return float(_DOUBLE.pow(base, exponent))


def tan(x: float) -> float:
    """Return the tangent of x, in radians."""
    return float(_DOUBLE.tan(x))


def turn(x: float) -> tuple[float, float]:
    """Return cosine and sine of x, in radians."""
    sine, cosine = _DOUBLE.sin_cos(x)
    return float(cosine), float(sine)


def geometric(first: float, last: float, count: int) -> NDArray[np.float64]:
    """Return numbers from first to last, both > 0, each the same multiple of the one before; shape (count,).

    Each is a product of two numbers of 106 bits, rounded once: so few exponentials do for millions of numbers.
    """
    start = _LONG.log(first)
    share = gmpy2.mpq(1, max(count - 1, 1))  # div() has the precision of the thread's own context before gmpy2 2.3
    step = _LONG.mul(_LONG.sub(_LONG.log(last), start), share)
    if max(first, last) > _GREAT or min(first, last) < 1 / _GREAT:  # products of halves are no numbers then
        values = np.array([float(_LONG.exp(_LONG.add(start, _LONG.mul(step, k)))) for k in range(count)])
    else:
        size = math.isqrt(count) + 1
        coarse = _pairs(_LONG.exp(_LONG.add(start, _LONG.mul(step, size * k))) for k in range(size))
        fine = _pairs(_LONG.exp(_LONG.mul(step, k)) for k in range(size))
        with np.errstate(all="ignore"):  # beyond the last one
            values = _product(coarse[:, :, None], fine[:, None, :]).ravel()[:count]
    values[0] = first
    if count > 1:
        values[-1] = last
    return values


def _pairs(numbers: Iterable[Any]) -> NDArray[np.float64]:
    """Return numbers as sums of a float64 and a small one, shape (2, numbers)."""
    high_low = [(high := float(x), float(_LONG.sub(x, high))) for x in numbers]
    return np.array(high_low).T


def _product(a: NDArray[np.float64], b: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the products of pairs, each rounded once, by Dekker's method (1971)."""
    (a_1, a_2), (b_1, b_2) = _halves(a[0]), _halves(b[0])
    near = a[0] * b[0]
    error = ((a_1 * b_1 - near) + a_1 * b_2 + a_2 * b_1) + a_2 * b_2
    return np.asarray(near + (error + (a[0] * b[1] + a[1] * b[0])))


def _halves(x: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return numbers as sums of two whose products are exact."""
    far = x * 134217729.0  # 2**27 + 1
    upper = far - (far - x)
    return upper, x - upper


def inverse_real_fft(real: NDArray[np.float64], imag: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the real sequence of a spectrum, as `numpy.fft.irfft`, by additions and multiplications in a fixed order.

    Real and imaginary parts are apart, as a processor may fuse the operations of a complex product.

    Parameters
    ----------
    real, imag : ndarray, shape (size // 2 + 1,)
        From frequency 0 to half the sample rate; size is a power of two. The imaginary parts at both ends are ignored.

    Returns
    -------
    ndarray, shape (size,)
    """
    half = len(real) - 1
    size = 2 * half
    a: Any = np.concatenate([real, real[half - 1 : 0 : -1]]).reshape(size, 1)
    b: Any = np.concatenate([[0.0], imag[1:half], [0.0], -imag[half - 1 : 0 : -1]]).reshape(size, 1)
    turns: Any = np.array([turn(2 * math.pi * k / size) for k in range(half)]).T
    while len(a) > 1:  # row r is the sequence of every len(a)-th frequency from r on; rows are joined in pairs
        rows, length = len(a) // 2, a.shape[1]
        c, s = turns[:, :: half // length]
        x, y = a[rows:] * c - b[rows:] * s, a[rows:] * s + b[rows:] * c
        a = np.concatenate([a[:rows] + x, a[:rows] - x], axis=1)
        b = np.concatenate([b[:rows] + y, b[:rows] - y], axis=1)
    return np.asarray(a[0]) / size
