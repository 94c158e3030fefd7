"""Slip onsets of a string, and from when on it slips once a period."""

from __future__ import annotations

import numpy as np

REGULAR_WITHIN = 5
"""Samples by which the time between slip onsets may differ from the nominal period in regular motion."""


def slip_onsets(slipping: np.ndarray) -> np.ndarray:
    """Return the samples t with slipping[t] and not slipping[t - 1], shape (onsets,)."""
    return np.flatnonzero(slipping[1:] & ~slipping[:-1]) + 1


def regular_from(slipping: np.ndarray, period: int) -> int | None:
    """Return the onset after which slips come once a period to the end, or None (PHYSICS.md section 8, Figs 5-8)."""
    onsets = slip_onsets(slipping)
    irregular = np.flatnonzero(np.abs(np.diff(onsets) - period) > REGULAR_WITHIN)
    first = irregular[-1] + 1 if irregular.size else 0
    if onsets.size - first < 3 or len(slipping) - onsets[-1] > period + REGULAR_WITHIN:
        return None
    return int(onsets[first])
