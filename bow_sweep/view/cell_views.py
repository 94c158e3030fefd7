"""Single cells as a rerun recording: waveforms, slips, spectrum, friction, regimes, sound; a tab for each cell.

The recording is a file of its own, ``cells.rrd``, beside ``dashboard.rrd``: that one belongs to the dashboard, which
may still write it or continue it when the run is resumed, and to inspect a cell must not change what a run recorded.

There are two timelines with the same waveforms: `time` in seconds, on which the viewer also plays the sound, and
`sample`.
"""

from __future__ import annotations

import os
import re
import warnings
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import rerun as rr
import rerun.blueprint as rrb
from rerun.chunk import RrdReader

from bow_sweep.cell import analysis
from bow_sweep.cell.portrait import SHOWN_PERIODS, Portrait
from bow_sweep.cell.sound import Sound, sound_of, wav_bytes
from bow_sweep.figures.colours import GREY, regime_colours
from bow_sweep.maps.plane import regime_label
from bow_sweep.view import bounded
from bow_sweep.view.blueprint import GROUND
from bow_sweep.view.panel import Panel, limits_of

FILE = "cells.rrd"
"""Name of the recording in a run directory."""

APPLICATION = "bow_cells"

MOST = 12
"""Cells that a recording holds; the ones that were added first are left out beyond it."""

SOUND_SECONDS = 2.0

Colour = tuple[int, int, int]

FORCE, VELOCITY, BOW, SLIP, CURVE, FAINT = (
    (255, 150, 90),
    (120, 190, 255),
    (150, 150, 150),
    (230, 70, 60),
    (250, 220, 90),
    (95, 110, 130),
)
STICK = (58, 62, 70)
LINE_COLOUR, TEXT_COLOUR = (190, 192, 200), (235, 236, 240)

SPECTRUM_HZ = 12_000.0
"""Upper end of the spectrum that is shown."""

SPECTRUM_DB = 90.0
"""Range of the spectrum below its strongest line."""


def cells_in(path: Path, run_id: str) -> list[int]:
    """Return the cells that a recording of this run holds, in the order in which they were added; none without a file.

    Raises
    ------
    ValueError
        Where the file is not such a recording, or of another run.
    """
    if not path.exists():
        return []
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # a file without its footer
            reader = RrdReader(path)
            identities = {entry.recording_id for entry in reader.recordings()}
            found = {}
            for chunk in reader.stream():
                if match := re.search(r"cell_(\d+)/order$", str(chunk.entity_path)):
                    found[int(match[1])] = chunk.to_record_batch().column("number").to_pylist()[0]
    except Exception as error:  # rerun raises any type on a damaged file
        raise ValueError(f"{path}: cannot be read as a recording ({error}); move it away, or give --save") from None
    if identities != {_identity(run_id)}:
        raise ValueError(f"{path}: is not a recording of cells of run {run_id}; move it away, or give --save")
    return sorted(found, key=found.__getitem__)


def _identity(run_id: str) -> str:
    return f"{run_id}-cells"


def write_cells(path: Path, portraits: Sequence[Portrait]) -> None:
    """Write the recording of some cells of one run, a tab for each, the last one in front.

    It is written aside and put in its place when it is whole.

    Raises
    ------
    OSError
        Where the file cannot be written.
    """
    aside = path.with_name(f".{path.name}.{os.getpid()}.part")
    aside.touch()  # raises OSError with a reason, which rerun does not give
    record = rr.RecordingStream(APPLICATION, recording_id=_identity(portraits[0].record.run_id))
    try:
        record.save(aside)
        record.send_recording_name(f"cells of run {portraits[0].record.run_id}")
        for number, portrait in enumerate(portraits):
            _CellLog(record, portrait).everything(number)
        record.send_blueprint(_layout(portraits))
        bounded.finish(record)
        os.replace(aside, path)
    finally:
        aside.unlink(missing_ok=True)


def _root(portrait: Portrait) -> str:
    return f"cell_{portrait.record.cell}"


