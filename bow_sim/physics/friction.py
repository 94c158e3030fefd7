"""Friction laws (paper sections II.A, III.C and Appendix; PHYSICS.md section 4).

With slip speed ``s = v_b - v``, ``D = v_b - v_h``, ``S = Y f_b mu_s`` and ``A = Y f_b mu_d``, the straight line of the
string ``f = (D - s)/Y``, equation (3), meets the hyperbola ``f = f_b (mu_d + (mu_s - mu_d) a/(a + s))`` where
``s**2 + s (a + A - D) + a (S - D) = 0``.

A law is a named tuple of arrays over lanes. Numba chooses the code of :func:`solve` by the type of that tuple when it
compiles the kernel, so the kernel's source is the same for every law. A law with internal state, such as a temperature,
keeps it in an array of its tuple and changes it in `solve`.

A new law needs, in this file, a named tuple, an overload of :func:`solve` for it and an entry in :data:`LAWS`, and its
name in :data:`bow_sim.physics.parameters.FRICTIONS`; CONTRIBUTING.md has the whole recipe.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from numba import types
from numpy.typing import NDArray

from bow_sim.physics.cells import Cells
from bow_sim.physics.friction_curve import Points, parse
from bow_sim.physics.thermal import Thermal, thermal
from bow_sim.simd.jit import INLINE, OVERLOAD, overload, part
from bow_sim.simd.lanes import absolute, choose, negative, not_negative, read, root, write
from bow_sim.simd.signs import with_sign


class Hyperbola(NamedTuple):
    """The paper's law (Appendix, Fig 9): a rectangular hyperbola, with the hysteresis rule of section III.C.

    Parameters
    ----------
    a : ndarray, shape (lanes,)
        ``v_b - v_mid`` with the final bow speed v_b: the slip speed at which mu is midway.
    limit, slide : ndarray, shape (lanes,)
        ``Y mu_s`` and ``Y mu_d``; multiplied by f_b they are S and A.
    """

    a: Any
    limit: Any
    slide: Any


def hyperbola(a: Any, limit: Any, slide: Any, d: Any, f_b: Any, slipping: Any) -> tuple[Any, Any]:
    """Solve string and hyperbola for one step, with the hysteresis rule of section III.C.

    The same source is used for numbers, for arrays and, compiled, for the lanes of the kernel. Every operation is
    exactly rounded.

    Parameters
    ----------
    a, limit, slide : float or array
        As in :class:`Hyperbola`.
    d : float or array
        ``v_b - v_h``.
    f_b : float or array
        Bow force.
    slipping : bool or array
        State after the step before.

    Returns
    -------
    s : float or array
        Slip speed ``v_b - v``, with the sign of d; 0 when sticking.
    slipping : bool or array
        State after this step.
    """
    x = absolute(d)
    below = f_b * limit - x
    h = (a + f_b * slide - x) * 0.5
    square = h * h - a * below
    slips = negative(below) | (slipping & negative(h) & not_negative(square))
    s = root(square) - h
    return choose(slips, with_sign(s, d), 0.0), slips


class Coulomb(NamedTuple):
    """Two coefficients, without memory: sticks whenever it can (PHYSICS.md section 13; what Guettler 2002 assumes).

    Parameters
    ----------
    limit, slide : ndarray, shape (lanes,)
        ``Y mu_s`` and ``Y mu_d``.
    """

    limit: Any
    slide: Any


def coulomb(limit: Any, slide: Any, d: Any, f_b: Any) -> tuple[Any, Any]:
    """Solve string and Coulomb friction for one step; parameters and results as in :func:`hyperbola`."""
    x = absolute(d)
    slips = negative(f_b * limit - x)
    s = x - f_b * slide
    return choose(slips, with_sign(s, d), 0.0), slips


class Curve(NamedTuple):
    """A curve of one's own, by the hysteresis rule of section III.C (PHYSICS.md section 13).

    Parameters
    ----------
    load : ndarray, shape (lanes,)
        ``Y V``, with V as in `speed`.
    speed, unit : ndarray, shape (lanes,)
        Slip speed, in the units of the curve, for a speed of 1; and one over it.
    points : Points
        Common to all cells.
    """

    load: Any
    speed: Any
    unit: Any
    points: Points


def curve(load: Any, speed: Any, unit: Any, points: Any, d: Any, f_b: Any, slipping: Any) -> tuple[Any, Any]:
    """Solve string and curve for one step, exactly for the piece that the string's line meets.

    Parameters and results as in :class:`Curve` and :func:`hyperbola`. The slipping solution is on the last piece whose
    beginning the line has reached: beyond it the line is out of reach of friction.
    """
    x = absolute(d) * speed
    k = f_b * load
    most = k * points.mu[0]
    level, at, slope, end = most, x * 0.0, x * 0.0, x * 0.0
    for i in range(len(points.mu)):
        start = k * points.mu[i] + points.speed[i]
        reached = x >= start
        level = choose(reached, start, level)
        at = choose(reached, points.speed[i], at)
        slope = choose(reached, points.slope[i], slope)
        end = choose(reached, points.end[i], end)
    s = at + (x - level) / (k * slope + 1.0)
    s = choose(s < end, s, end)  # where a piece is almost parallel to the line, rounding could lead beyond it
    s = choose(s > at, s, at)
    slips = negative(most - x) | (slipping & negative(0.0 - s))
    s = s * unit
    return choose(slips, with_sign(s, d), 0.0), slips


_hyperbola, _coulomb, _thermal, _curve = (part(**INLINE)(law) for law in (hyperbola, coulomb, thermal, curve))


def _hyperbola_of_one(law: Any, lane: Any, d: Any, f_b: Any, slipping: Any) -> Any:
    """Solve for one cell: while the string sticks, a branch, which the processor predicts, leaves out the root."""
    limit = read(law.limit, lane, d)
    if not slipping and not negative(f_b * limit - absolute(d)):
        return 0.0, False
    return _hyperbola(read(law.a, lane, d), limit, read(law.slide, lane, d), d, f_b, slipping)


def solve(law: Any, lane: int, d: Any, f_b: Any, slipping: Any) -> tuple[Any, Any]:
    """Solve string and friction law for one step of eight lanes, or of one cell; in compiled code only.

    Parameters
    ----------
    law : NamedTuple
        Coefficients and internal state of a law, arrays of shape (lanes,).
    lane : int
        The first of the lanes; or a cell, where the arguments are numbers.
    d, f_b, slipping
        As in :func:`hyperbola`.

    Returns
    -------
    s, slipping
        As in :func:`hyperbola`.
    """
    raise NotImplementedError(f"no friction law for {type(law).__name__}: overload bow_sim.physics.friction.solve")


@overload(solve, strict=False, jit_options=OVERLOAD)
def _solve_hyperbola(law: Any, lane: Any, d: Any, f_b: Any, slipping: Any) -> Any:
    if getattr(law, "instance_class", None) is not Hyperbola:
        return None
    if isinstance(d, types.Float):
        return _hyperbola_of_one
    return lambda law, lane, d, f_b, slipping: _hyperbola(
        read(law.a, lane, d), read(law.limit, lane, d), read(law.slide, lane, d), d, f_b, slipping
    )


@overload(solve, strict=False, jit_options=OVERLOAD)
def _solve_coulomb(law: Any, lane: Any, d: Any, f_b: Any, slipping: Any) -> Any:
    if getattr(law, "instance_class", None) is not Coulomb:
        return None
    return lambda law, lane, d, f_b, slipping: _coulomb(read(law.limit, lane, d), read(law.slide, lane, d), d, f_b)


@overload(solve, strict=False, jit_options=OVERLOAD)
def _solve_thermal(law: Any, lane: Any, d: Any, f_b: Any, slipping: Any) -> Any:
    if getattr(law, "instance_class", None) is not Thermal:
        return None

    def solve_thermal(law: Any, lane: Any, d: Any, f_b: Any, slipping: Any) -> Any:
        values = (
            read(law.y, lane, d),
            read(law.mu_s, lane, d),
            read(law.share, lane, d),
            read(law.t_g, lane, d),
            read(law.speed, lane, d),
            read(law.load, lane, d),
            read(law.step, lane, d),
            read(law.flow, lane, d),
            read(law.rest, lane, d),
            read(law.temperature, lane, d),
        )
        s, slips, after = _thermal(values, d, f_b)
        write(law.temperature, lane, after)
        return s, slips

    return solve_thermal


@overload(solve, strict=False, jit_options=OVERLOAD)
def _solve_curve(law: Any, lane: Any, d: Any, f_b: Any, slipping: Any) -> Any:
    if getattr(law, "instance_class", None) is not Curve:
        return None
    return lambda law, lane, d, f_b, slipping: _curve(
        read(law.load, lane, d), read(law.speed, lane, d), read(law.unit, lane, d), law.points, d, f_b, slipping
    )


def state_of(law: Any, lane: int, like: Any) -> tuple[Any, ...]:
    """Return the internal state of a law as waveforms of a step, a tuple of lanes or numbers; compiled code only."""
    raise NotImplementedError


@overload(state_of, strict=False, jit_options=OVERLOAD)
def _overload_state_of(law: Any, lane: Any, like: Any) -> Any:
    if getattr(law, "instance_class", None) is Thermal:
        return lambda law, lane, like: (read(law.temperature, lane, like),)
    return lambda law, lane, like: ()


def hyperbola_of(cells: Cells) -> Hyperbola:
    """Return the hyperbola of each cell, arrays of shape (cells,)."""
    y = cells.bow_admittance()
    return Hyperbola(cells.value("v_b") - cells.value("v_mid"), y * cells.value("mu_s"), y * cells.value("mu_d"))


def coulomb_of(cells: Cells) -> Coulomb:
    """Return Coulomb's law for each cell, arrays of shape (cells,)."""
    y = cells.bow_admittance()
    return Coulomb(y * cells.value("mu_s"), y * cells.value("mu_d"))


