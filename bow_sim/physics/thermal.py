"""Friction that falls with the temperature of the contact (PHYSICS.md section 13)."""

from __future__ import annotations

from typing import Any, NamedTuple

from bow_sim.simd.lanes import absolute, choose, negative, root
from bow_sim.simd.signs import with_sign


class Thermal(NamedTuple):
    """Friction that falls with the temperature of the contact (PHYSICS.md section 13).

    Parameters
    ----------
    y : ndarray, shape (lanes,)
        Admittance at the bow.
    mu_s, share, t_g : ndarray, shape (lanes,)
        ``mu(T) = mu_s (1 + share q)/(1 + q)`` with ``q = (T/t_g)**2``; t_g in K.
    speed : ndarray, shape (lanes,)
        m/s for a speed of 1.
    load : ndarray, shape (lanes,)
        ``2 Z_0 V/W`` where y_t is 2: newton per metre of ribbon for a bow force of 1.
    step : ndarray, shape (lanes,)
        ``dt/a_T``: time step over heat capacity.
    flow, rest : ndarray, shape (lanes,)
        ``b_T`` and ``c_T``: cooling while slipping, and always.
    temperature : ndarray, shape (lanes,)
        State: above that of the room, K.
    """

    y: Any
    mu_s: Any
    share: Any
    t_g: Any
    speed: Any
    load: Any
    step: Any
    flow: Any
    rest: Any
    temperature: Any


def thermal(law: Thermal, d: Any, f_b: Any) -> tuple[Any, Any, Any]:
    """Solve string and thermal friction for one step.

    Parameters
    ----------
    law : Thermal
        Of numbers, arrays, or, in compiled code, lanes.
    d, f_b : float or array
        As in :func:`bow_sim.physics.friction.hyperbola`.

    Returns
    -------
    s, slipping : float or array, bool or array
        As in :func:`bow_sim.physics.friction.hyperbola`.
    temperature : float or array
        After this step, K.
    """
    y, mu_s, share, t_g, speed, load_, step, flow, rest, t = law
    x = absolute(d)
    pressed = f_b > 0.0
    per_metre = choose(pressed, load_ * f_b, 1.0)
    s, after = x, t
    for _ in range(2):  # the second time with the mean temperature of the step
        q = (t + after) * 0.5 / t_g
        q = q * q
        m = mu_s * (1.0 + share * q) / (1.0 + q)
        s = x - y * f_b * m
        s = choose(s > 0.0, s, 0.0)
        u = s * speed
        cooling = choose(pressed, flow * root(u / per_metre), 0.0) + rest
        r = cooling * step
        left = 1.0 / (1.0 + r * (1.0 + r * (0.5 + r * (1.0 / 6.0))))  # exp(-r), of exactly rounded operations
        heated = choose(pressed, m * u / cooling, 0.0)
        after = heated + (t - heated) * left
    return with_sign(s, d), negative(0.0 - s), after