class _CellLog:
    """Logs one cell."""

    def __init__(self, record: rr.RecordingStream, portrait: Portrait) -> None:
        self._record, self._portrait, self._root = record, portrait, _root(portrait)
        self._rate = portrait.record.sample_rate
        samples = np.arange(len(portrait.record.bridge_force))
        self._columns = self._times(samples)

    def everything(self, number: int) -> None:
        self._static("order", rr.AnyValues(number=number))
        self._waveforms()
        self._slips()
        self._tests()
        self._friction()
        self._spectrum()
        self._facts()
        self._sound()

    def _times(self, samples: np.ndarray) -> list[rr.TimeColumn]:
        return [rr.TimeColumn("time", duration=samples / self._rate), rr.TimeColumn("sample", sequence=samples)]

    def _static(self, place: str, *values: object) -> None:
        self._record.log(f"{self._root}/{place}", *values, static=True)  # type: ignore[arg-type]  # archetypes

    def _series(self, place: str, name: str, colour: Colour, values: np.ndarray, width: float = 1.2) -> None:
        self._static(place, rr.SeriesLines(names=name, colors=colour, widths=width))
        columns = rr.Scalars.columns(scalars=np.asarray(values, float))
        self._record.send_columns(f"{self._root}/{place}", indexes=self._columns, columns=columns)

    def _waveforms(self) -> None:
        record, motion = self._portrait.record, self._portrait.motion
        self._series("bridge_force", "bridge force", FORCE, record.bridge_force)
        self._series("velocity/surface", "surface velocity v", VELOCITY, motion.v)
        self._series("velocity/bow", "bow velocity", BOW, motion.bow_speed)

    def _slips(self) -> None:
        """Log the slips: as a bar below the bridge force, and as a lane of states."""
        record = self._portrait.record
        low, high = float(record.bridge_force.min()), float(record.bridge_force.max())
        level = low - 0.08 * ((high - low) or 1.0)
        self._series("slip_bars", "slip", SLIP, np.where(record.slipping, level, np.nan), 5.0)
        change = np.flatnonzero(np.diff(record.slipping.astype(np.int8))) + 1
        at = np.concatenate([[0], change])
        names = ["slip" if slips else "stick" for slips in record.slipping[at]]
        self._states("states/motion", at, names, ["stick", "slip"], [STICK, SLIP])

    def _states(
        self, place: str, samples: np.ndarray, states: Sequence[str], names: Sequence[str], colours: Sequence[Colour]
    ) -> None:
        opaque = np.array([(*colour, 255) for colour in colours], np.uint8)
        self._static(place, rr.StateConfiguration(values=names, labels=names, colors=opaque))
        columns = rr.StateChange.columns(state=list(states))
        self._record.send_columns(f"{self._root}/{place}", indexes=self._times(samples), columns=columns)

    def _tests(self) -> None:
        """Log the period of the motion at each test, in the colour of the regime, and the regimes as a lane."""
        record = self._portrait.record
        tests = record.tests
        colours = dict(zip(tests.regime_names, regime_colours(tests.regime_names), strict=True))
        at = np.minimum(np.asarray(tests.periods, np.int64) * record.period, len(record.bridge_force) - 1)
        names = [tests.name(test) for test in range(len(at))]
        known = np.isfinite(tests.period)
        if known.any():
            cents = [analysis.cents(period, record.period) for period in tests.period[known].tolist()]
            own = [(*colours.get(name, GREY), 255) for name, is_known in zip(names, known, strict=True) if is_known]
            place = f"{self._root}/pitch"
            self._static(
                "pitch", rr.SeriesPoints(names="pitch at each test, in the colour of its regime", markers="circle")
            )
            columns = [
                *rr.Scalars.columns(scalars=cents),
                *rr.SeriesPoints.columns(colors=own, marker_sizes=np.full(len(own), 4.0)),
            ]
            self._record.send_columns(place, indexes=self._times(at[known]), columns=columns)
        if tests.runs():
            stretches = tests.runs()
            begin = np.array([start * record.period for start, _, _ in stretches])
            labels = [regime_label(name) for _, _, name in stretches]
            used = list(dict.fromkeys(name for _, _, name in stretches))
            self._states(
                "states/regime",
                begin,
                labels,
                [regime_label(name) for name in used],
                [colours.get(name, GREY) for name in used],
            )

    def _friction(self) -> None:
        """Draw the friction plane: friction force over the velocity of the arriving waves, and the curve of the law."""
        portrait = self._portrait
        motion = portrait.motion
        tail = slice(-analysis.TAIL_PERIODS * portrait.record.period, None)
        v_h, f = motion.v_h[tail], motion.friction_force[tail]
        curve = motion.curve()
        stick = np.array(curve.stick) if curve else np.zeros((0, 2))
        panel = Panel(
            limits_of(motion.v_h, stick[:, 0]),
            limits_of(motion.friction_force, stick[:, 1], np.zeros(1)),
            "velocity of the arriving waves v_h (bow speed)",
            "friction force f (bow speed x impedance)",
        )
        self._panel("friction", panel)
        self._dots("friction/transient", panel.place(motion.v_h, motion.friction_force), FAINT, 1.0, -20.0)
        if curve:
            slides = curve.v_h >= panel.x[0]
            branches = [panel.place(curve.v_h[slides], curve.f[slides]), panel.place(stick[:, 0], stick[:, 1])]
            self._strips("friction/curve", branches, CURVE, 1.0)
        self._dots("friction/steady", panel.place(v_h, f), VELOCITY, 1.8, 40.0)

    def _dots(self, place: str, points: np.ndarray, colour: Colour, radius: float, order: float) -> None:
        size = rr.Radius.ui_points(radius)
        self._static(place, rr.Points2D(points, radii=size, colors=colour, draw_order=order))

    def _spectrum(self) -> None:
        """Draw the spectrum of the last periods, and the harmonics."""
        spectrum, harmonics = self._portrait.spectrum, self._portrait.harmonics
        top = float(np.ceil(spectrum.level.max() / 10) * 10)
        high = min(SPECTRUM_HZ, float(spectrum.frequency[-1])) / 1000
        panel = Panel((0.0, high), (top - SPECTRUM_DB, top), "frequency (kHz)", "level (dB; 0 = amplitude 1)")
        self._panel("spectrum", panel)
        shown = spectrum.frequency <= 1000 * high
        line = panel.place(spectrum.frequency[shown] / 1000, spectrum.level[shown])
        self._strips("spectrum/line", [line], FAINT if harmonics else FORCE)
        if harmonics is None:
            return
        own = harmonics.frequency <= 1000 * high
        kilohertz, level = harmonics.frequency[own] / 1000, harmonics.level[own]
        foot = panel.place(kilohertz, np.full(len(level), panel.y[0]))
        head = panel.place(kilohertz, level)
        self._strips("spectrum/harmonics", list(np.stack([foot, head], axis=1)), FORCE)
        labels = [
            f"harmonic {number}: {hertz:.1f} Hz, {decibels:.1f} dB"
            for number, hertz, decibels in zip(harmonics.number[own], harmonics.frequency[own], level, strict=True)
        ]
        points = rr.Points2D(head, radii=rr.Radius.ui_points(2.5), colors=FORCE, labels=labels, show_labels=False)
        self._static("spectrum/heads", points)

    def _panel(self, place: str, panel: Panel) -> None:
        self._strips(f"{place}/axes", panel.lines(), LINE_COLOUR)
        points, texts = [label[:2] for label in panel.labels()], [label[2] for label in panel.labels()]
        shown = rr.Points2D(points, labels=texts, show_labels=True, radii=0.0, colors=TEXT_COLOUR)
        self._static(f"{place}/labels", shown)

    def _strips(self, place: str, strips: list[np.ndarray], colour: Colour, radius: float = 0.75) -> None:
        self._static(place, rr.LineStrips2D(strips, colors=colour, radii=rr.Radius.ui_points(radius)))

    def _facts(self) -> None:
        lines = [f"| {name} | {text} |" for name, text in self._portrait.facts()]
        text = "\n".join([f"**Cell {self._portrait.record.cell}**", "", lines[0], "|---|---|", *lines[1:]])
        self._static("facts", rr.TextDocument(text, media_type=rr.MediaType.MARKDOWN))

    def _sound(self) -> None:
        """Log the sound at the beginning of the time, and an end mark, so that the time lasts as long as the sound."""
        record = self._portrait.record
        made: Sound = sound_of(record.bridge_force, record.parameters, SOUND_SECONDS)
        self._record.reset_time()
        for seconds, what in (
            (0.0, rr.AssetAudio(contents=wav_bytes(made.samples), media_type="audio/wav")),
            (made.seconds, rr.AnyValues(sound="end")),
        ):
            place = "sound" if not seconds else "sound_end"
            self._record.set_time("time", duration=seconds)
            self._record.log(f"{self._root}/{place}", what)
        self._record.reset_time()


