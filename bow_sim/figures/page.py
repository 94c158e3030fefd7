"""Line figures in print: the style, a page with title and caption, and the file."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import matplotlib as mpl
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from bow_sim.atomic_files import replacing

STYLE: Any = {
    "font.family": "DejaVu Sans",
    "mathtext.fontset": "dejavusans",
    "font.size": 8.5,
    "axes.titlesize": 9.5,
    "axes.labelsize": 9,
    "axes.linewidth": 0.7,
    "xtick.major.width": 0.7,
    "ytick.major.width": 0.7,
    "xtick.minor.width": 0.5,
    "ytick.minor.width": 0.5,
    "svg.hashsalt": "bow",
    "pdf.fonttype": 42,
}
"""The print style of all figures, also of the maps of `bow_sweep.view`."""

MUTED = "0.35"
BLUE, ORANGE, GREEN = "#1f4e79", "#c8551b", "#00795a"
"""Colours of a first, second and third waveform; they differ in lightness too, for prints without colour."""

DPI = 200
INCHES = 7.2
"""Width of a page, inches."""

METADATA: dict[str, dict[str, None]] = {
    ".png": {"Software": None},
    ".svg": {"Date": None},
    ".pdf": {"CreationDate": None},
}
"""File formats, and the metadata left out of each, so that the same figure gives the same bytes."""

NAMES: dict[str, dict[str, str]] = {
    ".png": {"Subject": "Description"},
    ".svg": {"Subject": "Description"},
    ".pdf": {},
}
"""What PNG and SVG call the metadata of PDF."""

_MARGIN, _TOP = 0.12, 0.58


class FigureError(ValueError):
    """There is no such figure or file format; the message lists the right ones."""


class Page:
    """A figure under construction: title and caption above, axes below.

    Parameters
    ----------
    height : float
        Inches of the whole page.
    title : str
        Number of the figure and what it shows, with two spaces between them.
    caption : str
        Parameters, in one line.
    """

    def __init__(self, height: float, title: str, caption: str) -> None:
        self.figure = Figure(figsize=(INCHES, height), dpi=DPI, facecolor="white", layout="constrained")
        FigureCanvasAgg(self.figure)
        engine: Any = self.figure.get_layout_engine()
        engine.set(rect=(0.005, 0.01, 0.985, 1 - _TOP / height - 0.01), h_pad=0.06, w_pad=0.05)
        number, _, words = title.partition("  ")
        at: Any = {"x": _MARGIN / INCHES, "ha": "left"}
        self.figure.text(y=1 - 0.24 / height, s=f"{number}   {words}", fontsize=11, fontweight="bold", **at)
        self.figure.text(y=1 - 0.46 / height, s=caption, fontsize=7.8, color=MUTED, **at)

    def panels(self, rows: int, **options: Any) -> list[Any]:
        """Return axes below each other, from top to bottom."""
        grid = self.figure.subplots(rows, 1, squeeze=False, **options)
        return [axis for (axis,) in grid]


def style() -> Any:
    """Return a context with the print style, in which figures are drawn and written."""
    return mpl.rc_context(STYLE)


def check_path(path: str | Path) -> Path:
    """Return the path of a picture file.

    Raises
    ------
    FigureError
        If the suffix is not .png, .svg or .pdf.
    """
    place = Path(path)
    if place.suffix.lower() not in METADATA:
        what = place.suffix or "a file without a suffix"
        raise FigureError(f"{place}: cannot draw as {what}; should end in {', '.join(METADATA)}")
    return place


def save(figure: Figure, path: str | Path, about: Mapping[str, str] | None = None) -> None:
    """Write a figure; the suffix sets the format. Other processes see the old file or the complete new one.

    Parameters
    ----------
    about
        What is written into the file beside the picture: values of Title, Subject and Keywords.

    Raises
    ------
    FigureError
        If the suffix is not .png, .svg or .pdf.
    OSError
        If the file cannot be written.
    """
    place = check_path(path)
    kind = place.suffix.lower()
    told = {NAMES[kind].get(name, name): text for name, text in (about or {}).items()}
    options: Any = {"format": kind[1:], "dpi": figure.dpi, "metadata": {**METADATA[kind], **told}}
    if kind == ".png":
        options["pil_kwargs"] = {"compress_level": 1}  # takes a third less time and a tenth more bytes
    with style(), replacing(place) as file:  # svg.hashsalt is read here
        figure.savefig(file, **options)
