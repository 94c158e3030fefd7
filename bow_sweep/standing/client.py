"""Sends sweeps to a standing graph, one after the other, and waits until each run is finished in its directory.

A client that ends, or is killed, leaves its run to the graph: the run goes on and is whole. A client that is
interrupted (Ctrl-C, SIGTERM) cancels its run, which can be resumed.
"""

from __future__ import annotations

import contextlib
import shutil
import tempfile
import time
import uuid
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from bow_sim.protocol.identity import random_id
from bow_sim.protocol.neighbours import CONSUMERS, AwakeClock
from bow_sim.protocol.states import ONE_AT_A_TIME, NodeState
from bow_sweep.plan.sweep import Sweep
from bow_sweep.processes.interrupts import Interrupts
from bow_sweep.processes.progress import Progress
from bow_sweep.processes.supervisor import GraphError, tail
from bow_sweep.run.directory import LEDGER, RunError, read_ledger
from bow_sweep.run.places import Place, remove_places, write_place
from bow_sweep.standing.listener import SPIN_S, Listener
from bow_sweep.standing.start import start, stop
from bow_sweep.standing.state import LOGS, PLACES, TURNS, State, default_folder, read_state
from bow_sweep.standing.turns import Turn

if TYPE_CHECKING:
    import subprocess


JOIN_S = 30.0
"""A client has this long to find the coordinator and get an answer to a goal."""

CANCEL_S = 90.0
"""A run that is cancelled has this long to close its files."""

PATIENCE_S = 300.0
"""A run without progress for this long is cancelled."""

LOOK_S, AGAIN_S = 0.5, 0.5

CLOSE_S = 30.0


@dataclass(frozen=True)
class Finished:
    """A run that a standing graph has finished.

    Attributes
    ----------
    run_id, directory
        The run.
    planned, done, quarantined
        Its cells.
    wall_s
        Duration.
    """

    run_id: str
    directory: Path
    planned: int
    done: int
    quarantined: int
    wall_s: float


class _GoalLost(GraphError):
    """The coordinator that had the goal is no more, so there is nothing to cancel."""


