"""A violin's body as a filter: what is radiated for a force at the bridge, by its strongest modes.

A modest model, for listening only; no number of a map comes from it. Frequencies of the modes are published values of
one violin: J. Woodhouse, *Euphonics*, section 5.3 (A0 272, CBR 407, B1- 462, B1+ 551 Hz). Loss factors are those of
neighbouring modes in the measured bridge admittance of another violin (CNSM, Paris; Zenodo record 18696786, CC BY 4.0).
The bridge hill is the broad maximum between 2 and 3 kHz that most violins have (E. V. Jansson, Acustica 83 (1997)
337-341). Strengths, and the part that no mode colours, are a choice by ear and not measured.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray


class Mode(NamedTuple):
    """A mode of the body: its frequency in Hz, its Q factor, and its strength in dB."""

    name: str
    frequency: float
    q: float
    level: float


MODES = (
    Mode("A0", 272.0, 40.0, 0.0),
    Mode("CBR", 407.0, 27.0, -9.0),
    Mode("B1-", 462.0, 27.0, 1.0),
    Mode("B1+", 551.0, 23.0, 1.0),
    Mode("bridge hill", 2500.0, 1.6, 2.0),
)

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
