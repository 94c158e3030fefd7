"""Figures 5 to 8 of the paper: one transient of the delta/Cremer model, and a second one that diverges from it.

:func:`motion`, :func:`steady` and :func:`parting` return the data, arrays over samples in the units of the paper's
Appendix (bow speed 1); the rest draws them.
"""

from __future__ import annotations

import functools
from typing import Any, NamedTuple

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from bow_sim.figures.page import BLUE, MUTED, ORANGE, Page, style
from bow_sim.kernel.block import transient
from bow_sim.physics.friction import slipping_limit, sticking_limit
from bow_sim.physics.parameters import Parameters
from bow_sim.physics.reflection import ends

FORCE, OTHER_FORCE = 5.5, 5.3
"""The constant bow forces of Figs 5 and 8, some 4 % apart (section III.C)."""

V_MID = 0.7
"""Of Figs 5 to 8 (caption of Fig 5)."""

BOX = 1200
"""Samples in one of the two boxes of Figs 5, 7 and 8 (caption of Fig 5)."""

STEADY_PERIODS = 100
"""Nominal periods after which the motion of Fig 6 is periodic (section III.B: that takes about 16)."""

CYCLES = 3
"""Cycles in Fig 6."""


class Motion(NamedTuple):
    """One transient. Arrays are (samples,), float64, and `slipping` is bool.

    Parameters
    ----------
    parameters : Parameters
    v, v_h, v_centre : ndarray
        Velocity of the string's surface, that of the arriving waves, and of its centre; bow speed = 1.
    bridge_force : ndarray
        Outgoing wave towards the bridge.
    slipping : ndarray
        State after the step.
    v_1, v_2 : float
        Limits of v_h below which sticking and above which slipping ends (Fig 1).
    """

    parameters: Parameters
    v: NDArray[np.float64]
    v_h: NDArray[np.float64]
    v_centre: NDArray[np.float64]
    bridge_force: NDArray[np.float64]
    slipping: NDArray[np.bool_]
    v_1: float
    v_2: float


@functools.lru_cache(maxsize=8)
def motion(force: float = FORCE, periods: int = STEADY_PERIODS) -> Motion:
    """Return the transient of Figs 5 to 8: delta/Cremer, constant bow force and speed from rest.

    Parameters
    ----------
    force : float
        Bow force, in units of ``v_b`` times impedance.
    periods : int
        Length in nominal periods, a multiple of five.
    """
    p = Parameters(model="delta_cremer", v_mid=V_MID, f_asym=force, f_init_ratio=1.0, periods=periods)
    y = ends(p).y
    w = transient(p)
    return Motion(
        p,
        v=w["v"],
        v_h=w["v_h"],
        v_centre=w["v_centre"],
        bridge_force=w["bridge_force"],
        slipping=w["slipping"],
        v_1=sticking_limit(force, y, p.mu_s, p.v_b),
        v_2=slipping_limit(force, y, p.mu_s, p.mu_d, p.v_b - p.v_mid, p.v_b),
    )


def slips(slipping: NDArray[np.bool_]) -> NDArray[np.int64]:
    """Return the slip intervals of a motion that starts sticking, (slips, 2): first sample, and first one after."""
    edges = np.flatnonzero(np.diff(slipping.astype(np.int8), prepend=0, append=0))
    return edges.reshape(-1, 2)


def parting(slipping: NDArray[np.bool_], other: NDArray[np.bool_]) -> int | None:
    """Return the sample at which two motions first differ in whether they slip, or None.

    A slip may begin or end some samples earlier in one of them; that is no difference. The motions differ at a slip of
    one of them during all of which the other sticks (section III.C: "Fig. 5 shows a slip while Fig. 8 continues to
    stick").

    Parameters
    ----------
    slipping, other : ndarray of bool, shape (samples,)
        State after each step; both start sticking.

    Returns
    -------
    int or None
        First sample of that slip.
    """
    alone = [
        first
        for mine, theirs in ((slipping, other), (other, slipping))
        for first, after in slips(mine).tolist()
        if not theirs[first:after].any()
    ]
    return min(alone, default=None)


