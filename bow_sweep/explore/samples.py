"""What the page shows of a chosen cell, as columns for its plots: waveform, slips, spectrum, harmonics."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from bow_sweep.cell import analysis
from bow_sweep.cell.cell_record import CellRecord

FLOOR_DB = 90.0
"""Spectra end so much below their strongest component; `floor` in page.js is the same."""

Columns = dict[str, Any]


def columns_of(record: CellRecord) -> dict[str, Columns]:
    """Return the data of a cell: source of the page -> its columns.

    Times are nominal periods, `force` is float32 as in the bag, frequencies are kHz, levels dB relative to an amplitude
    of 1 (final bow speed).
    """
    force, nominal, rate = record.bridge_force, record.period, record.sample_rate
    out: dict[str, Columns] = {
        "wave": {"time": np.arange(len(force)) / nominal, "force": force},
        "slips": {"left": record.onsets / nominal, "right": (record.onsets + record.durations) / nominal},
    }
    if float(np.ptp(force[-analysis.TAIL_PERIODS * nominal :])) < analysis.SILENCE:  # at rest: no spectrum
        empty: NDArray[np.float64] = np.zeros(0)
        return out | {name: {"frequency": empty, "level": empty} for name in ("spectrum", "harmonics")}
    period = analysis.period_of(force, nominal) or float(nominal)
    lines = analysis.spectrum(force, rate, period)
    tones = analysis.harmonics(force, rate, period)
    for name, found in (("spectrum", lines), ("harmonics", tones)):
        level = np.maximum(found.level, np.max(found.level, initial=-np.inf) - FLOOR_DB)
        out[name] = {"frequency": found.frequency / 1000, "level": level}
    return out
