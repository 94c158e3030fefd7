"""Limits and frequencies in closed form, to compare with: sections 8, 9 and 11 of PHYSICS.md. Units of the paper."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from bow_sim.physics.body import modes
from bow_sim.physics.friction import sliding_coefficient
from bow_sim.physics.parameters import Parameters
from bow_sim.physics.reflection import ends

HARMONICS = 60
"""Terms of the sums of :func:`least_force`."""

TIMES = 2048
"""Moments in a period at which its first sum is looked at."""


def fall_of_friction(p: Parameters) -> float:
    """Return mu_s minus the friction coefficient at the slip speed of Helmholtz motion, v_b (1/beta - 1); hyperbola."""
    slip = np.array([p.v_b * (1 / p.beta - 1)])
    return p.mu_s - float(sliding_coefficient(slip, p.mu_s, p.mu_d, p.v_b - p.v_mid)[0])


def greatest_force(p: Parameters) -> float:
    """Return Schelleng's maximum bow force, ``v_b/(Y beta (mu_s - mu_d))`` (PHYSICS.md section 8)."""
    return p.v_b / (float(ends(p).y) * p.beta * (p.mu_s - p.mu_d))


def admittance(p: Parameters, w: NDArray[np.float64]) -> NDArray[np.complex128]:
    """Return the admittance of the bridge times Z_0: Cremer's part and the modes of the body (PHYSICS.md section 11).

    Parameters
    ----------
    w : ndarray
        Angular frequencies, radians a sample.
    """
    s, corner = 1j * w, p.bridge_w_c * 2 * math.pi / p.period
    y = np.asarray(s / (p.bridge_r * (s + corner)), np.complex128)
    for f, q, kappa in modes(p.body, p.body_modes, p.sample_rate, p.period, p.z_0, p.body_scale):
        own = 2 * math.pi * f / p.sample_rate
        y = y + kappa * own * s / (s * s + s * own / q + own * own)
    return y


def least_force(p: Parameters) -> float:
    """Return Schelleng's minimum force with the admittance of the bridge (Woodhouse 1993; PHYSICS.md section 11)."""
    n = np.arange(1, HARMONICS + 1)
    y = admittance(p, n * 2 * math.pi / p.period) / n**2
    turns = np.exp(2j * math.pi * np.outer(np.arange(TIMES) / TIMES, n))
    first = float((turns @ ((-1.0) ** (n + 1) * y)).real.max())
    z_0 = 1 / p.y_t
    return 2 * p.v_b * z_0 / (math.pi**2 * p.beta**2 * fall_of_friction(p)) * (first + float(y.real.sum()))


def guettler_bounds(beta: float, mu_s: float, mu_d: float) -> tuple[float, float]:
    """Return Guettler's least and greatest acceleration for a bow force of 1, v_b a period (PHYSICS.md section 9)."""
    root = 2 * math.sqrt(2 * mu_s**2 - mu_s * mu_d)
    low = beta * (1 - beta) * (3 * mu_s - mu_d - root)
    root = 2 * math.sqrt((1 - 2 * beta) * (2 * (1 - beta) * mu_s**2 - mu_s * mu_d))
    high = beta * (1 - beta) * ((3 - 4 * beta) * mu_s - mu_d - root) / (1 - 2 * beta)
    z_0 = 0.5
    return low / z_0, high / z_0


def split_frequencies(f_0: float, q: float, kappa: float) -> tuple[float, float]:
    """Return the two frequencies of a string and a mode of the body of the same frequency; equal where they are one."""
    apart = math.sqrt(max(0.0, kappa / (2 * math.pi) - 1 / (16 * q * q)))
    return f_0 * (1 - apart), f_0 * (1 + apart)
