"""A violin's body as a filter: what is radiated for a force at the bridge, by its strongest modes.

A modest model, for listening only; no number of a map comes from it. Frequencies and Q factors of A0, CBR, B1- and B1+
are those of the body *signature*.
The bridge hill is the broad maximum between 2 and 3 kHz that most violins have (E. V. Jansson, Acustica 83 (1997)
337-341). Strengths, and the part that no mode colours, are a choice by ear and not measured.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from bow_sim.physics.body import SIGNATURE


class Mode(NamedTuple):
    """A mode of the body: its frequency in Hz, its Q factor, and its strength in dB."""

    name: str
    frequency: float
    q: float
    level: float


LEVELS = {"A0": 0.0, "CBR": -9.0, "B1-": 1.0, "B1+": 1.0}
"""Strengths of the modes of the body *signature*, dB, in their order."""


def _signature() -> tuple[Mode, ...]:
    numbers = (mode.split("/") for mode in SIGNATURE.split(","))
    return tuple(
        Mode(name, float(f), float(q), level) for (name, level), (f, q, _) in zip(LEVELS.items(), numbers, strict=True)
    )


MODES = (*_signature(), Mode("bridge hill", 2500.0, 1.6, 2.0))

DIRECT_DB = -15.0
"""What passes at every frequency: the many weaker modes together."""


def filtered(sound: NDArray[np.float64], rate: float) -> NDArray[np.float64]:
    """Return what the body radiates for a force at the bridge.

    Parameters
    ----------
    sound
        (samples,) force.
    rate
        Samples per second; modes above 0.45 of it are left out.

    Returns
    -------
    ndarray, shape (samples,)
        The sum of the modes, each a resonator with the gain `level` at its frequency, and of the direct part.
    """
    from scipy.signal import iirpeak, lfilter

    out = 10 ** (DIRECT_DB / 20) * np.asarray(sound, float)
    for mode in MODES:
        if mode.frequency < 0.45 * rate:
            b, a = iirpeak(mode.frequency, mode.q, fs=rate)
            out = out + 10 ** (mode.level / 20) * lfilter(b, a, sound)
    return out