def thermal_of(cells: Cells) -> Thermal:
    """Return the thermal law of each cell, arrays of shape (cells,), at the temperature of the room."""
    speed = cells.value("v_unit")
    return Thermal(
        y=cells.bow_admittance(),
        mu_s=cells.value("mu_s"),
        share=cells.value("rosin_hot"),
        t_g=cells.value("rosin_t_g"),
        speed=speed,
        load=cells.of_ends("y_t") * cells.value("z_0") * speed / cells.value("ribbon_width"),
        step=1 / (cells.value("sample_rate") * cells.value("rosin_heat")),
        flow=cells.value("rosin_flow"),
        rest=cells.value("rosin_rest"),
        temperature=np.zeros(cells.count),
    )


def curve_of(cells: Cells) -> Curve:
    """Return the law of a curve of one's own, arrays of shape (cells,); the points are common to all cells."""
    given = cells.value("v_unit")
    speed = np.where(given > 0, given, 1.0)
    return Curve(cells.bow_admittance() * speed, speed, 1 / speed, parse(cells.parameters.friction_curve))


LAWS: dict[str, Callable[[Cells], Any]] = {
    "hyperbola": hyperbola_of,
    "coulomb": coulomb_of,
    "thermal": thermal_of,
    "curve": curve_of,
}
"""Name of a law, as in :data:`bow_sim.physics.parameters.FRICTIONS` -> what makes it for cells."""


