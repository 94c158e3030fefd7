"""The slip intervals of a chunk, as the message StickSlip has them."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np


def intervals_objection(values: Mapping[str, Any]) -> str:
    """Return what is wrong with slip intervals that are not in order, separate, and within the chunk; "" if nothing.

    Parameters
    ----------
    values
        The decoded fields of a StickSlip. The text continues its name.
    """
    offsets, onset, duration = (values[name].astype(np.int64) for name in ("offsets", "onset", "duration"))
    count = len(onset)
    if len(duration) != count or len(values["slip"]) != count:
        return f": {count} onsets, {len(duration)} durations, {len(values['slip'])} slips; should be equal"
    if not len(offsets) or offsets[0] != 0 or offsets[-1] != count or (offsets[1:] < offsets[:-1]).any():
        return f".offsets: should rise from 0 to {count}, the number of intervals"
    if not count:
        return ""
    ends = onset + duration
    if duration.min() < 1 or ends.max() > values["samples"]:
        return f": an interval is empty or reaches past the chunk's {values['samples']} samples"
    apart = onset[1:] > ends[:-1]
    first = offsets[(offsets > 0) & (offsets < count)]  # of its cell: free to begin before the cell above ends
    apart[first - 1] = True
    return "" if apart.all() else ": the intervals of a cell should come in order, at least one sample apart"
