"""The motion of one cell as plain arrays: bridge force and slips, joined from the chunks of its block."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bow_sweep.maps.slips import Pieces, join


class CellError(ValueError):
    """A cell cannot be had as asked; the message says what, where, and what would be right."""


@dataclass(frozen=True, eq=False)
class Waveform:
    """The motion of one cell, as the kernel computed it.

    Attributes
    ----------
    bridge_force
        (samples,) float32, final bow speed = 1.
    slipping_first
        Whether the string slips before the first sample.
    onsets, durations
        (slips,) int64: first slipping sample since the start, and number of samples; a slip that chunks cut is one.
    slips
        (slips,) float64: sum of the slip speed over those samples; the period of the string is a whole Helmholtz slip.
    """

    bridge_force: NDArray[np.float32]
    slipping_first: bool
    onsets: NDArray[np.int64]
    durations: NDArray[np.int64]
    slips: NDArray[np.float64]

    @cached_property
    def slipping(self) -> NDArray[np.bool_]:
        """Whether the string slips after the step to each sample, (samples,)."""
        out = np.zeros(len(self.bridge_force), bool)
        for onset, duration in zip(self.onsets.tolist(), self.durations.tolist(), strict=True):
            out[onset : onset + duration] = True
        return out

    def differs_from(self, other: Waveform) -> int | None:
        """Return the first sample from which two waveforms differ in any bit; None where they are the same."""
        mine, theirs = (w.bridge_force.view(np.uint32) for w in (self, other))
        if len(mine) != len(theirs):
            return min(len(mine), len(theirs))
        unequal = np.flatnonzero(mine != theirs)
        if unequal.size:
            return int(unequal[0])
        pairs = [(getattr(self, name), getattr(other, name)) for name in ("onsets", "durations", "slips")]
        if all(a.tobytes() == b.tobytes() for a, b in pairs) and self.slipping_first == other.slipping_first:
            return None
        count = min(len(self.onsets), len(other.onsets))
        apart = [a[:count] != b[:count] for a, b in pairs]
        first = np.flatnonzero(np.any(apart, axis=0))
        longer = self if len(self.onsets) >= len(other.onsets) else other
        at = int(first[0]) if first.size else count
        return int(longer.onsets[at]) if at < len(longer.onsets) else 0


Part = tuple[np.ndarray, bool, np.ndarray, np.ndarray, np.ndarray]
"""Bridge force, state before the first sample, onsets, durations and slips of a cell in one chunk."""


def part_of(row: int, samples: int, force: np.ndarray, slip: Mapping[str, Any]) -> Part:
    """Return one cell out of a chunk.

    Parameters
    ----------
    row
        Place of the cell in the block.
    samples
        Of the chunk.
    force
        (cells * samples,) bridge force, cell by cell.
    slip
        Slips of all cells: `slipping`, `offsets`, `onset`, `duration`, `slip`, as in StickSlip.msg.
    """
    own = slice(*(int(x) for x in slip["offsets"][row : row + 2]))
    onset, duration, size = (np.array(slip[name][own]) for name in ("onset", "duration", "slip"))
    data = np.array(force[row * samples : (row + 1) * samples], np.float32)
    return data, bool(slip["slipping"][row]), onset, duration, size


def joined(parts: Sequence[Part], samples: int) -> Waveform:
    """Return the waveform of all chunks of a cell, `samples` each; slips that a border of chunks cuts are joined."""
    whole = join(
        [Pieces(np.array([slipping]), np.array([0, len(own[0])]), *own) for _, slipping, *own in parts], samples
    )
    return Waveform(
        bridge_force=np.concatenate([part[0] for part in parts]),
        slipping_first=parts[0][1],
        onsets=whole.start,
        durations=whole.end - whole.start,
        slips=whole.slip,
    )