def law_of(cells: Cells) -> Any:
    """Return the friction law that ``parameters.friction`` names, a named tuple of arrays of shape (cells,)."""
    return LAWS[cells.parameters.friction](cells)


def sliding_coefficient(s: NDArray[np.float64], mu_s: float, mu_d: float, a: float) -> NDArray[np.float64]:
    """Return the coefficient of sliding friction at slip speeds ``s >= 0``, shape of s (Appendix, Fig 9).

    Parameters
    ----------
    s : ndarray
        Slip speed, in units of the bow speed.
    mu_s, mu_d : float
        Coefficients on the point of sticking and at high speed.
    a : float
        ``v_b - v_mid``, the slip speed at which the coefficient is midway.
    """
    return mu_d + (mu_s - mu_d) * a / (a + s)


def sticking_limit(f_b: float, y: float, mu_s: float, v_b: float) -> float:
    """Return v_1: sticking ends when v_h falls below it (Figs 1, 7)."""
    return v_b - y * f_b * mu_s


def slipping_limit(f_b: float, y: float, mu_s: float, mu_d: float, a: float, v_b: float) -> float:
    """Return v_2: slipping ends when v_h rises above it; equal to v_1 without hysteresis (Figs 1, 7)."""
    limit, slide = y * f_b * mu_s, y * f_b * mu_d
    if limit - slide <= a:
        return v_b - limit
    return v_b - (slide - a + 2 * math.sqrt(a * (limit - slide)))


def ambiguous_force(y: float, mu_s: float, mu_d: float, a: float) -> float:
    """Return the bow force above which there is hysteresis: ``Y f_b (mu_s - mu_d) > a`` (PHYSICS.md section 4)."""
    return a / (y * (mu_s - mu_d))
