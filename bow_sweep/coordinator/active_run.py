"""The run in progress: its state beyond the ledger, and what is published about it. No ROS, no clock."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from bow_sim.protocol.states import PlanState
from bow_sweep.coordinator import messages
from bow_sweep.coordinator.results import writing
from bow_sweep.coordinator.session_events import ResultsWritten
from bow_sweep.maps.basin_map import Basin, place
from bow_sweep.run.directory import Run
from bow_sweep.run.ledger import State

PROGRESS_S = 0.3
"""Block states, map and feedback are published at the first tick after this many seconds: every 0.4 s. All nodes take
in the states, the recorder stores the maps, and the dashboard draws them."""

MAP_CELLS_PER_S = 250_000
"""Cells of the maps that are published in a second, at most: maps of more than 100,000 cells go out less often than
2.5 Hz. A cell costs the coordinator some 100 ns, for the map and its two images."""


@dataclass
class ActiveRun:
    """A run that is open or closing.

    Attributes
    ----------
    run, basin
        The run and its map so far.
    began
        Seconds of the wall clock.
    goal
        UUID of the goal that asked for the run; None if parameters of the node did.
    dashboard
        Whether a dashboard, where there is one, draws the run.
    done_before
        Cells that were done when the run was resumed.
    cancelled
        A client has asked to cancel the goal.
    closed_at
        Seconds at which it began to close; None while it is open.
    results
        What came of writing map and picture; None before that.
    plan, plan_at
        The latest plan that was published, and when.
    map_at
        When the latest map was published.
    progress_at
        When block states, map and feedback were published last, or the run began.
    """

    run: Run
    basin: Basin
    began: float
    goal: bytes | None
    dashboard: bool = True
    done_before: int = field(init=False)
    cancelled: bool = False
    closed_at: float | None = None
    results: ResultsWritten | None = None
    plan: bytes = b""
    plan_at: float = 0.0
    map_at: float = float("-inf")
    progress_at: float = 0.0
    _published_tests: int = field(default=-1, init=False)
    _cells: dict[int, tuple[bytes, np.ndarray | slice]] = field(default_factory=dict, init=False)

    def __post_init__(self) -> None:
        self.done_before = self.run.cells_in(State.DONE)

    @property
    def is_closing(self) -> bool:
        """Whether all work is over: blocks that are outstanding were cancelled."""
        return self.closed_at is not None

    def is_mine(self, values: Mapping[str, Any]) -> bool:
        """Return whether a decoded message belongs to this run."""
        return (values["run_id"], values["sweep_id"]) == (self.run.run_id, self.run.sweep.sweep_id)

    def are_my_verdicts(self, values: Mapping[str, Any]) -> bool:
        """Return whether verdicts of this run are on one of its blocks, by the classifier that the plan asks for."""
        run, block = self.run, values["block"]
        return (
            values["classifier"] == run.sweep.thresholds.hash
            and block < run.blocks.count
            and values["chunk"] < run.ledger.chunks
            and values["cells"].tobytes() == self._cells_of(block)[0]
        )

    def place_of(self, block: int) -> np.ndarray | slice:
        """Return where in the map the cells of a block are."""
        return self._cells_of(block)[1]

    def _cells_of(self, block: int) -> tuple[bytes, np.ndarray | slice]:
        """Return the cells of a block as they are in messages, and where in the map they are."""
        known = self._cells.get(block)
        if known is None:
            cells = self.run.blocks.block(block)
            known = self._cells[block] = cells.tobytes(), place(cells)
        return known

    def plan_message(self, coordinator: str) -> bytes:
        """Return the Plan; `coordinator` is an incarnation."""
        return messages.plan_message(self.run, PlanState.CLOSED if self.is_closing else PlanState.OPEN, coordinator)

    def is_progress_due(self, now: float) -> bool:
        """Return whether block states, map and feedback may be published again."""
        return now - self.progress_at >= PROGRESS_S

    def is_map_due(self, now: float) -> bool:
        """Return whether a map of this size may be published again while the run is open."""
        return now - self.map_at >= self.run.sweep.cells / MAP_CELLS_PER_S

    def new_map(self) -> dict[str, Any] | None:
        """Return the fields of a BasinMap; None if it has no more tests than at the call before."""
        tests = int(self.basin.tested.sum())
        if tests == self._published_tests:
            return None
        self._published_tests = tests
        return messages.map_values(self.run, self.basin)

    def feedback(self, wall_clock: float) -> dict[str, Any]:
        """Return the fields of RunSweep.Feedback."""
        rate = self._cells_this_time / max(wall_clock - self.began, 1e-9)
        return messages.feedback_values(self.run, self.basin, rate)

    def write_report(self, wall_clock: float, results: ResultsWritten) -> dict[str, Any]:
        """Write the report of the run and return the fields of RunSweep.Result.

        Raises
        ------
        RunError
            If it cannot be written.
        """
        extra = {
            "cells_this_time": self._cells_this_time,
            "playability": results.playability,
            "not_drawn": results.problem,
        }
        with writing(self.run.directory):
            report = self.run.report(self.basin, wall_clock - self.began, extra)
        return messages.result_values(self.run, report)

    @property
    def _cells_this_time(self) -> int:
        return self.run.cells_in(State.DONE) - self.done_before
