"""Maps as pictures for a paper: one or several panels, true symbols and units, vector, fonts embedded."""

from __future__ import annotations

from collections.abc import Sequence

from bow.found import Found
from bow.shown import Picture
from bow_sweep.figures.caption import caption, titled
from bow_sweep.figures.plot import figure


def picture(
    maps: Sequence[Found],
    layers: Sequence[str] = ("transient",),
    *,
    width_mm: float = 86.0,
    periods: float | None = None,
    titles: Sequence[str] = (),
    columns: int | None = None,
    style: str = "paper",
    dpi: float = 300.0,
    shape: float | None = None,
) -> Picture:
    """Return a picture of every layer of every map: :meth:`bow.Map.plot` and `bow plot` are this.

    Parameters
    ----------
    maps
        One or more.
    layers
        Of each map, see :data:`bow_sweep.figures.layers.LAYERS`.
    width_mm
        Width of the whole picture.
    periods
        Time of the test, for the layers that have one; None: the last.
    titles
        Of the panels, in their order; () for what differs between the maps.
    columns, style, dpi, shape
        As :func:`bow_sweep.figures.plot.figure` takes them.

    Raises
    ------
    ValueError
        For what a map does not have, or a size, style or number of titles that cannot be; says what would be right.
    """
    panels = titled([found.file for found in maps], layers, periods, titles)
    drawn = figure(panels, width_mm, columns, style, dpi, shape)
    words = caption(panels)
    runs = " ".join(dict.fromkeys(found.file.run_id for found in maps if found.file.run_id))
    about = {"Title": words.partition(". ")[0], "Subject": words, "Keywords": f"run {runs}" if runs else "bow"}
    return Picture(drawn, words, caption(panels, "latex"), about)
