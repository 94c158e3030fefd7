"""Wolves: the string of McIntyre, Schumacher and Woodhouse (1983) with one mode, and the beat in plain NumPy."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from bow_sim.physics.parameters import Parameters
from bow_sim.physics.reflection import gaussian

PERIOD = 128
F_0 = 440.0


def string_of_1983(kappa: float, q: float, periods: int = 400) -> Parameters:
    """Return the string of PHYSICS.md section 16: Gaussian reflections at both ends, a mode at 64/65 of f_0."""
    bridge, nut = (gaussian(delay, 3.0, 1.0, 12) for delay in (24.0, 104.0))
    return Parameters.from_mapping(
        {
            "model": "torsion_absorbed",
            "period": PERIOD,
            "bow_bridge": 24,
            "sample_rate": PERIOD * F_0,
            "torsion_admittance": 0.2,
            "bridge_function": bridge.text(),
            "nut_function": nut.text(),
            "v_mid": 0.0,
            "mu_s": 0.8,
            "mu_d": 0.3,
            "periods": periods,
            "body_modes": f"{F_0 * 64 / 65!r}/{q}/k{kappa}",
        }
    )


def wolf(
    force: NDArray[np.float64], stops: Sequence[int], period: int, end: int, smooth: bool = True
) -> tuple[float, int, float, float]:
    """Return share of periods with one slip, changes, beat in periods, and its height, over 100 periods.

    Parameters
    ----------
    force
        Bridge force, or bridge velocity.
    stops
        First sticking samples after the significant slips.
    period, end
        Nominal period, and the end of the 100 periods, samples.
    smooth
        Take the mean square over one period more.
    """
    counts = np.bincount(np.array(stops) // period, minlength=end // period)[end // period - 100 : end // period]
    some = counts[counts > 0] == 1
    ends = end - 100 * period + np.arange(1, 1601) * period // 16
    power = np.array([np.mean(np.asarray(force[stop - period : stop], float) ** 2) for stop in ends])
    rms = np.sqrt(np.convolve(power, np.full(16, 1 / 16), "valid") if smooth else power)
    rms -= rms.mean()
    height = np.correlate(rms, rms, "full")[len(rms) - 1 :][: len(rms) // 2]
    beyond = np.where(np.cumsum(height < 0) > 0, height, -np.inf)
    at = int(np.argmax(beyond))
    return float(np.mean(counts == 1)), int(np.count_nonzero(some[1:] != some[:-1])), at / 16, beyond[at] / height[0]
