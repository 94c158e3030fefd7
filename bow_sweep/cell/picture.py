"""One cell as a picture in a file: bridge force and slips, surface velocity, spectrum, friction, pitch and regimes."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from matplotlib.patches import Patch
from matplotlib.ticker import MaxNLocator

from bow_sim.figures.page import BLUE, GREEN, MUTED, ORANGE, Page, save, style
from bow_sweep.cell import analysis
from bow_sweep.cell.portrait import SHOWN_PERIODS, Portrait
from bow_sweep.figures.colours import GREY, regime_colours
from bow_sweep.maps.plane import MODEL_NAMES, regime_label

HEIGHT = 9.6
"""Inches."""

SPECTRUM_KHZ = 12.0


def draw_cell(path: Path, portrait: Portrait) -> None:
    """Draw a cell into a file; the suffix sets the format.

    Raises
    ------
    FigureError
        If the suffix is not .png, .svg or .pdf.
    OSError
        If the file cannot be written.
    """
    with style():
        save(picture(portrait), path)


def picture(portrait: Portrait) -> Figure:
    """Return the picture of a cell."""
    record = portrait.record
    facts = dict(portrait.facts())
    model = MODEL_NAMES.get(record.parameters.model, record.parameters.model)
    caption = f"{model};  transient {facts['transient']};  {facts['pitch at the end']}"
    page = Page(HEIGHT, f"Cell {record.cell}  {record.place(' = ')}", caption)
    parts = page.figure.subplot_mosaic(
        [["force", "force"], ["speed", "speed"], ["pitch", "pitch"], ["zoom", "fast"], ["plane", "lines"]],
        height_ratios=[1.25, 1.25, 0.9, 1.25, 1.7],
    )
    _waveforms(portrait, parts)
    _pitch(portrait, parts["pitch"])
    _friction(portrait, parts["plane"])
    _spectrum(portrait, parts["lines"])
    return page.figure


def _waveforms(portrait: Portrait, parts: dict[str, Any]) -> None:
    record, motion = portrait.record, portrait.motion
    periods = np.arange(len(record.bridge_force)) / record.period
    low, high = float(record.bridge_force.min()), float(record.bridge_force.max())
    level = low - 0.1 * ((high - low) or 1.0)
    titles = {"force": "bridge force, and slips (bars)", "zoom": f"the last {SHOWN_PERIODS} periods", "fast": ""}
    for name, part in (("force", slice(None)), ("zoom", portrait.last)):
        axis = parts[name]
        axis.plot(periods[part], record.bridge_force[part], lw=0.6, color=BLUE)
        bars = [
            (onset / record.period, duration / record.period)
            for onset, duration in zip(record.onsets.tolist(), record.durations.tolist(), strict=True)
        ]
        axis.broken_barh(bars, (level - 0.02 * (high - low), 0.04 * ((high - low) or 1.0)), color=ORANGE)
        axis.set(ylabel="bridge force", xlim=(periods[part][0], periods[part][-1]))
        axis.set_title(titles[name], loc="left")
    for name, part in (("speed", slice(None)), ("fast", portrait.last)):
        axis = parts[name]
        axis.plot(periods[part], motion.bow_speed[part], lw=0.6, color=MUTED)
        axis.plot(periods[part], motion.v[part], lw=0.6, color=GREEN)
        axis.set(ylabel="surface velocity", xlim=(periods[part][0], periods[part][-1]))
    parts["speed"].set_title("velocity of the string's surface, final bow speed = 1", loc="left")
    for name in ("zoom", "fast"):
        parts[name].set_xlabel("time (nominal periods)")


def _pitch(portrait: Portrait, axis: Any) -> None:
    """Draw the pitch at each test over stripes in the colours of the regimes."""
    record = portrait.record
    tests = record.tests
    colours = dict(zip(tests.regime_names, regime_colours(tests.regime_names), strict=True))
    handles = {}
    for first, last, name in tests.runs():
        red, green, blue = (channel / 255 for channel in colours.get(name, GREY))
        axis.axvspan(first, last, color=(red, green, blue), alpha=0.3, lw=0)
        handles[name] = Patch(color=(red, green, blue), alpha=0.5, label=regime_label(name))
    known = np.isfinite(tests.period)
    cents = [analysis.cents(period, record.period) for period in tests.period[known].tolist()]
    axis.plot(np.asarray(tests.periods)[known], cents, "o", ms=3, color=BLUE)
    axis.set(xlim=(0, len(record.bridge_force) / record.period), ylabel="cents", xlabel="time (nominal periods)")
    axis.margins(y=0.2)
    axis.set_title("pitch at each test", loc="left")
    if handles:
        patches = list(handles.values())
        place: Any = {"loc": "lower right", "bbox_to_anchor": (1.0, 0.98), "borderaxespad": 0.2}
        axis.legend(handles=patches, ncols=5, fontsize=6, columnspacing=1, frameon=False, **place)


def _friction(portrait: Portrait, axis: Any) -> None:
    motion = portrait.motion
    tail = slice(-analysis.TAIL_PERIODS * portrait.record.period, None)
    dots: Any = {"marker": ".", "ls": "", "rasterized": True}
    axis.plot(motion.v_h, motion.friction_force, ms=1, color="0.75", label="transient", **dots)
    curve = motion.curve()
    if curve:
        axis.plot(curve.v_h, curve.f, lw=1, color=ORANGE, label="friction curve")
        axis.plot(*np.array(curve.stick).T, lw=1, color=ORANGE)
    axis.plot(
        motion.v_h[tail], motion.friction_force[tail], ".", ms=2, color=BLUE, label="last periods", rasterized=True
    )
    wide = float(np.ptp(motion.v_h)) or 1.0
    axis.set(xlim=(motion.v_h.min() - 0.05 * wide, motion.v_h.max() + 0.05 * wide))
    axis.set(xlabel="velocity of the arriving waves  $v_h$", ylabel="friction force  $f$")
    axis.xaxis.set_major_locator(MaxNLocator(6))
    axis.set_title("friction plane", loc="left")
    axis.legend(fontsize=6.5, frameon=False, markerscale=3)


def _spectrum(portrait: Portrait, axis: Any) -> None:
    spectrum, harmonics = portrait.spectrum, portrait.harmonics
    axis.plot(spectrum.frequency / 1000, spectrum.level, lw=0.5, color="0.7" if harmonics else BLUE)
    if harmonics is not None:
        axis.plot(harmonics.frequency / 1000, harmonics.level, "o", ms=2.5, color=BLUE)
    top = float(np.ceil(spectrum.level.max() / 10) * 10)
    axis.set(xlim=(0, min(SPECTRUM_KHZ, spectrum.frequency[-1] / 1000)), ylim=(top - 90, top))
    axis.set(xlabel="frequency (kHz)", ylabel="level (dB)")
    axis.set_title("spectrum of the last 20 periods, harmonics", loc="left")
