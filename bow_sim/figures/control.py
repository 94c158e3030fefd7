"""Figures 9 and 12 of the paper: friction curves, and contours of initial bow force in the plane of the maps."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from matplotlib.figure import Figure
from matplotlib.ticker import FixedFormatter, FixedLocator, NullFormatter
from numpy.typing import NDArray

from bow_sim.figures.page import BLUE, GREEN, MUTED, ORANGE, Page, style
from bow_sim.physics.friction import sliding_coefficient
from bow_sim.physics.parameters import Parameters

V_MIDS = (-2.0, 0.2, 0.9)
"""String speeds at which friction is midway: the curves of Fig 9, in the order of its caption."""

SPEEDS = (-6.0, 2.0)
"""String velocities in Fig 9, bow speed 1."""

F_ASYM, F_RATIO = (0.5, 20.0), (0.0, 2.0)
"""Axes of Figs 10 to 12 (caption of Fig 10); the first is logarithmic."""

CONTOURS = (0.25, 0.5, 1.0, 2.0, 4.0, 8.0, 16.0, 32.0)
"""Initial bow forces along the lines of Fig 12, in the units of f_asym."""


class FrictionCurve(NamedTuple):
    """One curve of Fig 9, arrays of shape (points,): sliding branch, sticking, and the other sliding branch.

    Parameters
    ----------
    v : ndarray
        String velocity, bow speed 1.
    mu : ndarray
        Friction force over bow force; positive where the bow pulls the string forward.
    """

    v: NDArray[np.float64]
    mu: NDArray[np.float64]


def friction_curve(v_mid: float, low: float = SPEEDS[0], high: float = SPEEDS[1], points: int = 801) -> FrictionCurve:
    """Return the friction curve of a `v_mid` over string velocities `low` to `high`, odd about the bow speed."""
    p = Parameters(v_mid=v_mid)
    a = p.v_b - v_mid
    slower = p.v_b - np.geomspace(p.v_b - low, 1e-6, points)
    faster = p.v_b + np.geomspace(1e-6, high - p.v_b, points)
    v = np.concatenate([slower, [p.v_b, p.v_b], faster])
    mu = np.sign(p.v_b - v) * sliding_coefficient(np.abs(p.v_b - v), p.mu_s, p.mu_d, a)
    mu[points : points + 2] = p.mu_s, -p.mu_s
    return FrictionCurve(v, mu)


def contour(f_init: float, points: int = 400) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return a contour of Fig 12, on which bow force starts at `f_init`, within the axes.

    Returns
    -------
    f_asym, f_init_ratio : ndarray, shape (points,)
    """
    low = max(F_ASYM[0], f_init / F_RATIO[1])
    f_asym = np.geomspace(low, F_ASYM[1], points)
    return f_asym, f_init / f_asym


# ---- drawing


def figure_9() -> Figure:
    """Fig 9: friction curves for the three v_mid of Fig 11; solid, dashed and dash-dot as in the paper."""
    p = Parameters()
    caption = (
        rf"rectangular hyperbola between $\mu_s$ = {p.mu_s:g} on the point of sticking and $\mu_d$ = {p.mu_d:g} at "
        rf"high slip speed  ·  dots: $\mu$ is midway at $v_\mathrm{{mid}}$"
    )
    curves = zip(V_MIDS, ("-", "--", "-."), (BLUE, ORANGE, GREEN), strict=True)
    with style():
        page = Page(4.2, "Fig 9  Friction curves", caption)
        (axis,) = page.panels(1)
        axis.axhline(0, color=MUTED, lw=0.4)
        for v_mid, line, colour in curves:
            curve = friction_curve(v_mid)
            name = rf"$v_\mathrm{{mid}}$ = {v_mid:g}".replace("-", "−")
            for side in (curve.v < p.v_b, curve.v > p.v_b):
                axis.plot(curve.v[side], curve.mu[side], line, color=colour, lw=1.3, label=name)
                name = "_"  # in the legend once
            axis.plot(v_mid, (p.mu_s + p.mu_d) / 2, "o", ms=4, color=colour)
        axis.plot([p.v_b, p.v_b], [p.mu_s, -p.mu_s], color="0.2", lw=1.3)
        axis.annotate("sticking,\n$v = v_b$", (p.v_b, -0.45), (-6, 0), textcoords="offset points", ha="right",
                      va="center", fontsize=7.5, color=MUTED)  # fmt: skip
        axis.set(xlim=SPEEDS, ylim=(-0.9, 0.9), xlabel="string velocity  $v$   (bow speed $v_b$ = 1)")
        axis.set_ylabel(r"friction force / bow force,  $f / f_b$")
        axis.legend(frameon=False, loc="lower left")
    return page.figure


def figure_12() -> Figure:
    """Fig 12: contour lines of the bow force at t = 0 on the axes of Figs 10 and 11."""
    p = Parameters()
    caption = (
        r"contour lines of $f_\mathrm{init}$ on the axes of Figs 10 and 11; for one friction curve also of the "
        "hysteresis $v_2 - v_1$ at $t = 0$"
    )
    with style():
        page = Page(4.2, "Fig 12  Bow force at the start of a transient", caption)
        (axis,) = page.panels(1)
        for force in CONTOURS:
            x, y = contour(force)
            axis.plot(x, y, lw=1.0, color=BLUE)
            _name(axis, force)
        axis.set_xscale("log")
        axis.set(xlim=F_ASYM, ylim=F_RATIO, ylabel=r"$f_\mathrm{init}\,/\,f_\mathrm{asym}$")
        axis.set_xlabel(
            r"asymptotic bow force  $f_\mathrm{asym}$  "
            rf"(units of the string: $v_b = {p.v_b:g}$, $Y_T = {p.y_t:g}$)"
        )
        ticks = [0.5, 1, 2, 5, 10, 20]
        axis.xaxis.set_major_locator(FixedLocator(ticks))
        axis.xaxis.set_major_formatter(FixedFormatter([f"{tick:g}" for tick in ticks]))
        axis.xaxis.set_minor_formatter(NullFormatter())
        axis.set_yticks([0, 0.5, 1, 1.5, 2], ["0", "0.5", "1", "1.5", "2"])
    return page.figure


def _name(axis: Any, force: float) -> None:
    """Write the force on its contour: at ratio 1 if the contour reaches it, else near the other end."""
    ratio = 1.0 if F_ASYM[0] * 1.15 < force < F_ASYM[1] / 1.15 else (0.42 if force < 1 else 1.78)
    axis.text(
        force / ratio, ratio, f"{force:g}", fontsize=8, color=BLUE, ha="center", va="center",
        bbox={"facecolor": "white", "edgecolor": "none", "pad": 1.2},
    )  # fmt: skip
