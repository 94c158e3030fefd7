"""Cells computed and judged together, with their bridge forces and slips."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from bow_classifier.verdict.regimes import HELMHOLTZ, HELMHOLTZ_EXTRA_SLIPS, is_helmholtz
from bow_sim.kernel.block import ChunkResult
from bow_sweep.maps.in_process import judged_chunks
from bow_sweep.plan.sweep import Sweep


def _helmholtz(regimes: NDArray[np.uint8]) -> NDArray[np.int64]:
    last: NDArray[np.bool_] = is_helmholtz(regimes[-1])
    return last.astype(np.int64)


def _reached(regimes: NDArray[np.uint8]) -> NDArray[np.int64]:
    passed: NDArray[np.bool_] = is_helmholtz(regimes)
    found: NDArray[np.int64] = np.any(passed, axis=0).astype(np.int64)
    return found


def _regime(regimes: NDArray[np.uint8]) -> NDArray[np.int64]:
    last: NDArray[np.int64] = regimes[-1].astype(np.int64)
    last[last == HELMHOLTZ_EXTRA_SLIPS] = HELMHOLTZ
    return last


OUTCOMES: dict[str, Callable[[NDArray[np.uint8]], NDArray[np.int64]]] = {
    "helmholtz": _helmholtz,
    "reached": _reached,
    "regime": _regime,
}
"""What an outcome is: a number of each cell, from its regimes at all tests, (tests, ..., cells).

*helmholtz*: the last test finds Helmholtz motion, or not. *reached*: some test has found it. *regime*: the regime at
the last test; Helmholtz motion with extra slips is Helmholtz motion. All cells are judged alike, by the thresholds of
the sweep."""

HELP = {
    "helmholtz": "whether the last test finds Helmholtz motion",
    "reached": "whether any test has found it: black or not on the map",
    "regime": "the name of the motion at the last test",
}


@dataclass(frozen=True, eq=False)
class Motions:
    """Cells, computed and judged.

    Attributes
    ----------
    force
        (cells, samples) float32: bridge force, as in :class:`bow_sim.kernel.block.ChunkResult`.
    slipping
        (cells, samples) bool: state after each step.
    regimes
        (tests, cells) uint8.
    """

    force: NDArray[np.float32]
    slipping: NDArray[np.bool_]
    regimes: NDArray[np.uint8]

    def take(self, rows: Sequence[int] | NDArray[np.int64], other: Motions, others: NDArray[np.int64]) -> None:
        """Replace some cells by cells of another; changes the arrays in place."""
        self.force[rows] = other.force[others]
        self.slipping[rows] = other.slipping[others]
        self.regimes[:, rows] = other.regimes[:, others]


def compute(sweep: Sweep, lanes: Mapping[str, ArrayLike]) -> Motions:
    """Compute cells of a sweep, on its grid or between its points.

    Parameters
    ----------
    lanes
        Values of both axes, (cells,) each.

    Raises
    ------
    ParameterError
        For values that cannot be simulated.
    """
    parts: list[tuple[NDArray[np.float32], NDArray[np.bool_], NDArray[np.uint8]]] = []
    for chunk, verdict in judged_chunks(sweep.parameters, lanes, sweep.thresholds):
        parts.append((chunk.bridge_force, _states(chunk), verdict.regime.copy()))
    force, slipping, regimes = zip(*parts, strict=True)
    return Motions(np.concatenate(force, axis=1), np.concatenate(slipping, axis=1), np.array(regimes))


def _states(chunk: ChunkResult) -> NDArray[np.bool_]:
    """Return whether each cell slips after each step of a chunk, (cells, samples)."""
    cells, samples = chunk.bridge_force.shape
    changes = np.zeros((cells, samples + 1), np.int8)
    offsets = chunk.offsets.astype(np.int64)
    cell = np.repeat(np.arange(cells), offsets[1:] - offsets[:-1])
    onset = chunk.onset.astype(np.int64)
    changes[cell, onset] += 1  # no two slips of a cell begin, or end, together
    changes[cell, onset + chunk.duration] -= 1
    states: NDArray[np.bool_] = np.cumsum(changes[:, :-1], axis=1, dtype=np.int8) > 0
    return states


def batches(count: int, sweep: Sweep, most_bytes: int = 1 << 28) -> Iterator[NDArray[np.int64]]:
    """Yield numbers 0 ... count - 1 in groups whose motions, two of each number, fit into memory.

    Each group has whole lanes of eight.
    """
    size = min(256, max(8, most_bytes // (12 * sweep.parameters.samples))) // 8 * 8
    for start in range(0, count, size):
        yield np.arange(start, min(start + size, count))
