"""Limits that the theory predicts, as curves in the plane of a map (PHYSICS.md sections 9, 11 and 14).

A map has them where one axis is bow force and the other one moves them: Schelleng's maximum and minimum for a bow at
constant speed, Guettler's two bounds of acceleration for a bow that is accelerated. Where the other axis moves neither
limit, as in the paper's own plane, there is no curve and none is made.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Iterable, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from bow_sim.physics import body, schelleng
from bow_sim.physics.errors import ParameterError
from bow_sim.physics.instruments import ACCELERATED
from bow_sim.physics.parameters import FIELDS, FLOATS, Parameters
from bow_sim.physics.reflection import CREMER
from bow_sweep.maps.plane import Plane

HARMONICS = 60
"""Harmonics of the bridge force in Schelleng's minimum."""

INSTANTS = 4096
"""Instants of a period at which its greatest value is looked for."""

FORCES = ("f_asym", "force")
ACCELERATIONS = ("acceleration", "bow_acceleration")

MOST_POINTS = 512
"""Points of a curve, at most."""

STILL = 1e-9
"""Relative change along an axis below which a limit does not move."""

TITLES = {
    "schelleng_max": "Schelleng's maximum",
    "schelleng_min": "Schelleng's minimum",
    "guettler_low": "Guettler's least acceleration",
    "guettler_high": "Guettler's greatest acceleration",
}
LABELS = {"schelleng_max": "F_max", "schelleng_min": "F_min", "guettler_low": "a_low", "guettler_high": "a_high"}
"""Name of a limit, as in ``map.npz``, to its title and to the word beside its line."""

FORMULAS = {
    "schelleng_max": "F_max = v_b/(Y beta dmu)",
    "schelleng_min": (
        "F_min = 2 v_b Z_0/(pi^2 beta^2 dmu) (max_t Re sum (-1)^(n+1) Y_n e^(i n w_0 t)/n^2 + Re sum Y_n/n^2)"
    ),
    "raman": "F_min = v_b Z_0^2/(2 R beta^2 dmu)",
    "guettler_low": "a_low = beta (1-beta) F (3 mu_s - mu_d - 2 sqrt(2 mu_s^2 - mu_s mu_d))/(T Z_0)",
    "guettler_high": (
        "a_high = beta (1-beta) F ((3-4 beta) mu_s - mu_d - 2 sqrt((1-2 beta) (2 (1-beta) mu_s^2 - mu_s mu_d)))"
        "/((1-2 beta) T Z_0)"
    ),
}
"""Formulas as plain text, for captions."""


class Limit(NamedTuple):
    """A limit as a curve.

    Parameters
    ----------
    name : str
        One of :data:`TITLES`.
    x, y : ndarray, shape (points,)
        Values along the two axes of the map, in their units.
    formula : str
    inputs : str
        What went into the formula.
    """

    name: str
    x: NDArray[np.float64]
    y: NDArray[np.float64]
    formula: str
    inputs: str


# Schelleng


def admittance(p: Parameters) -> float:
    """Return the driving-point admittance of the infinite string at the bow, as :class:`Ends` of the model has it."""
    return p.y_t * (1 + (p.torsion_admittance if p.model in CREMER else 0.0)) / 2


def bridge_admittance(p: Parameters) -> NDArray[np.complex128] | None:
    """Return the admittance of the bridge at the first harmonics, in units of 1/Z_0; None where it is not known.

    Cremer's spring and dashpot, or Raman's losses of both ends as one dashpot, in series with the modes of the body.

    Returns
    -------
    ndarray, shape (`HARMONICS`,), or None
        None for a bridge with a reflection function of one's own.
    """
    if p.bridge_function:
        return None
    f_0 = p.sample_rate / p.period
    s = 2j * math.pi * f_0 * np.arange(1, HARMONICS + 1)
    y = np.zeros(HARMONICS, np.complex128)
    if p.model in CREMER:
        y += 1 / p.bridge_r  # of the dashpot, exactly; the spring takes its share
        if p.bridge_w_c:
            y *= s / (s + p.bridge_w_c * 2 * math.pi * f_0)
    elif p.model == "raman":
        y += sum((1 - gain) / (1 + gain) for gain in (p.bridge_gain, p.nut_gain))
    for f, q, kappa in body.modes_of(p):
        w = 2 * math.pi * f
        y += kappa * w * s / (s * s + s * w / q + w * w)
    return y


