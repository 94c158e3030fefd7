"""Elementary functions for compiled code, with the same bits on every machine.

A compiler takes these functions from the C library, whose last bit differs between releases and processors. Here they
are polynomials: every operation is exactly rounded and none is fused. They are right to about 1e-15.
"""

from __future__ import annotations

import math

from bow_sim.simd.jit import part
from bow_sim.simd.options import LEAN

_LN2 = 0.6931471805599453
_LN2_HIGH = float.fromhex("0x1.62e42fee00000p-1")
"""The first 33 bits of log 2: its products with whole numbers below 2**20 are exact."""
_LN2_LOW = float.fromhex("0x1.a39ef35793c76p-33")

_MOST = 700.0
"""exp(x) is computed as that of the nearest x in -_MOST ... _MOST."""


@part(**LEAN)
def exp_parts(x):
    """Return k and r so that e**x is 2**k e**r, r within half of log 2."""
    x = min(_MOST, max(-_MOST, x))
    k = math.floor(x / _LN2 + 0.5)
    return int(k), (x - k * _LN2_HIGH) - k * _LN2_LOW


@part(**LEAN)
def exp_series(r):
    """Return e**r of a number or of lanes, within half of log 2."""
    total = r / 16.0 + 1.0
    for n in range(15, 0, -1):
        total = r / n * total + 1.0
    return total


@part(**LEAN)
def exp(x):
    """Return e**x."""
    k, r = exp_parts(x)
    return math.ldexp(exp_series(r), k)


@part(**LEAN)
def log_parts(x):
    """Return k and m so that x > 0 is 2**k m, m from 0.7 to 1.4."""
    m, k = math.frexp(x)
    return (k - 1, 2.0 * m) if m < 0.7 else (k, m)


@part(**LEAN)
def log_series(k, m):
    """Return the natural logarithm of 2**k m, of numbers or of lanes, m from 0.7 to 1.4."""
    s = (m - 1.0) / (m + 1.0)
    total = s * s * 0.0 + 1.0 / 25
    for n in range(23, 0, -2):
        total = total * (s * s) + 1.0 / n
    return k * _LN2 + s * 2.0 * total


@part(**LEAN)
def log(x):
    """Return the natural logarithm of x > 0."""
    return log_series(*log_parts(x))


@part(**LEAN)
def turn(x):
    """Return cosine and sine of x, in radians, -2 pi ... 2 pi."""
    h = x / 16.0
    c = s = 1.0
    for n in range(14, 0, -2):
        c, s = 1.0 - h * h / (n * (n - 1)) * c, 1.0 - h * h / (n * (n + 1)) * s
    s *= h
    for _ in range(4):
        c, s = (c - s) * (c + s), 2.0 * c * s
    return c, s