# ---- layout


NO_LEGEND = rrb.PlotLegend(visible=False)
"""Titles say what is drawn; a legend would cover it."""


def _layout(portraits: Sequence[Portrait]) -> rrb.Blueprint:
    return rrb.Blueprint(
        rrb.Tabs(*(_tab(portrait) for portrait in portraits), active_tab=len(portraits) - 1),
        rrb.BlueprintPanel(state="collapsed"),
        rrb.SelectionPanel(state="collapsed"),
        rrb.TimePanel(state="collapsed", timeline="time", play_state="paused"),
        auto_layout=False,
        auto_views=False,
    )


def _tab(portrait: Portrait) -> rrb.Horizontal:
    record, root = portrait.record, _root(portrait)
    whole = _axis(0, len(record.bridge_force), record.sample_rate)
    last = _axis(portrait.last.start, portrait.last.stop, record.sample_rate)
    force, speed = [f"/{root}/bridge_force", f"/{root}/slip_bars"], [f"/{root}/velocity/**"]
    ending = f"last {SHOWN_PERIODS} periods"
    rows: list[tuple[float, rrb.View | rrb.Container]] = [
        (3, _over_time(force, "Bridge force (bow speed = 1); red: slips", whole)),
        (2, rrb.StateTimelineView(origin=f"{root}/states", name="Stick and slip, regime", time_view=whole)),
        (3, _over_time(speed, "Surface velocity v (bow speed = 1); grey: bow", whole)),
        (
            2,
            _over_time(
                [f"/{root}/pitch"], "Pitch at each test, cents above nominal, in the colour of the regime", whole
            ),
        ),
        (
            4,
            rrb.Horizontal(
                _over_time(force, f"Bridge force, {ending}", last),
                _over_time(speed, f"Surface velocity, {ending}", last),
            ),
        ),
    ]
    side: list[tuple[float, rrb.View]] = [
        (6, rrb.TextDocumentView(origin=f"{root}/facts", name="Cell")),
        (6, _diagram(f"{root}/friction", "Friction plane: the last periods (blue) on the friction curve (yellow)")),
        (6, _diagram(f"{root}/spectrum", "Spectrum of the last periods, harmonics")),
        (2, rrb.AudioView(origin=f"{root}/sound", name="Sound: press play below")),
    ]
    name = f"{record.place(form='.3g')} (cell {record.cell})"
    return rrb.Horizontal(
        rrb.Vertical(*(view for _, view in rows), row_shares=[share for share, _ in rows]),
        rrb.Vertical(*(view for _, view in side), row_shares=[share for share, _ in side]),
        column_shares=[5, 3],
        name=name,
    )


def _over_time(contents: list[str], name: str, axis: rrb.TimeAxis) -> rrb.TimeSeriesView:
    return rrb.TimeSeriesView(origin="/", contents=contents, name=name, axis_x=axis, plot_legend=NO_LEGEND)


def _axis(first: int, after: int, rate: float) -> rrb.TimeAxis:
    start, end = (rrb.TimeRangeBoundary.absolute(seconds=sample / rate) for sample in (first, after))
    return rrb.TimeAxis(view_range=rrb.TimeRange(start=start, end=end))


def _diagram(origin: str, name: str) -> rrb.Spatial2DView:
    (left, right), (top, bottom) = Panel((0, 1), (0, 1), "", "").bounds
    bounds = rrb.VisualBounds2D(x_range=(left, right), y_range=(top, bottom))
    return rrb.Spatial2DView(origin=origin, name=name, background=GROUND, visual_bounds=bounds)
