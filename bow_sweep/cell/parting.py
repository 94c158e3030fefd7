"""When the motion of a repeat parts from that of its cell (PHYSICS.md section 15)."""

from __future__ import annotations

import numpy as np

from bow_sweep.cell.waveform import Waveform

APART = 3
"""Onsets of slips that differ by more samples than this are different."""


def parting(one: Waveform, other: Waveform, period: int) -> float:
    """Return after how many nominal periods two motions part: the time of the first onset of a slip that differs.

    The slips are compared in their order. Where one motion has no further slip, they part at the next slip of the
    other.

    Parameters
    ----------
    one, other
        Two motions, from their beginning.
    period
        Nominal period, samples.

    Returns
    -------
    float
        Periods; infinity where no onset differs by more than `APART` samples.
    """
    first, second = (np.asarray(wave.onsets, np.int64) for wave in (one, other))
    both = min(len(first), len(second))
    apart = np.flatnonzero(np.abs(first[:both] - second[:both]) > APART)
    if len(apart):
        return float(min(first[apart[0]], second[apart[0]]) / period)
    longer = first if len(first) > both else second
    return float(longer[both] / period) if len(longer) > both else float("inf")
