"""One cell of a map: its waveform, what it shows, and how it sounds."""

from __future__ import annotations

from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from bow_sim.physics.kinds import MODEL, model_name
from bow_sim.physics.parameters import Parameters
from bow_sweep.cell import analysis
from bow_sweep.cell.analysis import Harmonics, Spectrum
from bow_sweep.cell.cell_record import CellRecord, CellTests

if TYPE_CHECKING:
    import xarray

    from bow.shown import Picture, Sound
    from bow_sweep.cell.portrait import Portrait

SLIPS = np.dtype([("onset", np.int64), ("duration", np.int64), ("slip", np.float64)])
"""What is known of a slip: first slipping sample and number of samples; sum of the slip speed, the final bow speed = 1,
over those samples."""


class Cell:
    """One cell of a map. :meth:`bow.Map.cell` returns it.

    Parameters
    ----------
    record
        What is known of the cell.

    Examples
    --------
    >>> import bow
    >>> c = bow.sweep("fig11d", nx=8, ny=4, periods=20, progress=False).cell(12)
    >>> c
    <bow.Cell 12: f_asym 4.12, f_init_ratio 0.667; multiple_slip, never Helmholtz motion; computed>
    >>> c.slips.dtype.names
    ('onset', 'duration', 'slip')
    >>> frequency, level = c.spectrum()
    >>> c.audio().rate
    48000
    """

    def __init__(self, record: CellRecord) -> None:
        self.record = record

    def __repr__(self) -> str:
        where = self.record.place(form=".3g")
        length = self.transient_periods
        came = f"Helmholtz motion after {length:g} periods" if length > 0 else "never Helmholtz motion"
        return f"<bow.Cell {self.index}: {where}; {self.regime}, {came}; {self.source}>"

    # ---- which cell it is

    @property
    def index(self) -> int:
        """Number of the cell, iy * nx + ix."""
        return self.record.cell

    @property
    def at(self) -> dict[str, Any]:
        """The values of the map's two parameters; a model by its name."""
        both = ((self.record.x_name, self.record.x), (self.record.y_name, self.record.y))
        return {name: model_name(value) if name == MODEL else value for name, value in both}

    @property
    def parameters(self) -> Parameters:
        """Everything that decides the waveform."""
        return self.record.parameters

    @property
    def sample_rate(self) -> float:
        """Samples per second."""
        return self.record.sample_rate

    @property
    def source(self) -> str:
        """Where the waveform is from: "bag" or "computed"."""
        return self.record.source

    @property
    def checked(self) -> bool | None:
        """Whether the waveform is the recorded one; None: there is nothing to hold it against."""
        return self.record.checked

    @property
    def why(self) -> str:
        """The same in a sentence."""
        return self.record.why

    # ---- its motion

    @property
    def bridge_force(self) -> NDArray[np.float32]:
        """(samples,) bridge force, final bow speed = 1."""
        return self.record.bridge_force

    @property
    def time(self) -> NDArray[np.float64]:
        """(samples,) seconds."""
        return np.arange(len(self.bridge_force)) / self.sample_rate

    @cached_property
    def slips(self) -> NDArray[np.void]:
        """(slips,) records of `SLIPS`: onset and duration in samples, sum of the slip speed."""
        out = np.empty(len(self.record.onsets), SLIPS)
        out["onset"], out["duration"], out["slip"] = self.record.onsets, self.record.durations, self.record.slips
        return out

    @property
    def slipping(self) -> NDArray[np.bool_]:
        """(samples,) whether the string slips."""
        return self.record.slipping

    @property
    def ds(self) -> xarray.Dataset:
        """Bridge force and slipping over time as an xarray.Dataset.

        Raises
        ------
        MissingLibrary
            Where xarray is not installed; it is an ImportError.
        """
        from bow.dataset import waveform

        return waveform(self.record)

    # ---- what was found

    @property
    def transient_periods(self) -> float:
        """Periods until Helmholtz motion; 0 = never, NaN = not done."""
        return self.record.transient_periods

    @property
    def regime(self) -> str:
        """Name of the regime at the last test."""
        return self.record.tests.name()

    @property
    def tests(self) -> CellTests:
        """What the classifier said at each test."""
        return self.record.tests

    @cached_property
    def period(self) -> float | None:
        """Period at the end of the motion, samples; None where there is none near the nominal one."""
        return analysis.period_of(self.bridge_force, self.record.period)

    @property
    def frequency(self) -> float | None:
        """Frequency at the end of the motion, Hz; None where there is none near the nominal one."""
        return None if self.period is None else self.sample_rate / self.period

    def spectrum(self, periods: int | None = None) -> Spectrum:
        """Return the amplitude spectrum (frequency in Hz, level in dB) of the last 20 periods, or of `periods`."""
        length = self.period or self.record.period
        return analysis.spectrum(self.bridge_force, self.sample_rate, length, periods or analysis.TAIL_PERIODS)

    def harmonics(self) -> Harmonics | None:
        """Return number, frequency and level of the harmonics of the last 20 periods; None without a period."""
        return None if self.period is None else analysis.harmonics(self.bridge_force, self.sample_rate, self.period)

    # ---- seen and heard

    @cached_property
    def portrait(self) -> Portrait:
        """The cell simulated again with every waveform: `portrait.motion` has velocity and friction force."""
        from bow_sweep.cell.portrait import Portrait

        return Portrait.of(self.record)

    def plot(self) -> Picture:
        """Return a picture of the cell: force and slips, velocity, pitch and regimes, friction, spectrum."""
        from bow.shown import Picture
        from bow_sim.figures.page import style
        from bow_sweep.cell.picture import picture

        with style():
            return Picture(picture(self.portrait), self.record.title)

    def audio(self, seconds: float | None = None, body: bool = False) -> Sound:
        """Return the bridge force as sound at 48 kHz; a notebook plays it.

        Parameters
        ----------
        seconds
            Length: the string is simulated on. None: that of the waveform.
        body
            Whether to let it pass through a violin's body, see :mod:`bow_sweep.cell.body`.

        Raises
        ------
        SoundError
            For a length that cannot be; it is a ValueError.
        """
        from bow.shown import Sound
        from bow_sweep.cell.sound import RATE, sound_of

        made = sound_of(self.bridge_force, self.parameters, seconds, body)
        return Sound(made.samples, RATE, made.how)

    def _repr_png_(self) -> bytes:
        return self.plot()._repr_png_()
