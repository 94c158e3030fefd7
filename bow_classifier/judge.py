"""The three tests over the chunks of one block, in order: waveforms in, judgements out, the state between carried.

A chunk is five nominal periods and is the window of the tests: where the actual period is longer, as flattening or
anomalous low frequencies make it, four slips may end in a window of a perfectly regular motion, and it does not pass.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from bow_sim.model import CHUNK_PERIODS, Parameters

from .corners import Corners, corners
from .lines import ripple
from .longlags import long_periods, reach
from .periodicity import periodicity
from .regime import LONG, Decision, Evidence, decide
from .regimes import is_helmholtz
from .slips import Intervals, Slips, Unfinished, slips
from .thresholds import Thresholds

FEW = 8
"""Counts below this may be one a period, to the nearest whole number, in five nominal periods of an actual one."""


@dataclass(frozen=True)
class Geometry:
    """What the tests must know of the string.

    Attributes
    ----------
    period
        Nominal period N, samples.
    bow_bridge
        Round trip bow-bridge-bow, samples: one period of the Schelleng ripples. ``beta = bow_bridge / period``.
        Cells may have their own instead.
    samples
        Of a chunk: whole periods.
    """

    period: int
    bow_bridge: int
    samples: int

    @classmethod
    def of(cls, parameters: Parameters) -> Geometry:
        """Return the geometry of a string that bow_sim simulates."""
        return cls(parameters.period, parameters.bow_bridge, parameters.chunk_samples)


class Judgement(NamedTuple):
    """The verdicts on the cells of a block after one chunk; the fields of the message Verdicts.

    Attributes
    ----------
    correlation
        (cells,) float32, -1 ... 1: autocorrelation at its best lag near the nominal period; where that is not periodic
        and a longer lag is, at that one. NaN = no interior maximum.
    period
        (cells,) float32, samples: that lag; NaN = no interior maximum.
    slips
        (cells,) uint16: significant slips that end in the window.
    corners
        (cells,) uint16: travelling Raman corners in the window.
    regime
        (cells,) uint8: index into `bow_classifier.regimes.REGIMES`.
    confidence
        (cells,) float32, 0 ... 1: probability that the regime is named rightly, see `bow_classifier.confidence`.
    """

    correlation: NDArray[np.float32]
    period: NDArray[np.float32]
    slips: NDArray[np.uint16]
    corners: NDArray[np.uint16]
    regime: NDArray[np.uint8]
    confidence: NDArray[np.float32]

    @property
    def passed(self) -> NDArray[np.bool_]:
        """(cells,) whether the motion is Helmholtz motion: all three tests pass."""
        return is_helmholtz(self.regime)


class BlockJudge:
    """Judges the cells of one block chunk by chunk, from t = 0 on.

    A cell's verdicts depend on that cell alone, bit for bit, whatever else is in the block.

    Parameters
    ----------
    geometry
        Of the string.
    thresholds
        Of the tests.
    cells
        Number of cells.
    bow_speed
        Final bow speed v_b, one or (cells,).
    bow_bridge
        Round trip bow-bridge-bow, samples, one or (cells,); None = that of the geometry. The third test needs beta
        below the threshold *corner*, 0.38: with the bow further away the ramp between two corners exceeds it too.

    Attributes
    ----------
    evidence, decision
        What the latest verdicts were made of; None before the first.

    Raises
    ------
    ValueError
        For a round trip that is no whole number of samples, or not shorter than the period.
    """

    def __init__(
        self,
        geometry: Geometry,
        thresholds: Thresholds,
        cells: int,
        bow_speed: ArrayLike = 1.0,
        bow_bridge: ArrayLike | None = None,
    ) -> None:
        self._geometry, self._thresholds = geometry, thresholds
        v_b = np.broadcast_to(np.asarray(bow_speed, dtype=np.float64), (cells,))
        self._delay = _delays(geometry, cells, bow_bridge)
        self._height = v_b * geometry.period / self._delay  # v_b/beta: the flyback of Helmholtz motion
        self._corner = thresholds.corner * self._height
        self._slip = thresholds.slip * v_b * geometry.period
        self._gap = (thresholds.cluster * self._delay).astype(np.float64)
        self._spread = (thresholds.flyback_cluster * self._delay).astype(np.float64)
        self._beta = self._delay / geometry.period
        self._lags, self._long_lags = thresholds.lags(geometry.period), thresholds.long_lags(geometry.period)
        self._start = reach(self._long_lags[1])  # farther back than any ripple period, which is less than a period
        self._record = np.zeros((cells, self._start + geometry.samples), np.float32)
        self._unfinished = Unfinished.none(cells)
        self.evidence: Evidence | None = None
        self.decision: Decision | None = None

    def judge(self, bridge_force: NDArray[np.float32], intervals: Intervals) -> Judgement:
        """Return the verdicts after the next chunk.

        Parameters
        ----------
        bridge_force
            (cells, samples) the wave out_B, units of PHYSICS.md section 2.
        intervals
            The slips of the same chunk.

        Raises
        ------
        ValueError
            For arrays of another shape, or slips that do not continue the chunk before; the state is as it was.
        """
        window = (len(self._record), self._geometry.samples)
        if bridge_force.shape != window:
            raise ValueError(f"bridge force {bridge_force.shape}: should be (cells, samples) = {window}")
        slipped, self._unfinished = slips(intervals, window[1], self._slip, self._gap, self._unfinished)
        record, start = self._record, self._start
        record[:, :start] = record[:, -start:]
        record[:, start:] = bridge_force
        period, least = self._geometry.period, self._thresholds.correlation
        correlation, place, deviation = periodicity(record, start, period, self._lags)
        turned = corners(record, start, self._delay, self._corner, self._spread)
        loudness = deviation / self._height
        moving = (slipped.number > 0) & (loudness >= self._thresholds.silence)
        long_periods(record, start, period, self._long_lags, least, moving & ~(correlation > least), correlation, place)
        lines = ripple(record, place, self._delay, self._undecided(correlation, place, slipped, turned))
        evidence = Evidence(
            correlation,
            place,
            slipped.number,
            slipped.clusters,
            slipped.small,
            turned.number,
            turned.clusters,
            loudness,
            lines,
            slipped.sure,
            turned.sure,
            self._beta,
        )
        self.evidence, self.decision = evidence, decide(evidence, period, self._thresholds)
        regime, confidence, _ = self.decision
        return Judgement(correlation, place, slipped.number, turned.number, regime, confidence)

    def _undecided(
        self, correlation: NDArray[np.float32], place: NDArray[np.float32], slipped: Slips, turned: Corners
    ) -> NDArray[np.bool_]:
        """Return where the name hangs on the ripples: no Helmholtz motion, one slip or a flyback cluster a period."""
        number = slipped.number, turned.number
        near = (correlation > self._thresholds.correlation) & (place < LONG * self._geometry.period)
        one = (number[0] < FEW) & (number[1] < FEW) & ((number[0] != CHUNK_PERIODS) | (number[1] != CHUNK_PERIODS))
        return near & (one | ((number[1] > 2 * CHUNK_PERIODS) & (turned.clusters < FEW)))


def _delays(geometry: Geometry, cells: int, bow_bridge: ArrayLike | None) -> NDArray[np.int64]:
    """Return the ripple period of every cell, (cells,), samples."""
    given = np.asarray(geometry.bow_bridge if bow_bridge is None else bow_bridge, dtype=np.float64)
    delays: NDArray[np.int64] = np.empty(cells, np.int64)
    right = (given > 0) & (given < geometry.period) & (given == np.floor(given))
    if not right.all():
        raise ValueError(
            f"bow_bridge {given[~right][0]}: should be a whole number of samples above 0 and below {geometry.period}"
        )
    delays[:] = given
    return delays
