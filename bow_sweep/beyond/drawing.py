"""Figures of the claims: one page each, in the print style of the others."""

from __future__ import annotations

import textwrap
from pathlib import Path
from typing import Any

import numpy as np

from bow_classifier.verdict.regimes import is_helmholtz
from bow_sim.figures.page import BLUE, GREEN, MUTED, ORANGE, Page, save, style
from bow_sweep.beyond.claim import Finding, Row
from bow_sweep.maps.map_file import MapFile

__all__ = ["BLUE", "GREEN", "MUTED", "ORANGE", "draw", "rows_of_regimes", "shade_map"]

PIXELS_AN_INCH = 110  # small files

SHADES = ("#1f4e79", "#7fa8cc", "#f2c9a8", "#e8e8e8")
"""Perfect, short, long, and none: of a map of transients."""


def draw(row: Row, finding: Finding, path: Path) -> None:
    """Write the figure of a claim.

    Raises
    ------
    OSError
        If the file cannot be written.
    """
    with style():
        caption = textwrap.shorten(f"{row.verdict}: {row.found}", 120, placeholder=" ...")
        page = Page(3.3, f"{row.key}  {textwrap.shorten(row.claim, 68 - len(row.key), placeholder=' ...')}", caption)
        (axes,) = page.panels(1)
        finding.draw(axes)
        page.figure.set_dpi(PIXELS_AN_INCH)
        save(page.figure, path)


def rows_of_regimes(axes: Any, plane: MapFile, names: tuple[str, ...]) -> None:
    """Draw each row of a map as dots along its force: filled where the motion is Helmholtz motion.

    Parameters
    ----------
    names
        Of the rows, from the first value of y on.
    """
    for i in range(len(names)):
        success = is_helmholtz(plane.regime[i])
        level = np.full(plane.x.shape, i)
        axes.plot(plane.x[success], level[success], "o", color=BLUE, ms=3.5, label="Helmholtz" if not i else None)
        axes.plot(
            plane.x[~success],
            level[~success],
            "o",
            color=ORANGE,
            ms=3.5,
            mfc="none",
            mew=0.6,
            label="other" if not i else None,
        )
    axes.set_yticks(range(len(names)), names)
    axes.set_ylim(-0.6, len(names) - 0.4)


def shade_map(axes: Any, plane: MapFile, lengths: Any, limits: tuple[float, float]) -> None:
    """Draw a map of transients in four shades: below the first limit, below the second, above, and never.

    Parameters
    ----------
    lengths
        (ny, nx) periods; infinite for never.
    """
    from matplotlib.colors import ListedColormap

    codes = np.where(np.isfinite(lengths), 2, 3)
    codes[lengths < limits[1]] = 1
    codes[lengths < limits[0]] = 0
    axes.pcolormesh(plane.x, plane.y, codes, cmap=ListedColormap(SHADES), vmin=-0.5, vmax=3.5, shading="nearest")
