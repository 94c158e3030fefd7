"""The chunks of one block, one after another: waveforms in, verdicts out; what a chunk leaves to the next is kept.

A chunk is five nominal periods and is the window of the tests. Where the actual period is longer, through flattening or
an anomalous low frequency, only four slips may end in a window of a perfectly regular motion; it then does not pass.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from bow_classifier.chunk_pass import DISORDER, BlockState, Chunk, Lags, Result, Setup, Strings, classify_cells
from bow_classifier.features.first_slips import Releases
from bow_classifier.features.long_periods import samples_before
from bow_classifier.features.slips import Intervals, SlipState, discontinuity
from bow_classifier.features.wolf import LEAST, WolfState
from bow_classifier.verdict.decision import Decision, Features, Limits
from bow_classifier.verdict.regimes import is_helmholtz
from bow_classifier.verdict.thresholds import Thresholds
from bow_sim.physics.parameters import Parameters
from bow_sim.simd.jit import entry
from bow_sim.simd.lanes import LANES


@dataclass(frozen=True)
class Geometry:
    """Period, bow position and chunk length of the strings of a block.

    Attributes
    ----------
    period
        Nominal period N, samples.
    bow_bridge
        Round trip bow-bridge-bow, samples: one period of the Schelleng ripples. ``beta = bow_bridge / period``.
        It can be given for each cell instead.
    samples
        Length of a chunk: whole periods.
    """

    period: int
    bow_bridge: int
    samples: int

    @classmethod
    def of(cls, parameters: Parameters) -> Geometry:
        """Return the geometry of a simulated string."""
        return cls(parameters.period, parameters.bow_bridge, parameters.chunk_samples)


class Verdicts(NamedTuple):
    """The verdicts on the cells of a block after one chunk; the fields of the message Verdicts.

    Attributes
    ----------
    correlation
        (cells,) float32, -1 ... 1: autocorrelation at its best lag near the nominal period, or at a long
        lag if only that is above the threshold. NaN = no interior maximum.
    period
        (cells,) float32, samples: that lag; NaN = no interior maximum.
    slips
        (cells,) uint16: significant slips that end in the window.
    corners
        (cells,) uint16: travelling Raman corners in the window.
    regime
        (cells,) uint8: index into `bow_classifier.verdict.regimes.REGIMES`.
    confidence
        (cells,) float32, 0 ... 1: probability that the regime is right, see `bow_classifier.verdict.confidence`.
    beat
        (cells,) float32, nominal periods: the beat of a wolf; NaN where the regime is another one.
    transient
        (cells,) float32, nominal periods: Guettler's transient so far, 0 = none yet; NaN where the gesture is not his.
    """

    correlation: NDArray[np.float32]
    period: NDArray[np.float32]
    slips: NDArray[np.uint16]
    corners: NDArray[np.uint16]
    regime: NDArray[np.uint8]
    confidence: NDArray[np.float32]
    beat: NDArray[np.float32]
    transient: NDArray[np.float32]

    @property
    def passed(self) -> NDArray[np.bool_]:
        """(cells,) whether the motion is Helmholtz motion: all three tests pass."""
        return is_helmholtz(self.regime)


class BlockClassifier:
    """Classifies the cells of one block chunk by chunk, from t = 0 on.

    A cell's verdicts do not depend, in any bit, on the other cells of the block.

    Parameters
    ----------
    geometry : Geometry
    thresholds : Thresholds
    cells
        Number of cells.
    bow_speed
        Final bow speed v_b, one or (cells,).
    bow_bridge
        Round trip bow-bridge-bow, samples, one or (cells,); None = that of the geometry. The third test needs beta
        below the threshold *corner*, 0.38: with the bow further from the bridge the ramp between two corners exceeds it
        too.
    periods
        Length of the run: in one of 150 periods or more a wolf is looked for, which needs 7 kB a cell.
    rise
        Where the bow is accelerated without end (``gesture=guettler``), by how much its speed rises each sample, one or
        (cells,); `bow_speed` has no meaning then. Slips are compared with the bow speed when they end, corners and
        r.m.s. with its mean over the window, and the verdicts have a transient.

    Attributes
    ----------
    features, decision
        What the latest verdicts were computed from; None before the first.

    Raises
    ------
    ValueError
        If a round trip is not a whole number of samples, or not shorter than the period; if a chunk is not whole
        periods.
    """

    def __init__(
        self,
        geometry: Geometry,
        thresholds: Thresholds,
        cells: int,
        bow_speed: ArrayLike = 1.0,
        bow_bridge: ArrayLike | None = None,
        periods: int = 0,
        rise: ArrayLike | None = None,
    ) -> None:
        self._geometry = geometry
        self._thresholds = thresholds
        v_b = np.broadcast_to(np.asarray(bow_speed, dtype=np.float64), (cells,))
        delay = _delays(geometry, cells, bow_bridge)
        height = v_b * geometry.period / delay
        self._rise = None if rise is None else np.broadcast_to(np.asarray(rise, np.float64), (cells,))
        strings = Strings(
            delay,
            height,
            corner=thresholds.corner * height,
            slip=thresholds.slip * v_b * geometry.period,
            rise=np.zeros(cells) if self._rise is None else thresholds.slip * self._rise * geometry.period,
            spread=(thresholds.flyback_cluster * delay).astype(np.float64),
            gap=(thresholds.cluster * delay).astype(np.float64),
        )
        self._beta = delay / geometry.period
        lags = Lags(*thresholds.lags(geometry.period), *thresholds.long_lags(geometry.period))
        if geometry.samples < LANES or geometry.samples % geometry.period or lags.first < 1:
            raise ValueError(f"{geometry}: a chunk should be whole periods, of 2 samples at least, and {LANES} in all")
        start = samples_before(lags.longest)  # more than any ripple period, which is less than a period
        self._setup = Setup(strings, lags, Limits.of(geometry.period, thresholds), start)
        self._state = BlockState(
            _read_only(np.zeros((cells, start), np.float32)),
            SlipState.at_rest(cells),
            WolfState.empty(cells if periods >= LEAST else 0, geometry.samples // geometry.period),
            Releases.none(0 if self._rise is None else cells),
        )
        self._chunks = 0
        self._entry: Any = None  # the pass, compiled; the types of its arguments stay the same
        self.features: Features | None = None
        self.decision: Decision | None = None

    def classify(self, bridge_force: NDArray[np.float32], intervals: Intervals) -> Verdicts:
        """Return the verdicts after the next chunk.

        Parameters
        ----------
        bridge_force
            (cells, samples) the wave out_B, units of PHYSICS.md section 2. It is kept until the next chunk and must not
            be changed before.
        intervals
            The slips of the same chunk.

        Raises
        ------
        ValueError
            If an array has another shape, or the slips cannot be or do not continue the chunk before; the state is then
            unchanged.
        """
        window = (len(self._beta), self._geometry.samples)
        if bridge_force.shape != window:
            raise ValueError(f"bridge force {bridge_force.shape}: should be (cells, samples) = {window}")
        result = Result(Features.empty(self._beta), Decision.empty(len(self._beta)))
        chunk = Chunk(_read_only(bridge_force), intervals.prepared(), self._chunks)
        arguments = self._state, chunk, self._setup_now(), result
        if self._entry is None:
            self._entry = entry(classify_cells, arguments)
        wrong = self._entry(*arguments)
        if wrong == DISORDER:
            raise ValueError(f"slip intervals: should be in order, separate, and within {window[1]} samples")
        if wrong >= 0:
            raise discontinuity(wrong, self._state.slips.slipping[wrong])
        self._state = self._state._replace(before=self._kept(chunk.bridge_force))
        self._chunks += 1
        self.features, self.decision = features, decision = result
        return Verdicts(
            features.correlation,
            features.period,
            features.slips,
            features.corners,
            decision.regime,
            decision.confidence,
            features.beat,
            features.transient,
        )

    def _kept(self, bridge_force: NDArray[np.float32]) -> NDArray[np.float32]:
        """Return what comes before the next chunk: this chunk, and more where it is too short."""
        if bridge_force.shape[1] >= self._setup.start:
            return bridge_force
        both = np.concatenate([self._state.before, bridge_force], axis=1)
        return _read_only(both[:, both.shape[1] - self._setup.start :])

    def _setup_now(self) -> Setup:
        """Return the setup for the next chunk; the thresholds follow a bow that is accelerated without end."""
        if self._rise is None:
            return self._setup
        strings, samples = self._setup.strings, self._geometry.samples
        start, period = self._chunks * samples, self._geometry.period
        height = self._rise * (start + samples / 2) * period / strings.delay
        corner, slip = self._thresholds.corner * height, strings.rise * start
        return self._setup._replace(strings=strings._replace(height=height, corner=corner, slip=slip))


def _read_only(bridge_force: NDArray[np.float32]) -> NDArray[np.float32]:
    """Return a read-only view, the one type that the pass is compiled for: arrays of a message are read-only too."""
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
