"""Schelleng's limits of bow force, for numbers and for arrays (PHYSICS.md sections 9 and 11).

Both limits have the form ``F (mu_s - mu) = k``: with k from :func:`greatest` the force at which the string is still
released once a period, with another k the least force. Here `mu` is the friction of sliding. A law whose friction
depends on the force itself, as that of warm rosin does, makes this an equation for F; it has one solution.

Every operation is exactly rounded, so a limit has the same bits wherever a cell stands in an array.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from bow_sim.physics.friction_curve import parse

HALVINGS = 128
"""Of the temperature of warm rosin: more than its bits need."""


def greatest(law: str, values: Mapping[str, Any], y: Any) -> Any:
    """Return Schelleng's maximum, ``v_b/(Y beta (mu_s - mu))``: above it the Helmholtz corner cannot free the string.

    Parameters
    ----------
    law : str
        Name of the friction law, as in :data:`bow_sim.physics.parameters.FRICTIONS`.
    values : Mapping
        Parameters by name, numbers or arrays of one shape; a curve of one's own, `friction_curve`, as text.
    y : float or ndarray
        Driving-point admittance of the infinite string at the bow, Y.

    Returns
    -------
    float or ndarray
        Bow force in the units of section 1. mu is mu_d, and with thermal friction that of steady sliding at the slip
        speed of Helmholtz motion.
    """
    return force_for(law, values, values["v_b"] / (y * beta(values)), whole=True)


def beta(values: Mapping[str, Any]) -> Any:
    """Return the position of the bow over the length of the string."""
    return (values["bow_bridge"] + values["bow_offset"]) / values["period"]


def slip_speed(values: Mapping[str, Any]) -> Any:
    """Return the slip speed of Helmholtz motion, ``v_b (1/beta - 1)``."""
    return values["v_b"] * (1 / beta(values) - 1)


def force_for(law: str, values: Mapping[str, Any], k: Any, whole: bool = False) -> Any:
    """Return the force F with ``F (mu_s - mu) = k``, mu of the slip speed of Helmholtz motion.

    Parameters
    ----------
    law, values
        As in :func:`greatest`.
    k : float or ndarray
        Force times difference of friction.
    whole : bool
        Whether the friction that does not depend on temperature has fallen to mu_d, whatever the slip speed.
    """
    if law == "thermal":
        return _force_of_warm_rosin(values, k)
    return k / difference(law, values, whole)


def difference(law: str, values: Mapping[str, Any], whole: bool = False) -> Any:
    """Return ``mu_s - mu`` of a law that does not depend on the force; parameters as in :func:`force_for`."""
    fall = values["mu_s"] - values["mu_d"]
    if whole or law not in ("hyperbola", "curve"):
        return fall
    slip = slip_speed(values)
    if law == "curve":
        unit = np.where(np.asarray(values["v_unit"]) > 0, values["v_unit"], 1.0)
        return values["mu_s"] - parse(values["friction_curve"]).at(slip * unit)
    return fall * slip / (values["v_b"] - values["v_mid"] + slip)


def _force_of_warm_rosin(values: Mapping[str, Any], k: Any) -> Any:
    """Return F for thermal friction (PHYSICS.md section 13), from the temperature T of steady sliding.

    As T rises, mu falls, so F falls and with it the heating mu u: ``C(F) T - mu(T) u`` rises, and has one zero.
    """
    mu_s, hot, t_g = values["mu_s"], values["rosin_hot"], values["rosin_t_g"]
    flow, rest = values["rosin_flow"], values["rosin_rest"]
    u = slip_speed(values) * values["v_unit"]
    per_metre = values["y_t"] * values["z_0"] * values["v_unit"] / values["ribbon_width"]
    low, high = u * 0.0, mu_s * u / rest
    force = high
    for _ in range(HALVINGS):
        t = (low + high) / 2
        q = t / t_g
        q = q * q
        mu = mu_s * (1 + hot * q) / (1 + q)
        fall = np.maximum(mu_s - mu, 1e-300)  # above 0 also at a temperature that rounds to none
        force = k / fall
        cold = (flow * np.sqrt(u / (per_metre * force)) + rest) * t < mu * u
        low, high = np.where(cold, t, low), np.where(cold, high, t)
    return force
