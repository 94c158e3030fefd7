"""The coordinator without ROS: a state machine that runs one sweep after another, events in, instructions out.

:meth:`CoordinatorSession.handle` is the only way in. The node around it passes in what arrives, together with the time,
and carries out the instructions that come back, in their order. The session reads no clock and publishes nothing; it
does write the run directory, because an entry of the ledger must be on the disk before the message that follows from
it is sent.

A run is *open* while blocks are outstanding, then *closing*: its map is written while recorder and dashboard finish
theirs. After that it is finished and the session is ready for the next goal.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from typing import Any, Literal

from bow_sim.physics.errors import ParameterError
from bow_sim.protocol.neighbours import CONSUMERS, FIRST_HELLO_S, HELLO_S, Neighbour, Neighbours
from bow_sim.protocol.states import ONE_AT_A_TIME, NodeState
from bow_sweep.coordinator import messages
from bow_sweep.coordinator.active_run import ActiveRun
from bow_sweep.coordinator.answers import Answer, read_receipt, read_verdicts
from bow_sweep.coordinator.closing import DRAW_REPORT_S, DRAW_S, waits_for
from bow_sweep.coordinator.consumers import Stations
from bow_sweep.coordinator.results import basin_of
from bow_sweep.coordinator.session_events import (
    AnswerGoal,
    CancelRequested,
    Counts,
    Event,
    GoalAccepted,
    GoalRefused,
    HealthReceived,
    Instruction,
    ListenTo,
    Log,
    Publish,
    PublishFeedback,
    PublishMap,
    ReceiptReceived,
    ResultsWritten,
    RunEnded,
    RunGiven,
    SetState,
    TimePassed,
    VerdictsReceived,
    WriteResults,
)
from bow_sweep.coordinator.simulator_pool import Pool
from bow_sweep.plan.sweep import Sweep
from bow_sweep.run import ledger_events
from bow_sweep.run.directory import Run, RunError
from bow_sweep.run.ledger import State

TICK_S = 0.2
"""Seconds between two :class:`TimePassed`."""

ANNOUNCE_S = 1.0
"""The plan is published again this often while recorder, classifier or a simulator has not taken it up."""


class CoordinatorSession:
    """Runs sweeps; changed by :meth:`handle` alone.

    Parameters
    ----------
    incarnation, host, namespace
        Of the coordinator's node.
    neighbours
        The other nodes; the node keeps them up to date.
    create_run
        Takes a goal's sweep and UUID; makes its run, or resumes it. Raises RunError where it cannot.
    wall_clock
        Returns seconds, for rates and durations of runs.
    shown
        Whether a dashboard was started, so that a run ends only when that has drawn it.

    Attributes
    ----------
    nodes
        Node name -> its latest Health.
    refused
        Why the latest goal was refused; "" if it was not.
    """

    def __init__(
        self,
        incarnation: str,
        host: str,
        namespace: str,
        neighbours: Neighbours,
        create_run: Callable[[Sweep, bytes], RunGiven],
        wall_clock: Callable[[], float],
        shown: bool = False,
    ) -> None:
        self._incarnation, self._namespace, self._neighbours = incarnation, namespace, neighbours
        self._create_run, self._wall_clock, self._shown = create_run, wall_clock, shown
        self.nodes: dict[str, Any] = {}
        self.refused = ""
        self._heard_at: dict[str, float] = {}
        self._stations = Stations(neighbours, namespace, lambda text: self._log("error", text))
        self._pool = Pool(self._apply, host, lambda text: self._log("warning", text), self._stations.of)
        self._active: ActiveRun | None = None
        self._state: int = NodeState.READY
        self._counts = Counts()
        self._last_hello = 0.0
        self._now = 0.0
        self._out: list[Instruction] = []
        self._entries: list[Mapping[str, Any]] = []  # of the ledger; to be written before what is in `_out` is done

    @property
    def run(self) -> Run | None:
        """The run in progress."""
        return self._active.run if self._active else None

    def handle(self, event: Event, now: float) -> list[Instruction]:
        """Take in what happened at `now` (seconds of the AwakeClock) and return what to do, in order.

        Raises
        ------
        RunError
            If the report of a run cannot be written.
        """
        return self.handle_all([event], now)

    def handle_all(self, events: Iterable[Event], now: float) -> list[Instruction]:
        """Take in, in their order, several things that happened until `now`, as :meth:`handle` does.

        What they add to the ledger is written and synced to the disk once, before this returns.
        """
        self._now, self._out = now, []
        for event in events:
            self._take(event)
        self._write_entries()
        return self._out

    def _take(self, event: Event) -> None:
        match event:  # what comes most often stands first
            case VerdictsReceived(data, station):
                self._take_answer("verdicts", read_verdicts(data, station, self._active))
            case ReceiptReceived(data, station):
                self._take_answer("receipts", read_receipt(data, station, self._active))
            case HealthReceived(message, neighbour):
                self._take_health(message, neighbour)
            case RunGiven():
                self._begin(event)
            case GoalAccepted():
                self._take_goal(event)
            case GoalRefused(goal, why):
                self._refuse(goal, why)
            case CancelRequested(goal) if self._active is not None and self._active.goal == goal:
                self._active.cancelled = True
            case ResultsWritten(problem=problem):
                self._take_results(event, problem)
            case TimePassed():
                self._tick()

    def fetch_counts(self) -> Counts:
        """Return what has arrived since the last call."""
        counts, self._counts = self._counts, Counts()
        return counts

    def close(self) -> None:
        """Release the directory of the run in progress; its ledger stays as it is, so that it can be resumed."""
        if self._active is not None:
            self._active.run.close()

    # ---- begin and end of a run

    def _take_goal(self, event: GoalAccepted) -> None:
        """Begin a sweep. One that cannot be run ends as aborted: the action server gives no reason for a rejection."""
        try:
            if self._active is not None:
                raise RunError(f"run {self._active.run.run_id} is not finished; {ONE_AT_A_TIME}")
            given = self._create_run(Sweep.from_spec(event.preset, event.settings), event.goal)
        except (ParameterError, RunError) as error:
            self._refuse(event.goal, str(error))
            return
        self.refused = ""
        self._begin(given, event.goal)

    def _refuse(self, goal: bytes, why: str) -> None:
        self.refused = why
        self._log("error", f"goal refused: {why}")
        self._set_state(self._state, f"goal refused: {why}")
        self._out.append(AnswerGoal(goal, {"message": why}))

    def _begin(self, given: RunGiven, goal: bytes | None = None) -> None:
        run, basin = given.run, basin_of(given.layers or {}, given.run.sweep)
        active = self._active = ActiveRun(run, basin, self._wall_clock(), goal, given.dashboard, progress_at=self._now)
        self._pool.begin()
        self._set_state(NodeState.STARTING, "a sweep opens", run.run_id)
        if run.ledger.finished:  # stopped after its last block, before its report or the next round
            self._next_round_or_close(active)
        else:
            self._publish_plan(active)
        what = f"{run.sweep.cells} cells, {run.blocks.count} blocks, in {run.directory}"
        self._log("info", f"run {run.run_id} opens: {what}")

    def _next_round_or_close(self, active: ActiveRun) -> None:
        """Begin the next round of an adaptive sweep, announced before its blocks are sent; else close the run."""
        self._write_entries()
        if active.run.next_round(active.basin):
            self._publish_plan(active)
            self._apply(ledger_events.Grown(active.run.blocks.count))
        else:
            self._close(active)

    def _close(self, active: ActiveRun) -> None:
        """Announce the end of the run, and draw the map while the other nodes close their files."""
        active.closed_at = self._now
        self._publish_map(active)
        self._publish_plan(active)
        self._set_state(NodeState.BUSY, "drawing the map, while the bag is closed")
        self._out.append(WriteResults(active.run, active.basin))

    def _take_results(self, results: ResultsWritten, problem: str) -> None:
        if self._active is None or not self._active.is_closing:
            return
        self._active.results = results
        if problem:
            self._log("error", f"not drawn: {problem}")
        self._set_state(NodeState.BUSY, "waiting for the bag to close")

    def _finish_when_closed(self, active: ActiveRun) -> None:
        """Finish once the bag is closed and no dashboard is drawing, or they have had their time."""
        if active.closed_at is None or active.results is None:
            return
        waited, shown = self._now - active.closed_at, self._shown and active.dashboard
        nodes = [node for node in self.nodes.values() if active.dashboard or node.role != "dashboard"]
        silent = {name: self._now - at for name, at in self._heard_at.items()}
        missing = waits_for(nodes, active.run.run_id, waited, shown, self._stations.of, silent.__getitem__)
        if not missing:
            self._finish(active, active.results)
        elif missing == "dashboard" and waited > DRAW_REPORT_S:
            self._set_state(NodeState.BUSY, f"waiting for the dashboard to draw its last picture, {DRAW_S:g} s at most")

    def _finish(self, active: ActiveRun, results: ResultsWritten) -> None:
        """Write the report, answer the goal and get ready for the next one."""
        self._write_entries()
        run_id, now = active.run.run_id, self._wall_clock()
        result = active.write_report(now, results)
        if active.goal is not None:
            self._out.append(AnswerGoal(active.goal, result))
        self._log("info", f"run {run_id} closes: {result['message']} in {now - active.began:.1f} s")
        active.run.close()
        self._active = None
        self._set_state(NodeState.READY, f"finished run {run_id}: {result['message']}", "")
        self._out.append(RunEnded())

    # ---- what arrives

    def _take_health(self, message: Any, neighbour: Neighbour | None) -> None:
        self.nodes[message.node], self._heard_at[message.node] = message, self._now
        self._out += map(ListenTo, self._stations.hear(message.node, message.role))
        if message.role == "simulator":
            run_id = self.run.run_id if self.run else ""
            hears_us = neighbour is not None and "blocks" in neighbour.hears
            self._pool.on_health(message, run_id, hears_us, self._now)
            if not hears_us:
                self._say_hello()
        elif message.role in CONSUMERS and neighbour is not None and self._stations.update(neighbour, self._now):
            self._log("warning", f"{message.role} restarted: unfinished blocks are due again")
            self._apply(ledger_events.ConsumerRestarted(message.role, self._stations.of(message.node)))
        is_simulator = message.role == "simulator"
        self._begin_work(message.node if is_simulator else None)
        if self._active is not None and not is_simulator:
            self._finish_when_closed(self._active)

    def _take_answer(self, topic: str, answer: Answer) -> None:
        if answer.sender:
            self._neighbours.heard(topic, answer.sender, self._now)
        if answer.events is None:
            self._counts.ignored += 1
        elif answer.events:
            self._apply(*answer.events)
            self._counts.messages += len(answer.events)

    # ---- the ledger

    def _apply(self, *events: ledger_events.Event) -> None:
        """Pass events to the ledger of an open run and carry out what it answers."""
        active = self._active
        if active is None or active.is_closing:
            return
        run = active.run
        out = run.ledger.handle_all(events, self._now)
        if out:  # nothing follows from most answers
            self._entries += [item.entry for item in out if isinstance(item, ledger_events.Record)]
        for item in out:
            match item:
                case ledger_events.Dispatch(block, attempt, simulator):
                    self._send(run, block, attempt, simulator)
                case ledger_events.NewEpoch():
                    self._publish_plan(active)
                case ledger_events.Settled(block, State.QUARANTINED, why):
                    run.quarantined[block] = why
                    self._log("error", f"block {block} is quarantined: {why}")
        if run.ledger.finished and not active.is_closing:
            self._next_round_or_close(active)

    def _write_entries(self) -> None:
        """Write to the disk what the ledger has recorded: nothing that follows from it was published yet."""
        if self._entries and self._active is not None:
            self._active.run.record(self._entries)
            self._entries = []

    def _send(self, run: Run, block: int, attempt: int, simulator: str) -> None:
        incarnation = self._pool.send(simulator, block, attempt, self._now)
        if incarnation:
            self._publish("blocks", messages.block_message(run, self._incarnation, incarnation, block, attempt))

    # ---- as time passes

    def _tick(self) -> None:
        active = self._active
        if active is None:
            return
        run = active.run
        if active.cancelled and not active.is_closing:
            self._log("warning", f"run {run.run_id} is cancelled; it can be resumed: -p resume:={run.directory}")
            self._close(active)
        if active.is_closing:
            self._finish_when_closed(active)
            return
        if self._now - active.plan_at >= ANNOUNCE_S and self._stations.is_plan_needed(run.run_id, self._now):
            self._publish_plan(active)
        self._say_hello()
        self._begin_work()
        self._apply(ledger_events.Tick())
        if not active.is_closing and active.is_progress_due(self._now):
            active.progress_at = self._now
            self._publish_plan(active, if_changed=True)
            if active.is_map_due(self._now):
                self._publish_map(active)
            if active.goal is not None:
                self._out.append(PublishFeedback(active.goal, active.feedback(self._wall_clock())))

    def _begin_work(self, heard: str | None = None) -> None:
        """Let simulators join while recorder and classifier of their station are ready; else report what is missing.

        Only the one that was `heard`, if given, and its station: else each of a thousand heartbeats would look at a
        thousand simulators.
        """
        active = self._active
        if active is None or active.is_closing:
            return
        ready = self._stations.ready(active.run.run_id, self._now, None if heard is None else self._stations.of(heard))
        if ready and heard is None:
            gone = self._stations.gone(self._now)
            self._pool.release_stations(gone)
            self._apply(*map(ledger_events.StationLost, sorted(gone)))
        self._pool.check(self._now, may_join=bool(ready), only=heard, stations=ready)
        if heard is not None and not ready:
            return  # what is missing is said at the next tick
        missing = [] if ready else self._stations.missing(active.run.run_id, self._now)
        if not missing and not self._neighbours.has_role("simulator", self._now):
            missing = ["no simulator is heard"]
        if missing:
            self._set_state(NodeState.STARTING, f"waiting in {self._namespace}: {', '.join(missing)}")
        elif self._state == NodeState.STARTING:
            self._set_state(NodeState.BUSY)

    def _say_hello(self) -> None:
        """Send simulators a Block without cells, so that they can report that blocks arrive; at first more often."""
        active, since = self._active, self._now - self._last_hello
        if active is None or active.is_closing or since < FIRST_HELLO_S:
            return
        simulators = self._neighbours.of_role("simulator", self._now)
        unheard = any("blocks" not in simulator.hears for simulator in simulators)
        if simulators and (unheard or since >= HELLO_S):
            self._last_hello = self._now
            self._publish("blocks", messages.block_message(active.run, self._incarnation))
            for incarnation, station in self._pool.holding():  # what it holds may be void: nobody else tells it so
                if (epoch := active.run.ledger.epoch_at(station)) > active.run.ledger.announced:
                    self._publish("blocks", messages.epoch_message(active.run, self._incarnation, incarnation, epoch))

    # ---- what goes out

    def _publish(self, topic: Literal["plan", "blocks"], data: bytes) -> None:
        self._out.append(Publish(topic, data))

    def _publish_plan(self, active: ActiveRun, if_changed: bool = False) -> None:
        plan = active.plan_message(self._incarnation)
        if not if_changed or plan != active.plan:
            active.plan, active.plan_at = plan, self._now
            self._publish("plan", plan)

    def _publish_map(self, active: ActiveRun) -> None:
        values = active.new_map()
        if values is not None:
            active.map_at = self._now
            self._out.append(PublishMap(values))

    def _set_state(self, state: int, detail: str = "", run_id: str | None = None) -> None:
        self._state = state
        self._out.append(SetState(state, detail, run_id))

    def _log(self, severity: Literal["info", "warning", "error"], text: str) -> None:
        self._out.append(Log(severity, text))
