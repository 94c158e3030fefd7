"""Colours of maps: of transient lengths, regimes and terrain, as plain arrays.

The brighter a cell, the sooner Helmholtz motion came. Black is never, as in the paper's Fig 11; grey is a cell that was
not computed. Viridis is perceptually uniform and can be read by colour-blind people. It is reversed, and its dark end
is not used, so that the longest transient can be distinguished from black.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterable, Sequence

import numpy as np

from bow_sim.protocol.verdict_fields import PENDING
from bow_sweep.maps.plane import regime_label

BLACK, GREY = (0, 0, 0), (180, 180, 180)
"""No Helmholtz motion; a cell that was not computed."""

HEADROOM = 1.1
"""The colour scale ends at this times the longest possible transient: the last tenth of viridis is too dark."""

_VIRIDIS = (
    "440154 48186a 472d7b 424086 3b528b 33638d 2c728e 26828e 21918c "
    "1fa088 28ae80 3fbc73 5ec962 84d44b addc30 d8e219 fde725"
)
_ANCHORS = np.array([[int(code[i : i + 2], 16) for i in (0, 2, 4)] for code in _VIRIDIS.split()], float)

REGIME_COLOURS: dict[str, tuple[int, int, int]] = {
    "no_oscillation": (240, 228, 66),
    "helmholtz": (0, 158, 115),
    "multiple_slip": (86, 180, 233),
    "multiple_flyback": (230, 159, 0),
    "other_periodic": (204, 121, 167),
    "aperiodic": (70, 70, 70),
    "helmholtz_extra_slips": (190, 245, 220),
    "raman_higher": (213, 94, 0),
    "anomalous_low_frequency": (0, 114, 178),
    "subharmonic": (51, 34, 136),
    "wolf": (80, 0, 40),
}
"""Okabe and Ito's colours, and three more that are as far from them, also for colour-blind people: a test measures it.
Other regimes have `SPARE_COLOURS`."""

TERRAIN_COLOURS = ((0, 0, 0), (0, 158, 115), (86, 180, 233), (213, 94, 0), (240, 228, 66))
"""Okabe and Ito's colours for `bow_sweep.maps.terrain.TERRAINS`, in their order: green is safe, blue uneven, orange and
yellow dangerous."""

SPARE_COLOURS = ((160, 110, 70), (250, 250, 250), (128, 0, 64), (0, 90, 60))


def viridis(share: np.ndarray | float) -> np.ndarray:
    """Return the colours of viridis at positions 0 ... 1, (..., 3) uint8."""
    place = np.clip(np.asarray(share, float), 0, 1) * (len(_ANCHORS) - 1)
    channels = [np.interp(place, np.arange(len(_ANCHORS)), _ANCHORS[:, channel]) for channel in range(3)]
    return np.stack(channels, axis=-1).round().astype(np.uint8)


def transient_colours(lengths: np.ndarray | float, periods: float) -> np.ndarray:
    """Return the colours of transient lengths, (..., 3) uint8; black for 0, grey for NaN."""
    lengths = np.asarray(lengths, float)
    colours = viridis(1 - np.nan_to_num(lengths) / (HEADROOM * periods))
    colours[lengths == 0] = BLACK
    colours[np.isnan(lengths)] = GREY
    return colours


def regime_colours(names: Iterable[str]) -> list[tuple[int, int, int]]:
    """Return a colour for each regime; a regime has the same colour in every picture."""
    spare = itertools.cycle(SPARE_COLOURS)
    return [REGIME_COLOURS[name] if name in REGIME_COLOURS else next(spare) for name in names]


def regime_legend(names: Sequence[str], rest: str = "pending") -> list[tuple[int, str, tuple[int, int, int]]]:
    """Return code, label and colour of each regime and, last, of cells without a verdict.

    Parameters
    ----------
    names
        Of the regimes, by code.
    rest
        Label of the cells without a verdict.
    """
    labels = [*map(regime_label, names), rest]
    return list(zip([*range(len(names)), PENDING], labels, [*regime_colours(names), GREY], strict=True))
