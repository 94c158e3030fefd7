"""Figures 2 to 4 of the paper: impulse responses, mode frequencies and Q factors of the two models (section III.A)."""

from __future__ import annotations

import functools
from typing import Any, NamedTuple

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from bow_sim.figures.page import BLUE, GREEN, MUTED, ORANGE, Page, style
from bow_sim.physics.modes import Modes, torsional_response, transverse_modes, transverse_response
from bow_sim.physics.parameters import Parameters

PERIODS = 5
"""Length of Fig 2, nominal periods; the paper shows "the first few"."""

OVERTONES = 30
"""Modes in Figs 3 and 4."""


class Responses(NamedTuple):
    """Fig 2: g(t), velocity at the bow after a unit impulse of force there; arrays (samples,) in the Appendix's units.

    Parameters
    ----------
    delta, stiff : ndarray
        Of transverse waves in the delta/Cremer and stiff/Cremer models.
    torsion : ndarray
        Of torsional waves in both.
    """

    delta: NDArray[np.float64]
    stiff: NDArray[np.float64]
    torsion: NDArray[np.float64]


def models() -> tuple[Parameters, Parameters]:
    """Return the delta/Cremer and the stiff/Cremer model of section III.A."""
    return Parameters(model="delta_cremer"), Parameters(model="stiff_cremer")


@functools.cache
def responses(samples: int | None = None) -> Responses:
    """Return the data of Fig 2; five nominal periods if `samples` is None."""
    delta, stiff = models()
    count = PERIODS * delta.period if samples is None else samples
    return Responses(
        transverse_response(delta, count), transverse_response(stiff, count), torsional_response(delta, count)
    )


@functools.cache
def transverse() -> tuple[Modes, Modes]:
    """Return the data of Figs 3 and 4: the first 30 transverse modes of delta/Cremer and of stiff/Cremer."""
    delta, stiff = models()
    return transverse_modes(delta, OVERTONES), transverse_modes(stiff, OVERTONES)


# ---- drawing


def figure_2() -> Figure:
    """Fig 2: the start of g(t), of transverse waves in both models and of torsional waves, on one time axis."""
    data = responses()
    p, stiff = models()
    rows = (
        (data.delta, BLUE, "(a)  transverse, delta/Cremer"),
        (data.stiff, ORANGE, f"(b)  transverse, stiff/Cremer, $B$ = {_power(stiff.stiffness_b)}"),
        (data.torsion, GREEN, f"(c)  torsional, both models: {p.torsion_speed:g} times as fast"),
    )
    caption = (
        r"velocity at the bow after a unit impulse of force there, $g(t)$ of equation (5)  ·  "
        rf"$Y_T$ = {p.y_t:g}, $Y_R$ = {p.torsion_admittance:g} $Y_T$, $\beta$ = {p.bow_bridge}/{p.period}"
    )
    with style():
        page = Page(6.0, "Fig 2  Impulse responses at the bowed point", caption)
        axes = page.panels(3, sharex=True)
        for axis, (g, colour, title) in zip(axes, rows, strict=True):
            axis.axhline(0, color=MUTED, lw=0.4)
            axis.plot(np.arange(len(g)), g, lw=0.8, color=colour)
            axis.set_title(title, loc="left")
            axis.set_ylabel("$g(t)$")
            margin = 0.08 * float(np.ptp(g))
            axis.set_ylim(float(g.min()) - margin, float(g.max()) + margin)
        axes[-1].set(xlim=(-6, PERIODS * p.period), xlabel="time (samples)")
        axes[-1].set_xticks(np.arange(0, PERIODS * p.period, 100))
        axes[-1].set_xticks(np.arange(0, PERIODS * p.period, 20), minor=True)
        above = axes[0].secondary_xaxis("top", functions=(lambda x: x / p.period, lambda x: x * p.period))
        above.set_xticks(np.arange(PERIODS))
        above.tick_params(labelsize=7, colors=MUTED, pad=1)
        axes[0].annotate("periods", (1, 1), (0, 6), xycoords="axes fraction", textcoords="offset points", ha="right",
                         va="bottom", fontsize=7, color=MUTED)  # fmt: skip
    return page.figure


def _markers(axis: Any, delta: NDArray[np.float64], stiff: NDArray[np.float64], first: str, second: str) -> None:
    """Draw a quantity of both models over mode number; `first` and `second` are the markers of the paper."""
    number = np.arange(1, len(delta) + 1)
    axis.plot(number, stiff, second, ms=4.6, mfc="none", mec=ORANGE, mew=1.0, label="stiff/Cremer")
    axis.plot(number, delta, first, ms=4.6, mfc="none", mec=BLUE, mew=1.0, label="delta/Cremer")
    axis.set(xlim=(0, len(delta) + 1), xlabel="harmonic number  $n$")
    axis.set_xticks(np.arange(0, len(delta) + 1, 5))
    axis.set_xticks(np.arange(len(delta) + 1), minor=True)
    axis.grid(alpha=0.25, lw=0.5)


def _legend(axis: Any) -> None:
    handles, names = axis.get_legend_handles_labels()
    axis.legend(handles[::-1], names[::-1], frameon=False, loc="upper left")


def _caption() -> str:
    delta, stiff = models()
    return (
        f"Cremer's bridge $R$ = {delta.bridge_r:g}, $w_c$ = {delta.bridge_w_c:g} $w_1$  ·  "
        f"stiff: $B$ = {_power(stiff.stiffness_b)} on the long side, anti-alias filter at "
        rf"{stiff.nut_cutoff:g} $\pi$ rad/sample"
    )


def _power(number: float) -> str:
    """Return a small number as a power of ten, in mathtext: 5e-05 as 5 times 10 to the -5."""
    mantissa, _, exponent = f"{number:.3g}".partition("e")
    return mantissa if not exponent else rf"${mantissa} \times 10^{{{int(exponent)}}}$"


def figure_3() -> Figure:
    """Fig 3: mode frequency over harmonic number."""
    delta, stiff = transverse()
    p = models()[0]
    nominal = p.sample_rate / p.period
    with style():
        page = Page(4.0, f"Fig 3  Frequency of mode $n$ over $n$, first {OVERTONES} transverse modes", _caption())
        (axis,) = page.panels(1)
        axis.axhline(nominal, color=MUTED, lw=0.6, ls=(0, (4, 3)))
        axis.annotate(f"{nominal:g} Hz", (1, nominal), (-3, 3), xycoords=("axes fraction", "data"), ha="right",
                      textcoords="offset points", fontsize=7.5, color=MUTED)  # fmt: skip
        _markers(axis, delta.frequency / delta.number, stiff.frequency / stiff.number, "^", "o")
        axis.set_ylabel("$f_n / n$   (Hz)")
        _legend(axis)
    return page.figure


def figure_4() -> Figure:
    """Fig 4: Q factor over harmonic number."""
    delta, stiff = transverse()
    with style():
        page = Page(4.0, f"Fig 4  Q factors of the first {OVERTONES} transverse modes", _caption())
        (axis,) = page.panels(1)
        _markers(axis, delta.q, stiff.q, "o", "^")
        axis.set(ylabel="Q factor", ylim=(0, None))
        _legend(axis)
    return page.figure
