"""The exponent of a motion: how fast an infinitesimal change of it grows (PHYSICS.md section 15).

The linearised motion goes on beside the real one. Stick/slip decisions do not move under an infinitesimal change, so an
exponent says nothing of them.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bow_sim.kernel.block import Block
from bow_sim.kernel.tangent import follow, slope
from bow_sim.physics.errors import ParameterError
from bow_sim.physics.gesture import force_and_speed
from bow_sim.physics.parameters import CHUNK_PERIODS, Parameters
from bow_sim.physics.reflection import ends

SKIP, FOLLOWED = 200, 400
"""Periods before the kick, and after it, unless given."""

LEFT_OUT = 5
"""Periods after the kick whose growth does not count: what decays at once is in them."""

FALLEN = 23.0
"""The end is where the norm has fallen by exp(23), ten decimal digits, unless given."""

MOST_SAMPLES = 10_000_000
"""Samples of the whole simulation, at most: the slopes of all are kept."""


@dataclass(frozen=True, eq=False)
class Exponent:
    """Growth of an infinitesimal change of a motion.

    Attributes
    ----------
    parameters
        Of the motion; `periods` is the number that was simulated.
    skip
        Periods before the kick.
    growth
        (periods,) natural logarithm of the growth in each period that counts.
    stopped
        Why it ends there.
    sliding
        Share of those periods' steps in which the string slips.
    """

    parameters: Parameters
    skip: int
    growth: NDArray[np.float64]
    stopped: str
    sliding: float

    @property
    def value(self) -> float:
        """The exponent, per nominal period."""
        return float(np.mean(self.growth))

    @property
    def halves(self) -> tuple[float, float]:
        """The exponents of the first and of the second half of the periods."""
        middle = max(len(self.growth) // 2, 1)
        return float(np.mean(self.growth[:middle])), float(np.mean(self.growth[-middle:]))

    @property
    def spread(self) -> tuple[float, float]:
        """The 10th and the 90th percentile of the growth of single periods."""
        low, high = np.percentile(self.growth, (10, 90))
        return float(low), float(high)

    def as_json(self) -> dict[str, Any]:
        """Return everything as plain data."""
        return {
            "exponent": self.value,
            "halves": self.halves,
            "spread": self.spread,
            "periods": len(self.growth),
            "skip": self.skip,
            "left_out": LEFT_OUT,
            "stopped": self.stopped,
            "sliding": self.sliding,
            "growth": self.growth.tolist(),
            "settings": list(self.parameters.settings()),
        }


def check(parameters: Parameters) -> None:
    """Refuse a motion that has no linearised one here.

    Raises
    ------
    ParameterError
        Naming the setting and what would be right.
    """
    if parameters.friction != "hyperbola":
        raise ParameterError(f"friction = {parameters.friction!r}: an exponent needs friction=hyperbola")
    if parameters.hair_r:
        raise ParameterError(f"hair_r = {parameters.hair_r!r}: an exponent needs a rigid bow: hair_r=0")
    if parameters.dtype != "float64":
        raise ParameterError(f"dtype = {parameters.dtype!r}: an exponent needs dtype=float64")


def exponent(
    parameters: Parameters,
    skip: int = SKIP,
    periods: int = FOLLOWED,
    seed: int = 0,
    fallen: float = FALLEN,
    progress: Callable[[float, float], None] | None = None,
) -> Exponent:
    """Compute the exponent of a motion.

    After `skip` periods a small force is added under the bow for one period, random numbers of one size; the norm is
    the r.m.s. of both outgoing transverse waves over a period. The exponent is the mean of its growth per period.

    Parameters
    ----------
    parameters
        Of the motion. Its `periods` are not used.
    skip, periods
        Nominal periods before the kick, and at most after it.
    seed
        Of the random numbers.
    fallen
        Stop where the norm has fallen by exp(fallen).
    progress
        Called with (samples done, samples) now and then.

    Raises
    ------
    ParameterError
        For another friction law than the hyperbola, an elastic bow, float32, or numbers of periods that cannot be.
    """
    check(parameters)
    for name, value, least in (("skip", skip, 0), ("periods", periods, LEFT_OUT + 1), ("seed", seed, 0)):
        if value < least:
            raise ParameterError(f"{name} = {value}: must be at least {least}")
    if not fallen > 0:
        raise ParameterError(f"fall = {fallen:g}: must be above 0, the natural logarithm of how much the norm falls")
    needed = skip + 1 + periods
    n = parameters.period
    if needed * n > MOST_SAMPLES:
        most = MOST_SAMPLES // n - 1
        raise ParameterError(f"skip + periods = {skip + periods}: must be at most {most} with period = {n}")
    whole = parameters.replace(periods=-(-needed // CHUNK_PERIODS) * CHUNK_PERIODS)
    slopes, slipping = (x[skip * n : needed * n] for x in _slopes(whole, progress))
    kick = np.random.default_rng(seed).uniform(-1, 1, n)
    found = follow(ends(whole), n, slopes, kick, fallen)
    growth = found.growth[1 + LEFT_OUT :]
    if not len(growth) or not np.isfinite(growth).all():
        raise ParameterError(f"after {len(found.growth) - 1} periods nothing is left of the kick: there is no exponent")
    early = len(found.growth) < periods + 1
    stopped = f"the norm has fallen by e^{fallen:g}" if early else f"all {periods} periods are followed"
    return Exponent(whole, skip, growth, stopped, float(np.mean(slipping[: len(found.growth) * n])))


def _slopes(p: Parameters, progress: Callable[[float, float], None] | None) -> tuple[NDArray[Any], NDArray[Any]]:
    """Return dv/dv_h at each step of the real motion, and whether the string slips; shape (samples,)."""
    block = Block(p, {"f_asym": [p.f_asym]}, trace=True)
    rows = {name: block.trace_names.index(name) for name in ("v", "v_h", "slipping")}
    slide, size = float(block.admittance[0]) * p.mu_d, p.chunk_samples
    slopes, slips = np.empty(p.samples), np.empty(p.samples, bool)
    for chunk in range(p.chunks):
        block.advance()
        assert block.traces is not None
        v, v_h, slipping = (block.traces[rows[name], :, 0] for name in ("v", "v_h", "slipping"))
        f_b, v_b = force_and_speed(p, chunk * size, size)
        here = slice(chunk * size, (chunk + 1) * size)
        slips[here] = slipping != 0
        slopes[here] = slope(p.v_b - p.v_mid, slide, v_b - v, v_b - v_h, f_b, slips[here])
        if progress:
            progress(here.stop, p.samples)
    if not math.isfinite(float(slopes.sum())):
        raise ParameterError("the motion stands on the limit of slipping, where it has no derivative")
    return slopes, slips
