"""What is known of one cell of a run, as plain arrays."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from bow_classifier.verdict.regimes import REGIMES, is_helmholtz
from bow_sim.physics.kinds import value_text
from bow_sim.physics.parameters import CHUNK_PERIODS, Parameters
from bow_sim.protocol.verdict_fields import PENDING
from bow_sweep.cell.waveform import Waveform
from bow_sweep.maps.basin_map import transient_lengths


@dataclass(frozen=True, eq=False)
class CellTests:
    """What the classifier said of a cell at each test. Arrays are (tests,).

    Attributes
    ----------
    periods
        Time of the test, nominal periods.
    regime
        uint8, index into `regime_names`; 255 = no verdict, or not kept (older runs keep the latest only).
    confidence
        float32, probability that the regime is right; NaN = not known.
    correlation, period
        float32, `period` in samples; NaN = no interior maximum, or no verdict.
    slips, corners
        uint16, number in the five periods before the test.
    helmholtz
        bool: whether all three tests passed.
    beat
        float32, nominal periods: of a wolf; NaN = none, or not kept.
    transient
        float32, nominal periods: Guettler's transient as known at the test, 0 = none yet; NaN for other gestures.
    """

    periods: np.ndarray
    regime: np.ndarray
    confidence: np.ndarray
    correlation: np.ndarray
    period: np.ndarray
    slips: np.ndarray
    corners: np.ndarray
    helmholtz: np.ndarray
    beat: np.ndarray
    transient: np.ndarray
    regime_names: tuple[str, ...]

    @classmethod
    def of(cls, layers: Mapping[str, np.ndarray]) -> CellTests:
        """Return the tests of a cell from its verdicts: field of a verdict -> (tests,)."""
        tests = len(layers["regime"])
        return cls(
            periods=np.arange(1, tests + 1) * CHUNK_PERIODS,
            helmholtz=is_helmholtz(layers["regime"]),
            regime_names=tuple(REGIMES),
            **layers,
        )

    @property
    def transient_periods(self) -> float:
        """Periods until the tests first passed, or Guettler's transient; 0 = never."""
        return float(transient_lengths(self.regime[:, None], self.transient[:, None])[0])

    def name(self, test: int = -1) -> str:
        """Return the name of the regime at a test; "pending" without a verdict."""
        code = int(self.regime[test]) if len(self.regime) else PENDING
        return self.regime_names[code] if code < len(self.regime_names) else "pending"

    def runs(self) -> list[tuple[int, int, str]]:
        """Return the regimes in their order: (first period, period after the last, name) of each stretch."""
        out: list[tuple[int, int, str]] = []
        begin = 0
        for test, end in enumerate(self.periods.tolist()):
            name = self.name(test)
            if out and out[-1][2] == name:
                out[-1] = (out[-1][0], int(end), name)
            else:
                out.append((begin, int(end), name))
            begin = int(end)
        return out


@dataclass(frozen=True, eq=False)
class CellRecord(Waveform):
    """One cell of a run.

    Attributes
    ----------
    run_id
        Of the run; "" where nothing says it.
    cell
        Index in the map, iy * nx + ix; repeats count on from there.
    repeat
        Number of the repeat, from 1; 0 = the cell itself.
    x_name, y_name, x, y
        The parameters of the map's axes, and their values in this cell.
    parameters
        Everything that decides the waveform.
    tests
        What the classifier said; of a computed cell on which the run has no verdicts, what it says here.
    transient_periods
        Periods until the tests first passed; 0 = never, NaN = not done.
    source
        "bag" or "computed".
    checked
        Whether the samples were held against the recorded ones: True, equal; False, not equal; None, nothing to hold
        them against. :meth:`bow_sweep.cell.run_cells.RunCells.record` says what is compared.
    why
        The same in a sentence, with the reason where the source is not the one expected.
    """

    run_id: str
    cell: int
    repeat: int
    x_name: str
    y_name: str
    x: float
    y: float
    parameters: Parameters
    tests: CellTests
    transient_periods: float
    source: str
    checked: bool | None
    why: str

    @property
    def sample_rate(self) -> float:
        """Samples per second."""
        return self.parameters.sample_rate

    @property
    def period(self) -> int:
        """Nominal period of the string, samples."""
        return self.parameters.period

    @property
    def settings(self) -> tuple[str, ...]:
        """Every parameter of the cell as "name=value", sorted."""
        return self.parameters.settings()

    @property
    def title(self) -> str:
        """The cell and the values of its two parameters, as text."""
        repeat = f", repeat {self.repeat}" if self.repeat else ""
        return f"cell {self.cell}{repeat}: {self.place()}"

    def place(self, equals: str = " ", form: str = ".4g") -> str:
        """Return the values of its two parameters, as text."""
        both = ((self.x_name, self.x), (self.y_name, self.y))
        return ", ".join(f"{name}{equals}{value_text(name, value, form)}" for name, value in both)
