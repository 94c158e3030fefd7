"""Limits and frequencies in closed form, to compare with: sections 8, 9 and 11 of PHYSICS.md. Units of the paper."""

from __future__ import annotations

import math

from bow_sim.physics import schelleng
from bow_sim.physics.parameters import Parameters
from bow_sweep.maps.limits import schelleng_max, schelleng_min


def fall_of_friction(p: Parameters) -> float:
    """Return mu_s minus the friction coefficient at the slip speed of Helmholtz motion, v_b (1/beta - 1)."""
    return float(schelleng.difference(p.friction, vars(p)))


def greatest_force(p: Parameters) -> float:
    """Return Schelleng's maximum bow force (PHYSICS.md section 9)."""
    return float(schelleng_max([p])[0][0])


def least_force(p: Parameters) -> float:
    """Return Schelleng's minimum force with the admittance of the bridge (Woodhouse 1993; PHYSICS.md section 11).

    Raises
    ------
    ValueError
        For a bridge without losses, which has none.
    """
    found = schelleng_min([p])
    if found is None:
        raise ValueError("the bridge has no losses, or its admittance is not known: there is no least force")
    return float(found[0][0])


def split_frequencies(f_0: float, q: float, kappa: float) -> tuple[float, float]:
    """Return the two frequencies of a string and a mode of the body of the same frequency; equal where they are one."""
    apart = math.sqrt(max(0.0, kappa / (2 * math.pi) - 1 / (16 * q * q)))
    return f_0 * (1 - apart), f_0 * (1 + apart)
