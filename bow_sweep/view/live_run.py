"""The dashboard of one run: what is drawn, and when. Takes the fields of messages and writes a recording; no ROS."""

from __future__ import annotations

import math
import re
import time
from collections.abc import Callable, Iterable, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from bow_sim.physics.errors import ParameterError
from bow_sim.protocol.states import PlanState
from bow_sim.protocol.sweep_outline import SweepOutline
from bow_sweep.cell.waveform import CellError
from bow_sweep.maps.plane import NOT_COMPUTED, Snapshot
from bow_sweep.maps.playability import playability
from bow_sweep.maps.terrain import terrain
from bow_sweep.view.lost_waveforms import Found, computed_again, from_bag
from bow_sweep.view.rerun_recording import RunRecording
from bow_sweep.view.status_page import NodeStatus, is_complete, page, playability_page, with_block_states
from bow_sweep.view.tests_over_time import finished_map

FILE = "dashboard.rrd"

STATUS_S = 1.0
"""Least time between two status pages."""

BUSY_SHARE = 0.1
"""Largest share of the time of one core that is used to draw maps: the sweep should not become slower."""

SOONEST_S, SPARSE_SHARE, SPARSE_S = 0.2, 0.01, 5.0
"""Least time between two maps; in a long sweep it grows to this share of the time so far, up to `SPARSE_S`, so that the
file stays small."""

LAST_MAP_S, FIRST_MAP_S = 0.5, 3.0
"""Time to wait for a complete map after the plan has closed; they come on separate topics. It is longer where no map
has come at all: the dashboard has just started, and DDS finds the topics of the coordinator one after the other."""

BAG_S, NO_RECORDER_S = 50.0, 3.0
"""Time to wait for the recorder to close the bag after the plan has closed, and where none was heard of."""

IDENTITY = re.compile("[0-9a-f]{16}")
"""A run_id. It becomes the name of a directory, so nothing else is accepted."""