def steady(cycles: int = CYCLES) -> tuple[int, Motion]:
    """Return the end of the motion of Fig 5, shown in Fig 6: whole cycles that begin half way between two slips.

    Returns
    -------
    first : int
        The sample of the whole transient at which the arrays begin.
    Motion
        Arrays of ``cycles`` nominal periods.
    """
    whole = motion()
    period = whole.parameters.period
    length = cycles * period
    centres = slips(whole.slipping).mean(axis=1)
    first = int(centres[centres < len(whole.v) - length][-1]) - (period // 2)
    part = slice(first, first + length)
    arrays = {name: getattr(whole, name)[part] for name in ("v", "v_h", "v_centre", "bridge_force", "slipping")}
    return first, whole._replace(**arrays)


# ---- drawing


def _caption(m: Motion, more: str = "") -> str:
    p = m.parameters
    words = (
        rf"delta/Cremer, constant bow force $f_b$ = {p.f_asym:g}, $v_\mathrm{{mid}}$ = {p.v_mid:g}, $v_b$ = {p.v_b:g}, "
        rf"$\beta$ = {p.bow_bridge}/{p.period}"
    )
    return words + (f"  ·  {more}" if more else "")


def _in_boxes(page: Page, m: Motion, name: str, label: str, low: float, high: float) -> list[Any]:
    """Draw the first 2400 samples of a waveform in two boxes of 1200; samples count from 1, as in the paper."""
    waveform = getattr(m, name)
    axes = page.panels(2, sharey=True)
    for box, axis in enumerate(axes):
        at = np.arange(box * BOX, (box + 1) * BOX)
        axis.plot(at + 1, waveform[at], lw=0.75, color=BLUE)
        axis.set(xlim=(box * BOX, (box + 1) * BOX), ylim=(low, high), ylabel=label)
        axis.set_xticks(np.arange(box * BOX, (box + 1) * BOX + 1, 200))
        axis.set_xticks(np.arange(box * BOX, (box + 1) * BOX + 1, 50), minor=True)
        period = m.parameters.period
        above = axis.secondary_xaxis("top", functions=(lambda x, n=period: x / n, lambda x, n=period: x * n))
        above.set_xticks(np.arange(-(-box * BOX // period), (box + 1) * BOX / period))
        above.tick_params(labelsize=7, colors=MUTED, pad=1)
        if not box:
            above.set_xlabel("nominal periods", fontsize=7, color=MUTED, labelpad=2)
    axes[-1].set_xlabel("time (samples)")
    return axes


def _point(axes: list[Any], sample: int, low: float, words: str) -> None:
    """Draw an arrow from below to a sample, as in the paper."""
    axis = axes[sample // BOX]
    place = axis.get_ylim()
    axis.annotate(
        words,
        xy=(sample + 1, low),
        xytext=(sample + 1, place[0] + 0.03 * (place[1] - place[0])),
        arrowprops={"arrowstyle": "-|>", "color": ORANGE, "lw": 1.1, "shrinkA": 0, "shrinkB": 2},
        color=ORANGE,
        fontsize=7.5,
        ha="center",
        va="bottom",
    )


def _parted() -> int:
    sample = parting(motion().slipping, motion(OTHER_FORCE).slipping)
    assert sample is not None and sample < 2 * BOX  # a property of the model, tested
    return sample


def _velocity(number: int, m: Motion, words: str) -> Figure:
    both = np.concatenate([motion().v[: 2 * BOX], motion(OTHER_FORCE).v[: 2 * BOX]])
    low = float(both.min())
    sample = _parted()
    with style():
        page = Page(4.6, f"Fig {number}  String surface velocity of a transient from rest", _caption(m, words))
        axes = _in_boxes(page, m, "v", r"surface velocity  $v$", 1.32 * low, 1 + 0.16 * (1 - low))
        for axis in axes:
            axis.axhline(m.parameters.v_b, color=MUTED, lw=0.5, ls=(0, (1, 2)), zorder=0)
        near = m.v[sample - 10 : sample + 11]
        _point(axes, sample, min(float(near.min()), 0.0), f"$f_b$ = {FORCE:g} and {OTHER_FORCE:g} part")
    return page.figure


def figure_5() -> Figure:
    """Fig 5: surface velocity over the first 2400 samples, bow force 5.5; marked where the motion of 5.3 differs."""
    return _velocity(5, motion(), "samples 1–1200 above, 1201–2400 below")


def figure_8() -> Figure:
    """Fig 8: as Fig 5 with bow force 5.3."""
    return _velocity(8, motion(OTHER_FORCE), "scales and format of Fig 5")


def figure_7() -> Figure:
    """Fig 7: the incident velocity v_h of the transient of Fig 5, with the limits v_1 and v_2 of hysteresis."""
    m, sample = motion(), _parted()
    shown = m.v_h[: 2 * BOX]
    low, high = float(shown.min()), float(shown.max())
    span = high - low
    with style():
        page = Page(4.6, "Fig 7  Incident velocity, the sum of the waves that arrive at the bow", _caption(m))
        axes = _in_boxes(page, m, "v_h", r"incident velocity  $v_h$", low - 0.22 * span, high + 0.06 * span)
        for axis in axes:
            for level, name in ((m.v_1, "$v_1$"), (m.v_2, "$v_2$")):
                axis.axhline(level, color=ORANGE, lw=0.9, ls=(0, (5, 3)))
                axis.annotate(
                    name, (1.004, level), xycoords=("axes fraction", "data"), color=ORANGE, va="center", fontsize=8.5
                )
        near = m.v_h[sample - 8 : sample + 9]
        _point(axes, sample, float(near.min()), f"here $f_b$ = {FORCE:g} slips and {OTHER_FORCE:g} sticks")
    return page.figure


def figure_6() -> Figure:
    """Fig 6: three cycles of the periodic motion at the end of the transient of Fig 5, in three waveforms."""
    first, m = steady()
    rows = (
        ("v", r"surface  $v$", "(a)  velocity of the string's surface"),
        ("v_centre", r"centre  $v_c$", "(b)  velocity of the string's centre"),
        ("bridge_force", "bridge force", "(c)  outgoing velocity wave towards the bridge: “bridge force”"),
    )
    with style():
        where = f"samples {first + 1}–{first + len(m.v)}"
        page = Page(5.6, "Fig 6  The periodic motion in which the transient of Fig 5 ends", _caption(m, where))
        axes = page.panels(3, sharex=True)
        at = np.arange(len(m.v))
        for axis, (name, label, title) in zip(axes, rows, strict=True):
            axis.plot(at, getattr(m, name), lw=0.9, color=BLUE)
            axis.set(ylabel=label, xlim=(0, len(m.v) - 1))
            axis.set_title(title, loc="left")
            axis.margins(y=0.1)
        for axis in axes[:2]:
            axis.axhline(m.parameters.v_b, color=MUTED, lw=0.5, ls=(0, (1, 2)), zorder=0)
        axes[0].annotate("sticking", (m.parameters.period, m.parameters.v_b), (0, -4), textcoords="offset points",
                         ha="center", va="top", fontsize=7.5, color=MUTED)  # fmt: skip
        axes[-1].set_xlabel("time (samples)")
        axes[-1].set_xticks(np.arange(0, len(m.v), 50))
        _explain_sawtooth(axes[-1], m)
    return page.figure


def _explain_sawtooth(axis: Any, m: Motion) -> None:
    """Label flyback and ripples in the panel of the bridge force."""
    force, period, ripple = m.bridge_force, m.parameters.period, m.parameters.bow_bridge
    high, low = float(force.max()), float(force.min())
    span = high - low
    note: Any = {"fontsize": 7.5, "color": MUTED}
    fly = int(np.argmin(np.diff(force[:period])))
    line = {"arrowstyle": "-", "color": MUTED, "lw": 0.6, "shrinkA": 1, "shrinkB": 2}
    axis.annotate("flyback", (fly + 0.5, low + 0.35 * span), (fly - 8, low + 0.2 * span), ha="right", va="center",
                  arrowprops=line, **note)  # fmt: skip
    middle = fly + period // 2
    step = middle - ripple + int(np.argmax(np.diff(force[middle - ripple : middle + 1])))
    level = float(force[step : step + ripple].min()) - 0.1 * span
    bar = {**line, "arrowstyle": "|-|,widthA=0.25,widthB=0.25", "shrinkA": 0, "shrinkB": 0}
    axis.annotate("", (step, level), (step + ripple, level), arrowprops=bar)
    axis.text(step, level - 0.05 * span, f"Schelleng ripple:\n{ripple} samples", va="top", **note)
