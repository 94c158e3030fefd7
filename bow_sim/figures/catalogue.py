"""The paper's figures of one string, 2 to 9 and 12, by number; Figs 10 and 11 are maps of whole runs.

:func:`figure` draws one, :func:`write` writes it to a file. Data and drawing are in :mod:`bow_sim.figures.linear` (2 to
4), :mod:`bow_sim.figures.motion` (5 to 8) and :mod:`bow_sim.figures.control` (9 and 12).
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from matplotlib.figure import Figure

from bow_sim.figures.control import figure_9, figure_12
from bow_sim.figures.linear import figure_2, figure_3, figure_4
from bow_sim.figures.motion import figure_5, figure_6, figure_7, figure_8
from bow_sim.figures.page import FigureError, check_path, save

__all__ = ["FIGURES", "FigureError", "figure", "write"]

FIGURES: dict[int, Callable[[], Figure]] = {
    2: figure_2,
    3: figure_3,
    4: figure_4,
    5: figure_5,
    6: figure_6,
    7: figure_7,
    8: figure_8,
    9: figure_9,
    12: figure_12,
}
"""Number -> function that draws the figure; its docstring describes the figure."""


def figure(number: int) -> Figure:
    """Draw a figure of the paper.

    Raises
    ------
    FigureError
        If the number is not in `FIGURES`.
    """
    if number not in FIGURES:
        raise FigureError(f"figure {number}: no line figure of the paper; should be one of {_listed()}")
    return FIGURES[number]()


def write(number: int, path: str | Path) -> None:
    """Draw a figure of the paper and write it to a file; the suffix, .png, .svg or .pdf, sets the format.

    Raises
    ------
    FigureError
        If the number is not in `FIGURES`, or the suffix is another one.
    OSError
        If the file cannot be written.
    """
    check_path(path)
    save(figure(number), path)


def _listed() -> str:
    return ", ".join(map(str, FIGURES))
