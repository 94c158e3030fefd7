"""The three tests over the chunks of one block, in order: waveforms in, judgements out, the state between carried.

A chunk is five nominal periods and is the window of the tests: where the actual period is longer, as flattening or
anomalous low frequencies make it, four slips may end in a window of a perfectly regular motion, and it does not pass.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from bow_classifier.chunk_pass import Lags, Strings, judge_cells
from bow_classifier.features.long_periods import reach
from bow_classifier.features.slips import Intervals, Unfinished, plain, refusal
from bow_classifier.verdict.decision import Decision, Evidence, limits_of
from bow_classifier.verdict.regimes import is_helmholtz
from bow_classifier.verdict.thresholds import Thresholds
from bow_sim.physics.parameters import Parameters
from bow_sim.simd.lanes import LANES


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
        (cells,) uint8: index into `bow_classifier.verdict.regimes.REGIMES`.
    confidence
        (cells,) float32, 0 ... 1: probability that the regime is named rightly, see
        `bow_classifier.verdict.confidence`.
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
        For a round trip that is no whole number of samples, or not shorter than the period; for a chunk that is not
        whole periods.
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
        delay = _delays(geometry, cells, bow_bridge)
        height = v_b * geometry.period / delay
        self._strings = Strings(
            delay,
            height,
            corner=thresholds.corner * height,
            slip=thresholds.slip * v_b * geometry.period,
            spread=(thresholds.flyback_cluster * delay).astype(np.float64),
            gap=(thresholds.cluster * delay).astype(np.float64),
        )
        self._beta = delay / geometry.period
        self._lags = Lags(*thresholds.lags(geometry.period), *thresholds.long_lags(geometry.period))
        if geometry.samples < LANES or geometry.samples % geometry.period or self._lags.first < 1:
            raise ValueError(f"{geometry}: a chunk should be whole periods, of 2 samples at least, and {LANES} in all")
        self._limits = limits_of(geometry.period, thresholds)
        start = reach(self._lags.longest)  # farther back than any ripple period, which is less than a period
        self._history = np.zeros((cells, start), np.float32)
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
        window = (len(self._history), self._geometry.samples)
        if bridge_force.shape != window:
            raise ValueError(f"bridge force {bridge_force.shape}: should be (cells, samples) = {window}")
        evidence, decision = Evidence.empty(self._beta), Decision.empty(len(self._beta))
        before, parts = self._unfinished, plain(intervals)
        wrong = judge_cells(
            self._history,
            _readable(bridge_force),
            parts[0],
            parts[1:],
            before,
            self._strings,
            self._lags,
            self._limits,
            evidence,
            decision,
        )
        if wrong >= 0:
            raise refusal(wrong, before.slipping[wrong])
        self.evidence, self.decision = evidence, decision
        regime, confidence, _ = decision
        return Judgement(evidence.correlation, evidence.period, evidence.slips, evidence.corners, regime, confidence)


def _readable(bridge_force: NDArray[np.float32]) -> NDArray[np.float32]:
    """Return the samples as the one type that the tests are compiled for: some are a message's, not to be written."""
    view = np.require(bridge_force, np.float32, ["C", "A"]).view()
    view.flags.writeable = False
    return view


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