class Graph(Listener):
    """A client of a standing graph. Make it with :func:`connect` or :func:`private_graph`.

    Parameters
    ----------
    state, folder
        The graph.
    """

    def __init__(self, state: State, folder: Path) -> None:
        super().__init__(state)
        from bow_msgs.action import RunSweep
        from rclpy.action import ActionClient

        self.folder = folder
        self._type = RunSweep
        self._action = ActionClient(self._node, RunSweep, "run_sweep")

    def close(self) -> None:
        """Leave the graph."""
        self._action.destroy()
        del self._action
        super().close()

    def run(
        self,
        sweep: Sweep,
        directory: Path,
        run_id: str | None = None,
        *,
        progress: Callable[[Progress | None, str], None] = lambda *_: None,
        resume: bool = False,
        dashboard: bool = False,
        patience_s: float = PATIENCE_S,
        cancelled: Callable[[], bool] = lambda: False,
    ) -> Finished:
        """Run a sweep; return when its run is finished in `directory`.

        Other clients may be there: they have their turn one after the other.

        Parameters
        ----------
        sweep
            The sweep.
        directory
            Run directory; created where it is missing.
        run_id
            Identity of the run, see :func:`bow_sim.protocol.identity.random_id`; None for a new one. That of a resumed
            run is in its ledger.
        progress
            Called several times a second: how far the run is, None before it has begun; and what it waits for.
        resume
            Go on with the run that is in the directory.
        dashboard
            Whether the graph's dashboard, if it has one, writes dashboard.rrd.
        patience_s
            Seconds without progress after which the run is cancelled.
        cancelled
            Called several times a second: whether to cancel the run, as Ctrl-C does; for threads, which get no signals.

        Raises
        ------
        GraphError
            Where the graph refuses the run, has ended, or makes no progress. A run that has begun can be resumed.
        RunError
            Where the directory holds a run already, or none that can be resumed.
        KeyboardInterrupt
            After Ctrl-C or SIGTERM, or where `cancelled` says so; the run is cancelled, and can be resumed.
        """
        directory = directory.absolute()
        if resume:
            run_id = str(read_ledger(directory)[0]["run_id"])
        elif (directory / LEDGER).exists():
            raise RunError(f"{directory}: holds a run already; resume it, or choose another directory")
        identity = run_id or random_id()
        place = Place(directory, resume, dashboard and self.state.dashboard)
        with Interrupts("cancelling the run; some seconds") as interrupts, Turn(self.folder / TURNS, directory) as turn:

            def check() -> None:
                interrupts.check()
                if cancelled():
                    raise KeyboardInterrupt

            self._wait_for_turn(turn, check, progress)
            directory.mkdir(parents=True, exist_ok=True)
            write_place(self.folder / PLACES, identity, place)
            while True:
                goal, feedback = self._send(sweep, identity, check)
                try:
                    result = self._wait(goal, identity, feedback, check, progress, patience_s)
                except _GoalLost:
                    raise
                except (KeyboardInterrupt, GraphError):
                    self._cancel(goal)
                    raise
                if ONE_AT_A_TIME not in result.message:
                    break
                self._pause(check, progress)
            remove_places(self.folder / PLACES)  # this run is over, and so are those of clients that were killed
        if not result.run_id:
            raise GraphError(f"the graph refuses the run: {result.message}")
        return Finished(
            result.run_id,
            directory,
            result.cells_planned,
            result.cells_done,
            result.cells_quarantined,
            result.wall_seconds,
        )

    # ---- the turn of this client

    def _wait_for_turn(
        self, turn: Turn, check: Callable[[], None], progress: Callable[[Progress | None, str], None]
    ) -> None:
        """Wait until the clients that came before are served, however long their runs take."""
        while others := turn.before():
            check()
            self._check_alive()
            progress(None, f"for {len(others)} before this one, now process {others[0].pid} -> {others[0].directory}")
            self.spin(SPIN_S)

    def _check_alive(self) -> None:
        """Raise a GraphError if the graph is gone."""
        if not self.state.is_alive:
            raise GraphError(f"the standing graph has ended; its log, while there is no new one: {self.folder / LOGS}")

    # ---- a goal

    def _send(self, sweep: Sweep, identity: str, check: Callable[[], None]) -> tuple[tuple[Any, Any], list[Any]]:
        """Send a goal; return its handle and its result to come, and a list of which the last item is its feedback."""
        from bow_msgs.msg import SweepSpec
        from unique_identifier_msgs.msg import UUID

        self._until(self._action.server_is_ready, check, "no coordinator is found")
        goal = self._type.Goal(spec=SweepSpec(preset=sweep.preset, settings=list(sweep.settings())))
        feedback: list[Any] = []

        def keep(message: Any) -> None:
            feedback[:] = [message.feedback]

        key = UUID(uuid=list(bytes.fromhex(identity) + uuid.uuid4().bytes[:8]))
        sent = self._action.send_goal_async(goal, feedback_callback=keep, goal_uuid=key)
        try:
            self._until(sent.done, check, "the coordinator does not answer")
        except KeyboardInterrupt:
            self._withdraw(sent)
            raise
        handle = sent.result()
        if handle is None or not handle.accepted:
            raise GraphError("the coordinator rejects the goal; is it of another version of bow?")
        return (handle, handle.get_result_async()), feedback

    def _pause(self, check: Callable[[], None], progress: Callable[[Progress | None, str], None]) -> None:
        """Wait a moment, because a run is in progress whose client was killed."""
        until = time.monotonic() + AGAIN_S
        while time.monotonic() < until:
            check()
            progress(None, "for a run that goes on without its client")
            self.spin()
        self._check_alive()

    def _until(self, done: Callable[[], bool], check: Callable[[], None], why: str) -> None:
        """Wait until something is done.

        Raises
        ------
        GraphError
            Beginning with `why`, where it takes too long.
        """
        deadline = time.monotonic() + JOIN_S
        while not done():
            check()
            self._check_alive()
            if time.monotonic() > deadline:
                where = f"in {self.state.namespace} of domain {self.state.domain}"
                raise GraphError(f"{why} {where} for {JOIN_S:g} s; see {self.folder / LOGS}; bow down, bow up")
            self.spin()

    def _wait(
        self,
        goal: tuple[Any, Any],
        identity: str,
        feedback: list[Any],
        check: Callable[[], None],
        progress: Callable[[Progress | None, str], None],
        patience_s: float,
    ) -> Any:
        """Wait for the result of a goal; watch the graph meanwhile."""
        _, answer = goal
        first = self.coordinator
        clock = AwakeClock()  # time in which this process is stopped does not count
        known, changed_at, look_at = object(), clock.now(), 0.0
        while not answer.done():
            check()
            self.spin()
            now = clock.now()
            latest = feedback[-1] if feedback else None
            leader = self.coordinator
            first = first or leader
            new = (latest and (latest.cells_done, tuple(latest.regime_counts)), leader and leader.detail)
            if new != known:
                known, changed_at = new, now
            if now - changed_at > patience_s:
                raise GraphError(f"no progress for {patience_s:g} s; {leader.detail if leader else 'nobody is heard'}")
            if leader is not None and first is not None and leader.incarnation != first.incarnation:
                log = self.folder / LOGS / "coordinator.log"
                raise _GoalLost(f"the coordinator of the standing graph was started again:\n{tail(log)}")
            for node in self.nodes.values():
                if node.role in CONSUMERS and node.state == NodeState.FAILED and node.run_id == identity:
                    raise GraphError(f"{node.role}: {node.detail}")
            if now > look_at:
                look_at = now + LOOK_S
                self._check_alive()
            waits = leader.detail if leader is not None and leader.state == NodeState.STARTING else ""
            progress(None if latest is None else _progress(latest), waits)
        return answer.result().result

    def _withdraw(self, sent: Any) -> None:
        """Cancel a goal that was sent, once it is accepted: its run would go on without a client."""
        with contextlib.suppress(GraphError):  # the graph is gone, or does not answer
            self._until(sent.done, lambda: None, "the coordinator does not answer")
            handle = sent.result()
            if handle is not None and handle.accepted:
                self._cancel((handle, handle.get_result_async()))

    def _cancel(self, goal: tuple[Any, Any]) -> None:
        """Cancel a goal, and wait until its run is closed; give up where the graph is gone."""
        handle, answer = goal
        deadline = time.monotonic() + CANCEL_S
        handle.cancel_goal_async()
        while not answer.done() and time.monotonic() < deadline and self.state.is_alive:
            self.spin()