def pressed(y: NDArray[np.complex128]) -> float:
    """Return ``max_t Re sum (-1)^(n+1) Y_n e^(i n w_0 t)/n^2 + Re sum Y_n/n^2``: what the bridge gives way.

    Parameters
    ----------
    y : ndarray, shape (harmonics,)
        Admittance of the bridge at the harmonics, in units of 1/Z_0. One that is the same real number at each of them,
        a dashpot alone, has the closed form ``pi^2 Y/4`` of all harmonics.
    """
    if not y.imag.any() and np.ptp(y.real) == 0:
        return float(math.pi**2 / 4 * y.real[0])
    n = np.arange(1, len(y) + 1)
    terms = np.zeros(INSTANTS // 2 + 1, np.complex128)
    terms[1 : len(y) + 1] = np.where(n % 2, 1, -1) * y / n**2
    moving = np.fft.irfft(terms, INSTANTS) * INSTANTS / 2
    return float(moving.max() + np.sum(y.real / n**2))


def schelleng_max(cells: Sequence[Parameters]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return Schelleng's maximum bow force of cells and the difference of friction in it.

    Returns
    -------
    force, fall : ndarray, shape (cells,)
        Force in the paper's units, and ``mu_s - mu``.
    """
    values, y = _values(cells), np.array([admittance(cell) for cell in cells])
    force = schelleng.greatest(cells[0].friction, values, y)
    return force, values["v_b"] / (y * schelleng.beta(values)) / force


def schelleng_min(cells: Sequence[Parameters]) -> tuple[NDArray[np.float64], NDArray[np.float64]] | None:
    """Return Schelleng's minimum bow force of cells and the difference of friction in it, as :func:`schelleng_max`.

    None where a bridge has no losses, or its admittance is not known.
    """
    bridges = [bridge_admittance(cell) for cell in cells]
    lost = np.array([0.0 if y is None else pressed(y) for y in bridges])
    if not (lost > 0).all():
        return None
    values = _values(cells)
    k = 2 * values["v_b"] / values["y_t"] / (math.pi * schelleng.beta(values)) ** 2 * lost
    force = schelleng.force_for(cells[0].friction, values, k)
    return force, k / force


def _values(cells: Sequence[Parameters]) -> dict[str, Any]:
    """Return the numbers among the parameters of cells, by name, (cells,) each, and the friction curve of all."""
    names = FLOATS | {"bow_bridge", "period"}
    numbers = {name: np.array([getattr(cell, name) for cell in cells], np.float64) for name in names}
    return {**numbers, "friction_curve": cells[0].friction_curve}


# Guettler


def guettler_bounds(p: Parameters) -> tuple[float, float] | None:
    """Return least and greatest acceleration per period over bow force, in the paper's units; None without mu_d.

    Guettler 2002, for Coulomb friction: between them each period has one slip from the first on.
    """
    b, mu_s, mu_d, z_0 = p.beta, p.mu_s, p.mu_d, 1 / p.y_t
    if p.friction == "thermal" or b >= 0.5:
        return None
    low = 3 * mu_s - mu_d - 2 * math.sqrt(2 * mu_s**2 - mu_s * mu_d)
    under = (1 - 2 * b) * (2 * (1 - b) * mu_s**2 - mu_s * mu_d)
    if under < 0:
        return None
    high = ((3 - 4 * b) * mu_s - mu_d - 2 * math.sqrt(under)) / (1 - 2 * b)
    return b * (1 - b) * low / z_0, b * (1 - b) * high / z_0


def why_no_bounds(plane: Plane) -> str | None:
    """Return why a plane of force and acceleration has no bounds of Guettler's; None where it has, or is another one.

    With a mu_d and a bow near the bridge both bounds are known.
    """
    axes, values = {plane.x_name, plane.y_name}, plane.values
    if not (axes & set(FORCES) and axes & set(ACCELERATIONS) and values.get("gesture") in ACCELERATED):
        return None
    if limits(plane):
        return None
    if values.get("friction") == "thermal":
        return "no bounds of Guettler's: they need mu_d, which friction=thermal does not have"
    return "no bounds of Guettler's: they are for a bow near the bridge, and mu_s above mu_d"


# Curves


def limits(plane: Plane) -> tuple[Limit, ...]:
    """Return the limits that are curves in the plane of a map; () where there are none, or its settings are unknown.

    They may lie outside of the axes; :func:`bow_sweep.maps.limit_lines.drawn` has what is inside.
    """
    if "model" not in plane.values:
        return ()
    axes = tuple((name, tuple(np.asarray(values, float).tolist())) for name, values in _axes(plane))
    return _limits(tuple(plane.settings), *axes)


def _axes(plane: Plane) -> tuple[tuple[str, NDArray[np.float64]], ...]:
    return (plane.x_name, plane.x), (plane.y_name, plane.y)


@functools.lru_cache(maxsize=32)
def _limits(
    settings: tuple[str, ...], x: tuple[str, tuple[float, ...]], y: tuple[str, tuple[float, ...]]
) -> tuple[Limit, ...]:
    upright = y[0] in FORCES
    (force, _), (other, along) = (y, x) if upright else (x, y)
    if force not in FORCES or other in FORCES:
        return ()
    given = dict(setting.partition("=")[::2] for setting in settings)
    try:
        common = Parameters.from_mapping({k: v for k, v in given.items() if k in FIELDS and k not in (force, other)})
        values = _some(np.array(along))
        cells = [common.replace(**{other: value}) for value in values.tolist()]
        curves = _guettler(cells, values, other) if other in ACCELERATIONS else _schelleng(cells)
    except ParameterError:  # settings of another version
        return ()
    newton = np.array([p.y_t * p.z_0 * p.v_unit if force == "force" else 1.0 for p in cells])
    made = []
    for name, (forces, formula, inputs) in curves.items():
        line = forces * newton
        x_values, y_values = (values, line) if upright else (line, values)
        made.append(Limit(name, x_values, y_values, formula, inputs))
    return tuple(made)


def _some(values: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the values of an axis, or of a very long one some of them, the ends included."""
    if len(values) <= MOST_POINTS:
        return values
    return values[np.linspace(0, len(values) - 1, MOST_POINTS).round().astype(int)]


def _schelleng(cells: list[Parameters]) -> dict[str, tuple[NDArray[np.float64], str, str]]:
    p = cells[0]
    if p.gesture == "guettler":  # its bow has no final speed
        return {}
    most, fall = schelleng_max(cells)
    found = {"schelleng_max": (most, FORMULAS["schelleng_max"], _friction(cells, fall, "Y = {y}, "))}
    least = schelleng_min(cells)
    if least is not None:
        plain = p.body == "none" and not p.body_modes and (p.model == "raman" or p.bridge_w_c == 0)
        formula = FORMULAS["raman" if plain else "schelleng_min"]
        found["schelleng_min"] = (least[0], formula, f"{_friction(cells, least[1])}, {_bridge(cells)}")
    if all(np.ptp(forces) <= STILL * np.max(forces) for forces, _, _ in found.values()):
        return {}
    return found


def _guettler(
    cells: list[Parameters], accelerations: NDArray[np.float64], name: str
) -> dict[str, tuple[NDArray[np.float64], str, str]]:
    p = cells[0]
    bounds = guettler_bounds(p) if p.gesture in ACCELERATED else None
    if bounds is None:
        return {}
    per_period = np.array([cell.acceleration for cell in cells]) if name != "acceleration" else accelerations
    inputs = f"mu_s = {p.mu_s:g}, mu_d = {p.mu_d:g}, beta = {p.beta:.4g}, T one period, Z_0 = 1/Y_T"
    return {
        key: (per_period / bound, FORMULAS[key], inputs)
        for key, bound in zip(("guettler_low", "guettler_high"), bounds, strict=True)
    }


def _friction(cells: list[Parameters], fall: NDArray[np.float64], before: str = "") -> str:
    """Return the inputs that both of Schelleng's limits have: the difference of friction, and which one it is."""
    at = "" if before else "at slip speed v_b(1/beta-1)"
    how = {"thermal": "steady sliding", "hyperbola": at, "curve": at}
    words = how.get(cells[0].friction, "")
    y = before.format(y=_range(admittance(cell) for cell in (cells[0], cells[-1])))
    return f"{y}dmu = mu_s-mu = {_range(fall)}{' ' * bool(words)}{words}"


def _bridge(cells: list[Parameters]) -> str:
    """Return what the bridge of the minimum is."""
    p, ends_of = cells[0], (cells[0], cells[-1])
    parts = []
    if p.model in CREMER:
        parts.append(f"R = {_range(cell.bridge_r for cell in ends_of)} Z_0")
        if any(cell.bridge_w_c for cell in ends_of):
            parts.append(f"K/R = {_range(cell.bridge_w_c for cell in ends_of)} w_0")
    elif p.model == "raman":
        parts.append("R of the losses of both ends")
    found = body.modes_of(p)
    if found:
        modes = "1 mode" if len(found) == 1 else f"{len(found)} modes"
        parts.append(f"{modes} of the body" + f" {p.body}" * (p.body != "none"))
    return ", ".join(parts)


def _range(values: Iterable[float]) -> str:
    found = [float(value) for value in values]
    low, high = f"{min(found):.4g}", f"{max(found):.4g}"
    return low if low == high else f"{low} ... {high}"


def limit_arrays(plane: Plane) -> dict[str, NDArray[np.float64]]:
    """Return the limits as the arrays of ``map.npz``: ``limit_NAME_x`` and ``limit_NAME_y``, (points,) each."""
    arrays: dict[str, NDArray[np.float64]] = {}
    for limit in limits(plane):
        arrays |= {f"limit_{limit.name}_x": limit.x, f"limit_{limit.name}_y": limit.y}
    return arrays
