"""The slip intervals of a chunk, as the message StickSlip has them."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np


def lengths_objection(values: Mapping[str, Any]) -> str:
    """Return which arrays of slip intervals do not have the same length; "" if all have, see `intervals_objection`."""
    onsets, durations, slips = (len(values[name]) for name in ("onset", "duration", "slip"))
    if onsets == durations == slips:
        return ""
    return f": {onsets} onsets, {durations} durations, {slips} slips; should be equal"


def intervals_objection(values: Mapping[str, Any]) -> str:
    """Return what is wrong with slip intervals that are not in order, separate, and within the chunk; "" if nothing.

    Parameters
    ----------
    values
        The decoded fields of a StickSlip. The text continues its name.
    """
    if reason := lengths_objection(values):
        return reason
    offsets, onset, duration = values["offsets"], values["onset"], values["duration"]
    count = len(onset)
    if not len(offsets) or offsets[0] != 0 or offsets[-1] != count or np.count_nonzero(offsets[1:] < offsets[:-1]):
        return f".offsets: should rise from 0 to {count}, the number of intervals"
    ends = onset + duration  # uint32: wraps where it is no place in a chunk, and is less than the onset then
    if np.count_nonzero((ends > onset) & (ends <= values["samples"])) != count:
        return f": an interval is empty or reaches past the chunk's {values['samples']} samples"
    apart = np.empty(count + 1, bool)
    np.greater(onset[1:], ends[:-1], out=apart[1:-1])
    apart[offsets] = True  # the first interval of a cell may begin before the last of the cell above ends
    if np.count_nonzero(apart) <= count:
        return ": the intervals of a cell should come in order, at least one sample apart"
    return ""