def _progress(latest: Any) -> Progress:
    """Return the progress that feedback tells of."""
    counts = dict(zip(latest.regime_names, map(int, latest.regime_counts), strict=False))
    return Progress(latest.cells_done, latest.cells_quarantined, latest.cells_planned, counts)


@contextlib.contextmanager
def connect(folder: Path | None = None) -> Iterator[Graph]:
    """Yield a client of the standing graph of this user.

    Parameters
    ----------
    folder
        Folder of the graph; None for that of `bow up`.

    Raises
    ------
    GraphError
        Where there is none.
    """
    place = folder or default_folder()
    state = read_state(place)
    if state is None:
        raise GraphError("there is no standing graph: bow up starts one")
    graph = Graph(state, place)
    try:
        yield graph
    finally:
        graph.close()


@contextlib.contextmanager
def private_graph(
    simulators: int, root: Path, *, dashboard: bool = False, say: Callable[[str], None] = lambda _: None
) -> Iterator[Graph]:
    """Yield a client of a graph of its own, which ends with this context, or with this process.

    Parameters
    ----------
    simulators
        Number of simulator processes.
    root
        Directory for runs of goals that others send; nothing is written there otherwise.
    dashboard
        Whether there is a dashboard.
    say
        Takes a line for the user where something takes long.

    Raises
    ------
    GraphError
        Where it cannot start.
    """
    folder = Path(tempfile.mkdtemp(prefix="bow-graph-"))
    process: subprocess.Popen[bytes] | None = None
    try:
        state, process = start(folder, simulators=simulators, root=root, dashboard=dashboard, owned=True, say=say)
        graph = Graph(state, folder)
        try:
            yield graph
        finally:
            graph.close()
    finally:
        if process is not None:
            _end(process, state, say)
        shutil.rmtree(folder, ignore_errors=True)


def _end(process: subprocess.Popen[bytes], state: State, say: Callable[[str], None]) -> None:
    """End the process of a private graph."""
    if process.poll() is None:
        stop(state, say)
    process.wait(CLOSE_S)
    if process.stdin is not None:
        process.stdin.close()
