"""Codes of the pictures of a map: which number each cell has in each picture, and what the numbers mean.

Every code has a name, which the viewer shows under the cursor, and a colour. A code of the two main pictures tells
regime and transient length together: each of them says both, and is painted by one.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from bow_sim.physics.parameters import CHUNK_PERIODS
from bow_sim.protocol.verdict_fields import PENDING
from bow_sweep.figures.colours import BLACK, GREY, TERRAIN_COLOURS, regime_colours, transient_colours, viridis
from bow_sweep.maps.plane import TEST_RANGES, regime_label, terrain_label
from bow_sweep.maps.terrain import TERRAINS, UNKNOWN

FOREIGN_LABEL, FOREIGN_COLOUR = "a regime unknown here", (128, 0, 64)
"""Of a regime that was not among the names at the beginning."""

REAL_STEP = 0.5
"""Periods: transients that are real numbers, as those of the gesture guettler, are shown in ranges of this length."""

MOST_LENGTHS = 200
"""Number of transient lengths that have a colour of their own; longer simulations have several lengths in one."""

CORRELATION_STEP = 0.01
"""Correlations are shown in steps of this size."""

NO_VALUE = 1000
"""Code of a cell without a result of a test."""


class Meaning(NamedTuple):
    """What a code stands for: its `label`, and its colour in a picture."""

    code: int
    label: str
    colour: tuple[int, int, int]


class Motion:
    """Codes of regime and transient length together.

    Parameters
    ----------
    regime_names
        The regimes that have a name in the recording.
    periods
        Length of a simulation.
    real
        Whether transients are real numbers, not whole tests.
    """

    def __init__(self, regime_names: Sequence[str], periods: float, real: bool = False) -> None:
        self._names, self._real = tuple(regime_names), real
        least = REAL_STEP if real else CHUNK_PERIODS
        self._step = least * math.ceil(max(int(periods / least), 1) / MOST_LENGTHS)
        self._lengths = math.ceil(periods / self._step)
        self._periods = periods
        self._states = len(self._names) + 2
        self._tables: dict[tuple[str, ...], np.ndarray] = {}

    def codes(self, transient: np.ndarray, regime: np.ndarray, names: tuple[str, ...]) -> np.ndarray:
        """Return the code of each cell, uint16.

        Parameters
        ----------
        transient
            (...) periods; 0 = never, NaN = not computed.
        regime
            (...) index into `names`, which may be those of another classifier; `PENDING` = no verdict.
        """
        known = np.nan_to_num(np.asarray(transient, np.float32))
        level = np.minimum(np.ceil(known / self._step), self._lengths).astype(np.uint16)
        level[np.isnan(transient)] = self._lengths + 1
        return level * np.uint16(self._states) + self._own(names)[regime]

    def of_regimes(self, codes: np.ndarray) -> np.ndarray:
        """Return how many cells are in each regime and, last, in none, (regimes + 1,)."""
        counts = np.bincount((codes % self._states).ravel(), minlength=self._states)
        return np.append(counts[: len(self._names)], counts[-1])

    def _own(self, names: tuple[str, ...]) -> np.ndarray:
        """Return a table, (256,) uint16, from the regimes of a map to those of the recording."""
        if names not in self._tables:
            table = np.full(PENDING + 1, len(self._names), np.uint16)
            own = {name: code for code, name in enumerate(self._names)}
            for code, name in enumerate(names):
                table[code] = own.get(name, len(self._names))
            table[PENDING] = len(self._names) + 1
            self._tables[names] = table
        return self._tables[names]

    def meanings(self, by_regime: bool) -> list[Meaning]:
        """Return all codes; coloured by regime, or by transient length."""
        regimes = [*map(regime_label, self._names), FOREIGN_LABEL, "pending"]
        regime_paint = [*regime_colours(self._names), FOREIGN_COLOUR, GREY]
        lengths = np.minimum(self._step * np.arange(1, self._lengths + 1), self._periods)
        length_paint = [BLACK, *map(tuple, transient_colours(lengths, self._periods).tolist()), GREY]
        words = ["no Helmholtz motion", *(f"transient {self._told(length)} periods" for length in lengths), ""]
        return [
            Meaning(
                level * self._states + state,
                ", ".join(filter(None, (regime, word))) if regime != "pending" or not word else word,
                regime_paint[state] if by_regime else length_paint[level],
            )
            for level, word in enumerate(words)
            for state, regime in enumerate(regimes)
        ]

    def _told(self, length: float) -> str:
        if self._real:
            return f"{length - self._step:g} to {length:g}"
        return f"{'' if self._step == CHUNK_PERIODS else 'at most '}{length:g}"


def layer_codes(name: str, values: np.ndarray, not_computed: np.ndarray) -> np.ndarray:
    """Return the codes of the results of a test, uint16; results beyond the scale have the code of its end."""
    low, high = TEST_RANGES[name]
    step = CORRELATION_STEP if name == "correlation" else 1.0
    shown = np.nan_to_num(np.asarray(values, np.float32), nan=low)
    codes = np.rint((np.clip(shown, low, high) - low) / step).astype(np.uint16)
    codes[not_computed] = NO_VALUE
    return codes


def layer_meanings(name: str) -> list[Meaning]:
    """Return the codes of the results of a test."""
    low, high = TEST_RANGES[name]
    step = CORRELATION_STEP if name == "correlation" else 1.0
    count = round((high - low) / step) + 1
    colours = viridis(np.arange(count) / (count - 1)).tolist()
    if name == "correlation":
        labels = [f"correlation {low + step * code:.2f}" for code in range(count)]
    else:
        labels = [f"{code} {name}" for code in range(count - 1)] + [f"{count - 1} {name} or more"]
    known = [
        Meaning(code, label, tuple(colour)) for code, (label, colour) in enumerate(zip(labels, colours, strict=True))
    ]
    return [*known, Meaning(NO_VALUE, "pending", GREY)]


def reliability_codes(shares: np.ndarray) -> np.ndarray:
    """Return the codes of shares of repeats that end as their cell, uint16: percents, `NO_VALUE` where not known."""
    return np.rint(np.nan_to_num(100 * np.asarray(shares, float), nan=NO_VALUE)).astype(np.uint16)


def reliability_meanings() -> list[Meaning]:
    """Return the codes of shares of repeats."""
    colours = viridis(np.arange(101) / 100).tolist()
    words = (f"{percent} % of the repeats end as the cell" for percent in range(101))
    known = [Meaning(code, word, tuple(colour)) for code, (word, colour) in enumerate(zip(words, colours, strict=True))]
    return [*known, Meaning(NO_VALUE, "not known", GREY)]


def terrain_meanings() -> list[Meaning]:
    """Return the codes of the kinds of terrain."""
    kinds = enumerate(zip(TERRAINS, TERRAIN_COLOURS, strict=True))
    return [
        *(Meaning(code, terrain_label(kind), colour) for code, (kind, colour) in kinds),
        Meaning(UNKNOWN, "unknown", GREY),
    ]
