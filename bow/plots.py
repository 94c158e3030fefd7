"""Several maps, or directories of runs, as one picture."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from bow.maps import Map, open_run
from bow.pictures import picture
from bow.shown import Picture


def plot(*maps: Map | str | Path, layers: tuple[str, ...] = ("transient",), **options: Any) -> Picture:
    """Return a picture of several maps with a panel for each layer of each map; `bow plot` is this.

    Parameters
    ----------
    *maps
        Or the directories of runs.
    layers
        See :meth:`bow.Map.plot`.
    **options
        width_mm, periods, columns and style as :meth:`bow.Map.plot` takes them; titles, a text for each panel; dpi of
        a .png; shape, the height of a panel over its width.

    Raises
    ------
    ValueError
        For what a map does not have, or an option that cannot be; says what would be right.

    Examples
    --------
    >>> import bow
    >>> a = bow.sweep("fig11c", nx=8, ny=4, periods=20, progress=False)
    >>> b = bow.sweep("fig11d", nx=8, ny=4, periods=20, progress=False)
    >>> bow.plot(a, b, layers=("transient", "regime"), width_mm=180).save("two.pdf").name
    'two.pdf'
    """
    return picture([each if isinstance(each, Map) else open_run(each) for each in maps], layers, **options)