class LiveRun:
    """Draws one run into a recording.

    Parameters
    ----------
    directory
        Of the run; it is made if there is none.
    plan
        The fields of the Plan that opened the run.
    inspected
        Cells whose waveforms are to be complete in the end, beside those that come.
    uri
        As for :class:`~bow_sweep.view.rerun_recording.RunRecording`.
    warn
        Called with a line for people where something failed.
    clock
        Returns seconds of a monotonic clock.

    Attributes
    ----------
    recording
        The recording.
    drawn, ignored
        Number of maps drawn; number of messages of other runs, or that were not valid.

    Raises
    ------
    ValueError
        Where the plan cannot be run.
    OSError
        Where the directory or the file cannot be written.
    """

    def __init__(
        self,
        directory: Path,
        plan: Mapping[str, Any],
        inspected: Iterable[int] = (),
        uri: str = "",
        warn: Callable[[str], object] = print,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self._outline = SweepOutline.of(plan)
        directory.mkdir(parents=True, exist_ok=True)
        empty = with_block_states(Snapshot.empty(self._outline), self._outline, plan["block_states"])
        self.recording = RunRecording(directory / FILE, empty, uri, warn, inspected)
        self.drawn = self.ignored = 0
        self._plan, self._clock, self._opened = plan, clock, clock()
        self._directory, self._warn = directory, warn
        self._recorder: bool | None = None  # whether it has closed the bag; None: not heard of
        self._closing: float | None = None
        self._next: Snapshot | None = None
        self._next_draw_at = self._status_at = 0.0
        self._cost = math.inf
        self.plan(plan)

    @property
    def run_id(self) -> str:
        """Of the run."""
        return self._outline.run_id

    @property
    def epoch(self) -> int:
        """Epoch of the coordinator, from the latest plan."""
        return int(self._plan["epoch"])

    def plan(self, plan: Mapping[str, Any]) -> None:
        """Take a Plan of this run; one with an older epoch comes from a coordinator that was replaced."""
        try:
            if plan["epoch"] < self.epoch:
                raise ParameterError(f"epoch {self.epoch} is in charge")
            self._outline = self._outline.grown(plan["rounds"])
        except ParameterError:
            self.ignored += 1
            return
        self._plan = plan
        if plan["state"] == PlanState.CLOSED and self._closing is None:
            self._closing = self._clock()

    def map(self, values: Mapping[str, Any]) -> None:
        """Take a BasinMap; it is drawn when enough time has passed since the last one."""
        if not self._is_mine(values):
            self.ignored += 1
            return
        try:
            snapshot = Snapshot.from_message(values)
        except ValueError:
            self.ignored += 1
            return
        self._next = snapshot.with_plan(self._outline.settings, self._outline.preset)
        self._draw_if_due()

    def inspect(self, values: Mapping[str, Any]) -> None:
        """Take an InspectedCell."""
        cell, force = values["cell"], values["bridge_force"]
        if not self._is_mine(values) or cell >= self._outline.plane_cells:  # repeats have no place of their own
            self.ignored += 1
            return
        if not values["attempt"]:  # of no block that was sent: somebody has chosen the cell
            self.recording.scope.choose(cell)
        self.recording.waveform([cell], values["first_sample"], force.reshape(1, -1))

    def tick(self, nodes: Iterable[NodeStatus]) -> bool:
        """Draw what is due; return whether the sweep has ended and nothing more will come."""
        self._draw_if_due()
        self.recording.draw_waveforms()
        now = self._clock()
        if now - self._status_at >= STATUS_S:
            self._status_at = now
            self._write_status(nodes, "in progress")
            self.recording.flush()
        if self._closing is None:
            return False
        latest = self._with_block_states(self._next or self.recording.snapshot)
        patience = LAST_MAP_S if self.drawn else FIRST_MAP_S
        waited = now - self._closing
        return (is_complete(latest) or waited > patience) and (self._has_bag() or waited > self._bag_patience())

    def recorder(self, closed: bool) -> None:
        """Take note that recorders work for this run, and whether all have closed their bags or given up."""
        self._recorder = closed

    def _has_bag(self) -> bool:
        """Return whether the waveforms can be completed, or are complete."""
        return self._recorder is True or not self.recording.missing(self._samples)

    def _bag_patience(self) -> float:
        return BAG_S if self._recorder is False else NO_RECORDER_S

    @property
    def _samples(self) -> int:
        """Of a waveform."""
        return self._outline.chunks * self._outline.chunk_samples

    def _draw_if_due(self) -> None:
        began, cpu = self._clock(), time.process_time()
        if self._next is None or began < self._next_draw_at:
            return
        self._draw(self._next)
        # the least cost so far: the first map includes its axes
        self._cost = min(self._cost, time.process_time() - cpu)
        sparse = min(SPARSE_S, SPARSE_SHARE * (began - self._opened))
        self._next_draw_at = began + max(self._cost / BUSY_SHARE, sparse, SOONEST_S)

    def _draw(self, snapshot: Snapshot) -> None:
        self._next = None
        self.drawn += 1
        self.recording.map(self._with_block_states(snapshot))

    def _with_block_states(self, snapshot: Snapshot) -> Snapshot:
        return with_block_states(snapshot, self._outline, self._plan["block_states"])

    def _is_mine(self, values: Mapping[str, Any]) -> bool:
        return (values["run_id"], values["sweep_id"]) == (self.run_id, self._outline.sweep_id)

    def _write_status(self, nodes: Iterable[NodeStatus], state: str) -> None:
        snapshot = self._with_block_states(self.recording.snapshot)
        text = page(snapshot, nodes, self._clock(), state, self.recording.rate(snapshot.done))
        if left_out := len(self.recording.scope.left_out):
            text += f"\nOf the inspected cells {left_out} are not shown: there is no space for more.\n"
        self.recording.status(text)

    def finish(self, nodes: Iterable[NodeStatus]) -> None:
        """Draw the last map, complete the waveforms, and finish the file."""
        self._draw(self._next or self.recording.snapshot)
        self._complete_waveforms()
        self._write_status(nodes, "finished" if self._plan["state"] == PlanState.CLOSED else "interrupted")
        self._terrain()
        self._tests()
        self.recording.finish()

    def _complete_waveforms(self) -> None:
        """Draw what did not reach this dashboard of the waveforms, as far as it can be had.

        Of a run that goes on, only a closed bag is read. A gap that stays is drawn as one at the end of the run.
        """
        over = self._plan["state"] == PlanState.CLOSED
        problems: list[str] = []
        if (over or self._recorder) and (missing := self.recording.missing(self._samples)):
            try:
                self._take(from_bag(self._directory, self.run_id, missing, problems))
            except (CellError, OSError) as error:
                problems.append(str(error))
        if over and (missing := self.recording.missing(self._samples)):
            self._take(computed_again(self._plan, self._outline, missing))
        if not over:
            return
        for cell, ranges in self.recording.missing(self._samples).items():
            parts = ", ".join(f"{first} to {end - 1}" for first, end in ranges)
            why = f": {problems[0]}" if problems else ""
            self._warn(f"the waveform of cell {cell} lacks samples {parts}{why}; it cannot be computed again here")
        self.recording.draw_rest()

    def _take(self, found: Iterable[Found]) -> None:
        for cell, first, force in found:
            self.recording.waveform([cell], first, force[np.newaxis])

    def close(self) -> None:
        """Close the file of a run that goes on."""
        self.recording.close()

    def _tests(self) -> None:
        """Draw every test, if the run is over."""
        if self._plan["state"] == PlanState.CLOSED:
            result = finished_map(self._directory, self.recording.snapshot)
            if result is not None:
                self.recording.tests(result)
                if result.reliability is not None:
                    self.recording.reliability(result.reliability.reliability)

    def _terrain(self) -> None:
        shown = self.recording.snapshot
        lengths = np.where(shown.mask() == NOT_COMPUTED, np.nan, shown.transient_periods)
        if not np.isnan(lengths).all():
            text = playability_page(playability(lengths, shown.regime, shown.regime_names))
            self.recording.terrain(terrain(lengths), text)
