"""The paper's figures of one string, 2 to 9 and 12, by number; Figs 10 and 11 are maps and need runs.

:func:`figure` draws one, :func:`write` puts it into a file. The data, as arrays, come from the modules beside this:
`figures_linear` (2 to 4), `figures_motion` (5 to 8) and `figures_control` (9 and 12).
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
"""What draws each figure; its docstring says what is in it."""


def figure(number: int) -> Figure:
    """Draw a figure of the paper.

    Raises
    ------
    FigureError
        Where the number is none of `FIGURES`.
    """
    if number not in FIGURES:
        raise FigureError(f"figure {number}: no line figure of the paper; should be one of {_listed()}")
    return FIGURES[number]()


def write(number: int, path: str | Path) -> None:
    """Draw a figure of the paper into a file; the suffix, .png, .svg or .pdf, decides its kind.

    Raises
    ------
    FigureError
        For another number or suffix.
    OSError
        Where the file cannot be written.
    """
    check_path(path)
    save(figure(number), path)


def _listed() -> str:
    return ", ".join(map(str, FIGURES))
