"""One run on show: what of it is drawn when. Messages in as plain fields, pictures out; no ROS in here."""

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
from bow_sweep.maps.plane import NOT_COMPUTED, Snapshot
from bow_sweep.maps.playability import playability
from bow_sweep.maps.terrain import terrain
from bow_sweep.view.rerun_recording import Board
from bow_sweep.view.status_page import Node, is_complete, page, playability_page, with_block_states

FILE = "dashboard.rrd"

ACCOUNT_S = 1.0
"""Accounts are written at most so often."""

BUSY_SHARE = 0.1
"""Maps are drawn as they come, but in no more than this share of one core's time: a sweep should not feel it."""

SOONEST_S, SPARSE_SHARE, SPARSE_S = 0.2, 0.01, 5.0
"""Maps are at least so far apart. A long sweep gets one at every hundredth of its age, and one in five seconds at
least: its file stays small."""

LAST_MAP_S, FIRST_MAP_S = 0.5, 3.0
"""How long to wait after the plan closes for a map that holds all that is done: they come on separate topics. Longer
where no map has come at all: we have only just started, and the coordinator's topics are found one by one."""

IDENTITY = re.compile("[0-9a-f]{16}")
"""A run_id, as Plan.msg has it. It names a directory: nothing else will do."""


class Show:
    """Shows one run.

    Parameters
    ----------
    directory
        Of the run; made if there is none.
    plan
        The fields of the Plan that opened it.
    port, server_memory
        As of :class:`~bow_sweep.view.rerun_recording.Board`.
    warn
        Takes what could not be done, for people.
    clock
        Seconds that only grow.

    Attributes
    ----------
    board
        The recording.
    drawn, ignored
        Maps drawn; messages that were not this run's or made no sense.

    Raises
    ------
    ValueError
        Where the plan makes no sense.
    OSError
        Where the directory or the file cannot be written.
    """

    def __init__(
        self,
        directory: Path,
        plan: Mapping[str, Any],
        port: int = 0,
        server_memory: str = "256MiB",
        warn: Callable[[str], object] = print,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self._outline = SweepOutline.of(plan)
        directory.mkdir(parents=True, exist_ok=True)
        empty = with_block_states(Snapshot.empty(self._outline), self._outline, plan["block_states"])
        self.board = Board(directory / FILE, empty, port, server_memory, warn)
        self.drawn = self.ignored = 0
        self._plan, self._clock, self._opened = plan, clock, clock()
        self._closing: float | None = None
        self._next: Snapshot | None = None
        self._rest_until = self._told = 0.0
        self._cost = math.inf
        self.plan(plan)

    @property
    def run_id(self) -> str:
        """Identity of the run."""
        return self._outline.run_id

    @property
    def epoch(self) -> int:
        """Of the coordinator, at the latest plan."""
        return int(self._plan["epoch"])

    def plan(self, plan: Mapping[str, Any]) -> None:
        """Take in a plan of this run; one of an older epoch comes from a coordinator no longer in charge."""
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
        """Take in a BasinMap; it is drawn when the last one is far enough back."""
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
        """Take in a BridgeForce of cells under inspection."""
        cells, samples = values["cells"].tolist(), values["samples"]
        if not self._is_mine(values) or max(cells, default=0) >= self._outline.cells:
            self.ignored += 1
            return
        self.board.waveform(cells, values["first_sample"], values["data"].reshape(len(cells), samples))

    def tick(self, nodes: Iterable[Node]) -> bool:
        """Do what is due now; return whether the sweep is over and nothing more is to come."""
        self._draw_if_due()
        self.board.draw_waveforms()
        now = self._clock()
        if now - self._told >= ACCOUNT_S:
            self._told = now
            self._account(nodes, "in progress")
            self.board.flush()
        if self._closing is None:
            return False
        latest = self._with_block_states(self._next or self.board.snapshot)
        patience = LAST_MAP_S if self.drawn else FIRST_MAP_S
        return is_complete(latest) or now - self._closing > patience

    def _draw_if_due(self) -> None:
        began, cpu = self._clock(), time.process_time()
        if self._next is None or began < self._rest_until:
            return
        self._draw(self._next)
        # the least cost seen: the first map draws its axes too
        self._cost = min(self._cost, time.process_time() - cpu)
        sparse = min(SPARSE_S, SPARSE_SHARE * (began - self._opened))
        self._rest_until = began + max(self._cost / BUSY_SHARE, sparse, SOONEST_S)

    def _draw(self, snapshot: Snapshot) -> None:
        self._next = None
        self.drawn += 1
        self.board.map(self._with_block_states(snapshot))

    def _with_block_states(self, snapshot: Snapshot) -> Snapshot:
        return with_block_states(snapshot, self._outline, self._plan["block_states"])

    def _is_mine(self, values: Mapping[str, Any]) -> bool:
        return (values["run_id"], values["sweep_id"]) == (self.run_id, self._outline.sweep_id)

    def _account(self, nodes: Iterable[Node], state: str) -> None:
        snapshot = self._with_block_states(self.board.snapshot)
        text = page(snapshot, nodes, self._clock(), state, self.board.rate(snapshot.done))
        if self.board.scope.left_out:
            text += f"\nOf the cells under inspection {len(self.board.scope.left_out)} are not shown: no room.\n"
        self.board.account(text)

    def finish(self, nodes: Iterable[Node]) -> None:
        """Draw what is left and finish the file. A server goes on until :meth:`close`."""
        self._draw(self._next or self.board.snapshot)
        self._account(nodes, "finished" if self._plan["state"] == PlanState.CLOSED else "interrupted")
        self._terrain()
        self.board.finish()

    def _terrain(self) -> None:
        shown = self.board.snapshot
        lengths = np.where(shown.mask() == NOT_COMPUTED, np.nan, shown.transient_periods)
        if not np.isnan(lengths).all():
            text = playability_page(playability(lengths, shown.regime, shown.regime_names))
            self.board.terrain(terrain(lengths), text)

    def close(self) -> None:
        """Let go of everything."""
        self.board.close()
