"""Few cells, computed some chunks ahead: to call compiled code takes as long as a chunk of a single cell."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bow_sim.kernel import few_cells
from bow_sim.kernel.arguments import Gesture
from bow_sim.kernel.few_cells import LEAST_LAG, NEAR, ROWS, SLOTS
from bow_sim.physics.reflection_text import Reflection
from bow_sim.simd.lanes import LANES, aligned

AHEAD = 16384
"""So many samples, those of all cells together, are computed by one call; less than a millisecond."""


def chunks_ahead(cells: int, samples: int) -> int:
    """Return how many chunks of `samples` samples are computed by one call."""
    return max(1, AHEAD // (cells * samples))


def sides_of(each: list[list[Reflection]], samples: int) -> few_cells.Sides:
    """Make the sides.

    Parameters
    ----------
    each : list of list of Reflection
        Of each of the four sides, and of each cell.
    samples : int
        Of a chunk.
    """
    rows = [r for cell in zip(*each, strict=True) for r in cell]
    size, past = len(rows), max(r.last for r in rows)
    tails = [r.tail_taps if r.tail else () for r in rows]
    gain = np.array([r.tail for r in rows])
    soonest = np.array([r.soonest for r in rows])
    ready = (soonest >= LEAST_LAG) | np.array([not any((*r.taps, r.tail)) for r in rows])
    near = np.arange(size) % ROWS == NEAR
    late = (~ready & ((gain != 0) | ~near)).reshape(-1, ROWS)
    return few_cells.Sides(
        first=np.array([r.first if any(r.taps) else r.first + len(r.taps) for r in rows]),
        last=np.array([r.first + len(r.taps) - 1 for r in rows]),
        depth=np.where(ready, 0, np.where(near, np.minimum(soonest, 2), soonest)),
        taps=_table([(0.0,) * r.first + r.taps + (0.0,) * LANES for r in rows]),
        gain=gain,
        pole=np.array([r.pole for r in rows]),
        state=np.zeros(size),
        tail_taps=_table([taps[::-1] for taps in tails]),
        tail_count=np.array([len(taps) for taps in tails]),
        tail_last=np.array([r.tail_first + len(taps) - 1 for r, taps in zip(rows, tails, strict=True)]),
        late_count=late.sum(axis=1),
        late=np.argsort(~late, axis=1, kind="stable"),
        following=np.zeros(len(late)),
        wave=np.zeros((size, past + samples)),
        past=past,
        sums=aligned((size, LANES), np.float64),
        arrived=aligned((size, SLOTS), np.float64),
    )


def _table(rows: list[tuple[float, ...]]) -> NDArray[np.float64]:
    """Return numbers of different count as rows of an array, zeros behind them."""
    table = np.zeros((len(rows), max(1, *map(len, rows))))
    for i, row in enumerate(rows):
        table[i, : len(row)] = row
    return table


class Ahead:
    """The chunks of few cells.

    Parameters
    ----------
    advance : function
        That of :func:`bow_sim.kernel.few_cells.build`.
    string : few_cells.String
        With sides of :func:`sides_of`.
    levels : dict of str to ndarray
        All of `Gesture` but the shapes.
    shapes : function
        ``shapes(first, samples, chunks)`` returns both shapes of a gesture, (1, all samples) or (cells, all samples).
    cells, samples, chunks : int
        Cells, samples of a chunk, and chunks of the simulation; more can be computed.
    waveforms : int
        How many there are of each cell.
    trace : bool
        Keep them.

    Attributes
    ----------
    slipping : ndarray of uint8, shape (cells,)
        After the last step that is computed.
    traces : None, or ndarray, shape (waveforms, samples, cells)
        Those of the latest chunk.
    """

    def __init__(
        self,
        advance: Callable[..., int],
        string: few_cells.String,
        levels: dict[str, NDArray[Any]],
        shapes: Callable[[int, int, int], tuple[NDArray[np.float64], NDArray[np.float64]]],
        cells: int,
        samples: int,
        chunks: int,
        waveforms: int,
        trace: bool,
    ) -> None:
        self._advance, self._string, self._levels, self._shapes = advance, string, levels, shapes
        self._cells, self._samples, self._chunks = cells, samples, chunks
        self._most = chunks_ahead(cells, samples)
        self._traces = np.zeros((self._most if trace else 0, waveforms, samples, cells))
        self._results: list[tuple[NDArray[Any], ...]] = []
        self._next = 0
        self.slipping = np.zeros(cells, np.uint8)
        self.traces = self._traces[0] if trace else None

    def chunk(self, number: int) -> tuple[NDArray[Any], ...]:
        """Return the next chunk, which has this number; see :class:`bow_sim.kernel.block.ChunkResult`."""
        if self._next == len(self._results):
            self._compute(number)
        result = self._results[self._next]
        if self.traces is not None:
            self.traces = self._traces[self._next]
        self._next += 1
        return result

    def _compute(self, first: int) -> None:
        """Compute the chunks from `first` on."""
        count = min(self._most, max(1, self._chunks - first))
        longest = self._cells * (self._samples // 2 + 1)  # if every slip and every stick is one sample long
        force, speed = self._shapes(first * self._samples, self._samples, count)
        output = few_cells.Output(
            bridge_force=np.empty((count, self._cells, self._samples), np.float32),
            slipping=np.empty((count + 1, self._cells), np.uint8),
            offsets=np.zeros((count, self._cells + 1), np.uint32),
            onset=np.empty((count, longest), np.uint32),
            duration=np.empty((count, longest), np.uint32),
            slip=np.empty((count, longest)),
            traces=self._traces,
        )
        output.slipping[0] = self.slipping
        gesture = Gesture(**self._levels, force=force, speed=speed)
        self._advance(first * self._samples, self._samples, self._string, gesture, output)
        self.slipping[:] = output.slipping[-1]
        sizes = output.offsets[:, -1].tolist()
        parts = zip(output.bridge_force, output.slipping[:-1], output.offsets, sizes, strict=True)
        self._results = [
            (force, slipping, offsets, output.onset[i, :size], output.duration[i, :size], output.slip[i, :size])
            for i, (force, slipping, offsets, size) in enumerate(parts)
        ]
        self._next = 0
