"""The dashboard node: shows a sweep in rerun while it runs, and leaves ``dashboard.rrd`` in the run directory.

A latched `plan` opens and finishes the recording of a run. A dashboard that is started again during a run continues the
file of the one before it: there is one file, and nothing in it is lost.
"""

from __future__ import annotations

import contextlib
import re
import time
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from bow_msgs.msg import BasinMap, BridgeForce, Health, InspectedCell, Plan, Verdicts
from rclpy.qos import QoSProfile
from rclpy.subscription import Subscription

from bow_sim.graph.imports import absent, uncollected
from bow_sim.graph.node_base import INSPECT, LATCHED, STREAM, BowNode, StartupError
from bow_sim.graph.node_process import run_node
from bow_sim.protocol import cdr
from bow_sim.protocol.inspected import SPREAD, spread_over
from bow_sim.protocol.measured import is_measured
from bow_sim.protocol.neighbours import Neighbour
from bow_sim.protocol.sweep_outline import SweepOutline
from bow_sweep.run.places import find_place
from bow_sweep.view.status_page import NodeStatus
from bow_sweep.view.viewer import Screen, port_of
from bow_sweep.view.wanted import NO_DISPLAY, NOTE, free_port, has_display, port_problem

if TYPE_CHECKING:
    from bow_sweep.view.live_run import LiveRun
    from bow_sweep.view.measured_view import MeasuredView

HELP = """
usage: ros2 run bow dashboard [--ros-args -r __ns:=/bow/RUN -p runs_dir:=runs | -p run_dir:=DIRECTORY]
                              [-p view:=true] [-p port:=9876] [-p server_memory:=256MiB] [-p connect:=ADDRESS]

Shows the sweep on the graph of its namespace (default /bow) in rerun: the growing basin map, the three tests, regimes,
progress, waveforms of inspected cells, accounts. Writes <runs_dir>/<run_id>/dashboard.rrd, or <run_dir>/dashboard.rrd;
`rerun dashboard.rrd` opens it. With a port, `rerun --connect rerun+http://127.0.0.1:PORT/proxy` watches it grow, and
gets all that came before; view:=true opens a viewer here; connect:=rerun+http://127.0.0.1:PORT/proxy sends it to a
viewer that is open already.
"""

TICK_S = 0.1
"""Between two updates of the display."""

EXIT_S = 3.0
"""If the disk is full, rerun waits for its writer for ever when Python exits; the process then ends after this."""

INSPECT_DEPTH = 500
"""The chunks of a block arrive in a burst; with this history depth they are kept, though `inspect` is best effort."""

BAG_IS_READY = (Health.CLOSED, Health.FAILED)
"""States of a recorder that writes its bag no more."""

MEMORY = re.compile(r"\d+(\.\d+)?\s?([kMGT]i?)?B|\d+(\.\d+)?%")


