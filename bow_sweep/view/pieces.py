"""Which samples of which cells a recording has, and which pieces of waveforms it can take next. Plain arrays.

Chunks of inspected cells come by best effort: some are lost, and a dashboard that starts late misses the first ones.
A piece that does not continue what is recorded waits until the samples before it are there, so that no line is drawn
across a gap, and every sample is recorded once.
"""

from __future__ import annotations

import bisect
from typing import NamedTuple

import numpy as np


class Piece(NamedTuple):
    """A part of a waveform: `first` is its first sample since the start of the gesture, `force` is (samples,)."""

    first: int
    force: np.ndarray

    @property
    def end(self) -> int:
        """The sample after its last one."""
        return self.first + len(self.force)


class Pieces:
    """The recorded and the waiting samples of some cells."""

    def __init__(self) -> None:
        self._recorded: dict[int, list[tuple[int, int]]] = {}
        self._waiting: dict[int, dict[int, Piece]] = {}

    def recall(self, cell: int, samples: np.ndarray) -> None:
        """Take note of samples, (n,) int64, that an earlier recording has."""
        numbers = np.unique(samples)
        breaks = np.flatnonzero(np.diff(numbers) > 1) + 1
        for part in np.split(numbers, breaks):
            if len(part):
                self._add(cell, int(part[0]), int(part[-1]) + 1)

    def _add(self, cell: int, first: int, end: int) -> None:
        """Add a recorded range, joined with those that touch it."""
        joined = []
        for low, high in self._recorded.get(cell, []):
            if high < first or low > end:
                joined.append((low, high))
            else:
                first, end = min(first, low), max(end, high)
        bisect.insort(joined, (first, end))
        self._recorded[cell] = joined

    def take(self, cell: int, first: int, force: np.ndarray) -> None:
        """Take a piece, unless some of its samples are known: another attempt at the block gives the same ones."""
        new = Piece(first, force)
        waiting = self._waiting.setdefault(cell, {})
        known = [*self._recorded.get(cell, []), *((piece.first, piece.end) for piece in waiting.values())]
        if all(new.end <= low or new.first >= high for low, high in known):
            waiting[first] = new

    def ready(self) -> dict[int, list[Piece]]:
        """Return the pieces that continue what is recorded, and of a cell without any the first ones; by cell."""
        found: dict[int, list[Piece]] = {}
        for cell, waiting in self._waiting.items():
            ranges = self._recorded.get(cell)
            at = ranges[-1][1] if ranges else min(waiting, default=0)
            while (piece := waiting.pop(at, None)) is not None:
                found.setdefault(cell, []).append(piece)
                self._add(cell, piece.first, piece.end)
                at = piece.end
        return found

    def rest(self) -> dict[int, list[tuple[Piece, bool]]]:
        """Return all waiting pieces in order, and whether the sample before each is missing; by cell."""
        found: dict[int, list[tuple[Piece, bool]]] = {}
        for cell, waiting in self._waiting.items():
            for first in sorted(waiting):
                before = any(low < first <= high for low, high in self._recorded.get(cell, []))
                found.setdefault(cell, []).append((waiting[first], first > 0 and not before))
                self._add(cell, first, waiting[first].end)
            waiting.clear()
        return found

    def missing(self, cell: int, samples: int) -> list[tuple[int, int]]:
        """Return the ranges (first, end) of a waveform of `samples` that are neither recorded nor waiting."""
        ranges = [*self._recorded.get(cell, []), *((p.first, p.end) for p in self._waiting.get(cell, {}).values())]
        found, at = [], 0
        for low, high in sorted(ranges):
            if low > at:
                found.append((at, min(low, samples)))
            at = max(at, high)
        if at < samples:
            found.append((at, samples))
        return found
