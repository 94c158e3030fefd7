"""The dashboard of a measured string: regimes, tests and bridge force over time. Takes fields of messages; no ROS.

It has no map: there is one string, and its time goes on. It stands in for :class:`bow_sweep.view.live_run.LiveRun` in
the dashboard node. Time is in seconds since the run began.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import rerun as rr
import rerun.blueprint as rrb

from bow_classifier.verdict.regimes import HELMHOLTZ, REGIMES, is_helmholtz
from bow_sim.physics.parameters import CHUNK_PERIODS
from bow_sim.protocol.states import PlanState
from bow_sim.protocol.sweep_outline import SweepOutline
from bow_sweep.cell.analysis import cents
from bow_sweep.figures.colours import regime_colours
from bow_sweep.maps.plane import regime_label
from bow_sweep.view import bounded
from bow_sweep.view.blueprint import UNSEEN, send
from bow_sweep.view.rerun_recording import ANSWER_S, APPLICATION
from bow_sweep.view.status_page import NodeStatus
from bow_sweep.view.viewer import answers

FILE = "dashboard.rrd"

SHOWN_S = 10.0
"""Seconds of the latest regimes and tests that are shown."""

FORCE_PERIODS = 20
"""Nominal periods of the latest bridge force that are shown."""

FORCE_COLOUR = (255, 150, 90)

SERIES = {
    "correlation": ("Test 1: correlation of successive periods", (86, 180, 233)),
    "slips": ("Test 2: significant slips in five periods", (230, 159, 0)),
    "corners": ("Test 3: travelling corners in five periods", (0, 158, 115)),
    "pitch": ("Pitch, cents above f0", (204, 121, 167)),
}


class Written(NamedTuple):
    """The file that is written; :class:`bow_sweep.view.node.DashboardNode` asks for its path."""

    path: Path


class MeasuredView:
    """Draws the run of a measured string into a recording.

    Parameters
    ----------
    directory
        Of the run; it is made if there is none.
    plan
        The fields of the Plan that opened it.
    uri
        Of a viewer or server that shows the recording live; "" for none.
    warn
        Called with a line for people where something failed.

    Raises
    ------
    ValueError
        Where the plan cannot be.
    OSError
        Where the directory cannot be made.
    """

    def __init__(
        self,
        directory: Path,
        plan: Mapping[str, Any],
        uri: str = "",
        warn: Callable[[str], object] = print,
    ) -> None:
        self._outline = SweepOutline.of(plan)
        directory.mkdir(parents=True, exist_ok=True)
        self.recording = Written(directory / FILE)
        self.ignored = 0
        self._plan, self._names = plan, REGIMES
        self._string = self._outline.parameters
        self._tests = 0
        self._drawn: set[tuple[str, int]] = set()  # what, and of which chunk: unanswered chunks are sent again
        self._regime = -1
        self._closed_for = 0
        self._record = bounded.opened(rr.RecordingStream(APPLICATION, recording_id=self.run_id))
        sinks: list[Any] = [rr.FileSink(self.recording.path)]
        if uri and answers(uri, ANSWER_S):
            sinks.append(rr.GrpcSink(uri))
        elif uri:
            warn(f"nothing is shown live: nothing listens at {uri}")
        self._record.set_sinks(*sinks)
        send(self._blueprint(), APPLICATION, self._record)
        self._say()

    @property
    def run_id(self) -> str:
        """Of the run."""
        return self._outline.run_id

    @property
    def epoch(self) -> int:
        """Of the plan."""
        return int(self._plan["epoch"])

    def _blueprint(self) -> rrb.Blueprint:
        latest = _latest(SHOWN_S)
        series = [
            rrb.TimeSeriesView(origin=name, name=title, axis_x=latest, plot_legend=UNSEEN)
            for name, (title, _) in SERIES.items()
        ]
        rows = [
            rrb.StateTimelineView(origin="regime", name="Regime, every five periods", time_view=latest),
            *series,
            rrb.TimeSeriesView(
                origin="force",
                name=f"Bridge force, the latest {FORCE_PERIODS} periods (bow speed = 1)",
                axis_x=_latest(FORCE_PERIODS * self._string.period / self._string.sample_rate),
                plot_legend=UNSEEN,
            ),
        ]
        return rrb.Blueprint(
            rrb.Horizontal(
                rrb.Vertical(*rows, row_shares=[2, 2, 2, 2, 2, 3]),
                rrb.TextDocumentView(origin="about", name="What is measured"),
                column_shares=[4, 1],
            ),
            rrb.BlueprintPanel(state="collapsed"),
            rrb.SelectionPanel(state="collapsed"),
            rrb.TimePanel(state="collapsed", timeline="time", play_state="following"),
            auto_layout=False,
            auto_views=False,
        )

    def _say(self) -> None:
        """Log names and colours of the lines."""
        labels = [regime_label(name) for name in self._names]
        opaque = np.array([(*colour, 255) for colour in regime_colours(self._names)], np.uint8)
        self._record.log("regime", rr.StateConfiguration(values=labels, labels=labels, colors=opaque), static=True)
        for name, (title, colour) in SERIES.items():
            self._record.log(name, rr.SeriesLines(names=title, colors=colour, widths=1.5), static=True)
        self._record.log("force", rr.SeriesLines(names="bridge force", colors=FORCE_COLOUR, widths=1.0), static=True)
        self._describe()

    def _describe(self) -> None:
        counted = f"{self._tests} tests, {self._tests * CHUNK_PERIODS / self._frequency:.1f} s"
        ended = ", finished" if self._plan["state"] == PlanState.CLOSED else ""
        lines = [f"**Run {self.run_id}**{ended}", str(self._plan["fingerprint"]), counted]
        page = rr.TextDocument("\n\n".join(lines), media_type=rr.MediaType.MARKDOWN)
        self._record.log("about", page, static=True)

    @property
    def _frequency(self) -> float:
        return self._string.sample_rate / self._string.period

    # ---- messages

    def plan(self, plan: Mapping[str, Any]) -> None:
        """Take a Plan of this run."""
        self._plan = plan

    def map(self, values: Mapping[str, Any]) -> None:
        """Count a map: a measured string has none."""
        self.ignored += 1

    def inspect(self, values: Mapping[str, Any]) -> None:
        """Count the waveform of a cell: a measured string has none."""
        self.ignored += 1

    def recorder(self, closed: bool) -> None:
        """Do nothing: everything is drawn from messages."""

    def verdicts(self, values: Mapping[str, Any]) -> None:
        """Draw decoded verdicts."""
        if not self._is_new("verdicts", values):
            return
        self._tests += 1
        self._now((values["chunk"] + 1) * CHUNK_PERIODS / self._frequency)
        code = int(values["regime"][0])
        code = HELMHOLTZ if is_helmholtz(code) else code  # extra slips cannot be told from a force alone
        if code != self._regime:
            self._regime = code
            name = self._names[code] if code < len(self._names) else f"code {code}"
            self._record.log("regime", rr.StateChange(state=regime_label(name)))
        for name in ("correlation", "slips", "corners"):
            self._record.log(name, rr.Scalars(float(values[name][0])))
        period = float(values["period"][0])
        self._record.log("pitch", rr.Scalars(cents(period, self._string.period) if period > 0 else np.nan))

    def force(self, values: Mapping[str, Any]) -> None:
        """Draw a decoded BridgeForce."""
        if not self._is_new("force", values):
            return
        at = (values["first_sample"] + np.arange(values["samples"])) / self._string.sample_rate
        self._record.send_columns(
            "force",
            indexes=[rr.TimeColumn("time", duration=at)],
            columns=rr.Scalars.columns(scalars=np.array(values["data"], float)),
        )

    def _is_new(self, what: str, values: Mapping[str, Any]) -> bool:
        """Return whether a message is of this run, and none like it was drawn before."""
        of = (what, values["chunk"])
        if not len(values["cells"]) or values["run_id"] != self.run_id or of in self._drawn:
            return False
        self._drawn.add(of)
        return True

    def _now(self, seconds: float) -> None:
        self._record.reset_time()
        self._record.set_time("time", duration=seconds)

    # ---- time

    def tick(self, nodes: Iterable[NodeStatus]) -> bool:
        """Return whether the run is over, and what may still be under way has had a second."""
        self._describe()
        self._closed_for += self._plan["state"] == PlanState.CLOSED
        return self._closed_for > 10

    def finish(self, nodes: Iterable[NodeStatus]) -> None:
        """Finish the file."""
        self._describe()
        bounded.finish(self._record)

    close = finish


def _latest(seconds: float) -> rrb.TimeAxis:
    """Return an axis of the last seconds before now."""
    begin, end = (rrb.TimeRangeBoundary.cursor_relative(seconds=at) for at in (-seconds, 0.0))
    return rrb.TimeAxis(view_range=rrb.TimeRange(start=begin, end=end))