class DashboardNode(BowNode):
    """Shows one run after the other."""

    def __init__(self) -> None:
        super().__init__("dashboard")
        runs_dir = self.read_parameter("runs_dir", "runs", "directory of the run directories, each named by its run_id")
        run_dir = self.read_parameter("run_dir", "", "exact run directory, instead of one below runs_dir")
        self._runs_dir, self._run_dir = Path(runs_dir), Path(run_dir) if run_dir else None
        places = self.read_parameter("places", "", "folder of notes that say where runs go, see `bow up`")
        self._places = Path(places) if places else None
        self._view = self.read_parameter("view", False, "open the live viewer when a sweep opens")
        self._port = self.read_parameter(
            "port", 0, "serve viewers on this port of 127.0.0.1; 0 = no server", (0, 65535)
        )
        memory = "what the server keeps for viewers that come late, such as 256MiB, 1GB or 10%"
        self._memory = self.read_parameter("server_memory", "256MiB", memory)
        if not MEMORY.fullmatch(self._memory):
            raise StartupError(f"parameter server_memory = {self._memory!r}: should be like 256MiB, 1GB or 10%")
        self._uri = self.read_parameter(
            "connect", "", "send the recording to the viewer or server at this address, too"
        )
        if self._uri and not port_of(self._uri):
            raise StartupError(f"parameter connect = {self._uri!r}: should be like rerun+http://127.0.0.1:9876/proxy")
        inspected = self.read_parameter("inspect", [0], "cells whose waveforms are complete in the recording of a run")
        self._inspected: list[int] = list(inspected or ())
        self._live: LiveRun | MeasuredView | None = None
        self._measured: dict[str, Subscription] = {}  # of the streams that only a measured string is drawn from
        self._recorders: dict[str, dict[str, bool]] = {}  # run -> recorder -> whether it has closed its bag
        self._over: tuple[str, int] = ("", -1)
        self._early: dict[str, Any] | None = None  # a map that came before its plan
        self._screen = self._open_screen()
        self._notes = self._screen.notes
        self._nodes: dict[str, NodeStatus] = {}
        patient = QoSProfile(depth=INSPECT_DEPTH, reliability=INSPECT.reliability)
        self.subscribe_plan(self._on_plan)
        for kind, topic, taker, qos in (
            (BasinMap, "basin_map", self._on_map, LATCHED),
            (InspectedCell, "inspect", self._on_inspect, patient),
        ):
            self.create_subscription(kind, topic, self._taker(kind.__name__, taker), qos, raw=True)
        self.every(TICK_S, self._tick)
        with uncollected():  # rerun takes a quarter of a second to import: now, while the others start too
            from bow_sweep.view import live_run  # noqa: F401

        self.set_state(Health.READY, "waits for a plan")

    def _taker(self, name: str, take: Callable[[dict[str, Any]], None]) -> Callable[[bytes], None]:
        """Return a callback that counts a message and passes its fields on, or ignores it if it is invalid."""

        def taker(data: bytes) -> None:
            self.health.messages += 1
            self.health.bytes += len(data)
            try:
                take(cdr.unseal(name, data) if cdr.is_sealed(name) else cdr.decode(name, data))
            except cdr.WireError as error:
                self.ignore(str(error))

        return taker

    # ---- the plan opens and finishes the recording

    def _on_plan(self, plan: dict[str, Any], data: bytes) -> None:
        self.health.messages += 1
        self.health.bytes += len(data)
        run, epoch = plan["run_id"], plan["epoch"]
        if self._live is not None:
            if run == self._live.run_id:
                self._live.plan(plan)
                return
            if plan["state"] != Plan.OPEN:
                return
            self._finish(f"run {run} opens")
        if (run, epoch) != self._over and plan["state"] in (Plan.OPEN, Plan.CLOSED):
            self._open(plan)

    def _open(self, plan: dict[str, Any]) -> None:
        from bow_sweep.view.live_run import FILE, IDENTITY, LiveRun

        run = plan["run_id"]
        if not IDENTITY.fullmatch(run):
            self.ignore(f"plan: run_id {run!r} should be 16 hexadecimal digits")
            return
        place = find_place(self._places, run)
        if place is not None and not place.dashboard:
            return
        directory = self._run_dir or (place.directory if place else self._runs_dir / run)
        if plan["state"] == Plan.CLOSED and not self._run_dir and not (directory / FILE).exists():
            return  # the run ended before this dashboard started, and was not asked for by its directory
        if not self._run_dir and (directory / FILE).exists() and not self.works_for(plan["incarnation"], run):
            self.ignore(f"plan: run {run} has a recording, and no living coordinator works for it")
            return
        try:
            if is_measured(plan):
                self._live = self._open_measured(directory, plan)
            else:
                inspected = spread_over(SweepOutline.of(plan)) if self._inspected == [SPREAD] else self._inspected
                self._live = LiveRun(directory, plan, inspected, self._uri, self.get_logger().warning)
        except Exception as error:  # rerun may raise any exception; the sweep continues without its picture
            self._fail(f"{directory / FILE}: {error}", run, plan["epoch"])
            return
        self._become_busy()
        self._tell_of_recorder()
        early, self._early = self._early, None
        if early is not None and early["run_id"] == run:
            self._on_map(early)

    def _open_measured(self, directory: Path, plan: dict[str, Any]) -> MeasuredView:
        """Open the view of a measured string, and listen to its streams: nobody waits for this reader of them."""
        from bow_sweep.view.measured_view import MeasuredView

        for kind, topic, taker in (
            (Verdicts, "verdicts", lambda values: self._guarded(lambda live: live.verdicts(values))),
            (BridgeForce, "bridge_force", lambda values: self._guarded(lambda live: live.force(values))),
        ):
            if topic not in self._measured:
                take = self._taker(kind.__name__, taker)
                self._measured[topic] = self.create_subscription(kind, topic, take, STREAM, raw=True)
        return MeasuredView(directory, plan, self._uri, self.get_logger().warning)

    def _become_busy(self) -> None:
        """Publish which file is written, and the notes for the user."""
        assert self._live is not None
        self.set_state(Health.BUSY, NOTE.join([f"writes {self._live.recording.path}", *self._notes]), self._live.run_id)

    def _open_screen(self) -> Screen:
        """Open the viewer or the server that the parameters ask for, before any run: they show it from its start."""
        window, port, notes = self._view, self._port, []
        if port and (problem := port_problem(port)):
            notes.append(f"the map is not shown live: port {port} {problem}")
            window, port = False, 0
        elif window and not has_display():
            notes.append(f"{NO_DISPLAY}; the map is served instead")
            window, port = False, port or free_port()
        screen = Screen.open(window, port, self._memory)
        screen.notes[:0] = notes
        for note in screen.notes:
            self.get_logger().info(note)
        self._uri = screen.uri or self._uri
        return screen

    def _check_screen(self) -> None:
        if problem := self._screen.problem():
            self.get_logger().warning(problem)
            self._notes.append(problem)
            if self._live is not None:
                self._become_busy()

    def _finish(self, why: str) -> None:
        """Finish the file and publish that."""
        live, self._live = self._live, None
        if live is None:
            return
        try:
            live.finish(self._nodes.values())
        except Exception as error:  # as in _open
            self._fail(f"{live.recording.path}: {error}", live.run_id, live.epoch)
            return
        self._over = (live.run_id, live.epoch)
        self.health.ignored += live.ignored
        self.set_state(Health.CLOSED, f"{live.recording.path} is finished: {why}", live.run_id)

    def _fail(self, what: str, run: str, epoch: int) -> None:
        self._live, self._over = None, (run, epoch)  # another plan would begin again, fail again and be told again
        self.get_logger().error(f"nothing more is shown: {what}")
        self.set_state(Health.FAILED, what, run)

    # ---- what is displayed

    def _on_map(self, values: dict[str, Any]) -> None:
        if self._live is None:
            self._early = values
        else:
            self._guarded(lambda live: live.map(values))

    def _on_inspect(self, values: dict[str, Any]) -> None:
        self._guarded(lambda live: live.inspect(values))

    def on_health(self, message: Health, neighbour: Neighbour | None) -> None:
        """Store the state of a node for the status page; take note of the recorders, one a station."""
        if message.role == "recorder" and message.run_id:
            closed = {**self._recorders.get(message.run_id, {}), message.node: message.state in BAG_IS_READY}
            self._recorders = {message.run_id: closed}
            self._tell_of_recorder()
            if message.state in BAG_IS_READY:
                self._tick()  # the run may be over now, and others wait for its last picture
        self._nodes[message.node] = NodeStatus(
            message.node,
            message.role,
            message.state,
            message.detail,
            message.messages,
            message.bytes,
            message.ignored,
            message.rss,
            time.monotonic(),
        )

    def _tell_of_recorder(self) -> None:
        if self._live is not None and (closed := self._recorders.get(self._live.run_id)) is not None:
            self._live.recorder(all(closed.values()))

    def _tick(self) -> None:
        self._check_screen()
        if self._guarded(lambda live: live.tick(self._nodes.values())):
            self._finish("the plan is closed")

    def _guarded(self, do: Callable[[Any], Any]) -> Any:
        """Call `do` with the run on display, if there is one; stop displaying it if that fails."""
        live = self._live
        if live is None:
            return None
        try:
            return do(live)
        except Exception as error:  # as in _open
            self._fail(f"{live.recording.path}: {error}", live.run_id, live.epoch)
            return None

    def close(self) -> None:
        """Finish the file as it is; a dashboard that is started later continues it."""
        self._finish("the dashboard was told to stop")
        self._screen.close(self.get_logger().info)


def main() -> int:
    """Entry point of ``ros2 run bow dashboard``."""
    with contextlib.suppress(ImportError), absent("pandas"):  # pyarrow's first array imports it, for 0.2 s
        import pyarrow

        pyarrow.array(np.zeros(1)), pyarrow.array([""])
    return run_node(DashboardNode, description=HELP, exit_s=EXIT_S)


if __name__ == "__main__":
    raise SystemExit(main())
