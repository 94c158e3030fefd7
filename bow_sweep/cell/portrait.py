"""Everything that is shown of one cell, computed once: for the viewer, for a picture, for the terminal."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from bow_sim.physics.instruments import in_si
from bow_sim.physics.kinds import value_text
from bow_sweep.cell import analysis
from bow_sweep.cell.analysis import Harmonics, Spectrum
from bow_sweep.cell.cell_record import CellRecord
from bow_sweep.cell.motion import CellMotion, motion
from bow_sweep.maps.held_fixed import unit_of
from bow_sweep.maps.plane import regime_label

SHOWN_PERIODS = 4
"""Nominal periods at the end of the motion that are shown enlarged."""


@dataclass(frozen=True, eq=False)
class Portrait:
    """One cell and what follows from its waveform.

    Attributes
    ----------
    record
        The cell.
    motion
        The same cell simulated with every waveform; `motion.same` says whether it is the motion of the record.
    period
        Period at the end of the motion, samples; None where it has none near the nominal one.
    spectrum
        Of the last 20 periods.
    harmonics
        Of the same; None without a period.
    """

    record: CellRecord
    motion: CellMotion
    period: float | None
    spectrum: Spectrum
    harmonics: Harmonics | None

    @classmethod
    def of(cls, record: CellRecord) -> Portrait:
        """Analyse a cell."""
        force, rate = record.bridge_force, record.sample_rate
        period = analysis.period_of(force, record.period)
        return cls(
            record=record,
            motion=motion(record),
            period=period,
            spectrum=analysis.spectrum(force, rate, period or record.period),
            harmonics=None if period is None else analysis.harmonics(force, rate, period),
        )

    @property
    def last(self) -> slice:
        """The samples of the last periods, which are shown enlarged."""
        samples = len(self.record.bridge_force)
        return slice(max(0, samples - SHOWN_PERIODS * self.record.period), samples)

    def facts(self) -> list[tuple[str, str]]:
        """Return what is said of the cell in words: (name, text) of each line."""
        record = self.record
        tests = record.tests
        values = ((record.x_name, record.x), (record.y_name, record.y))
        lines = [(name, f"{value_text(name, value, '.6g')} {unit_of(name)}".rstrip()) for name, value in values]
        if si := in_si(vars(record.parameters)):
            words = [f"{name} {value:.4g} {unit_of(name)}".rstrip() for name, value in si.items()]
            lines.append(("in SI units", ", ".join(words)))
        if record.repeat:
            p = record.parameters
            lines.append(("this repeat", f"f_asym {p.f_asym:.6g}, f_init_ratio {p.f_init_ratio:.6g}"))
        if len(tests.periods):
            sure = float(tests.confidence[-1])
            last = regime_label(tests.name()) + ("" if np.isnan(sure) else f", confidence {sure:.2f}")
            if not np.isnan(tests.beat[-1]):
                last += f", beat {float(tests.beat[-1]):.1f} periods"
            lines.append(("regime at the end", last))
            lines.append(
                ("regimes", "; ".join(f"{a}-{b} {regime_label(name)}" for a, b, name in tests.runs()) + " (periods)")
            )
        lines.append(("transient", _transient(record.transient_periods)))
        lines.append(("pitch at the end", self._pitch()))
        checked = {True: "yes", False: "NO", None: "not possible"}[record.checked]
        lines.append(("waveform", {"bag": "from the bag", "computed": "computed again"}[record.source]))
        lines.append(("checked", f"{checked}: {record.why}"))
        if not self.motion.same:
            lines.append(("velocities", "of another motion than the bridge force: the kernel here is not the run's"))
        return lines

    def _pitch(self) -> str:
        if self.period is None:
            return "none: not periodic near the nominal period"
        cents = analysis.cents(self.period, self.record.period)
        return f"{self.record.sample_rate / self.period:.2f} Hz, {cents:+.1f} cents; period {self.period:.3f} samples"


def _transient(periods: float) -> str:
    if np.isnan(periods):
        return "not known: the cell was not done in the run"
    return f"{periods:g} periods" if periods else "never: no Helmholtz motion"
