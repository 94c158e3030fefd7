"""The coordinator node: parameters, topics and the action server around a :class:`CoordinatorSession`."""

from __future__ import annotations

import gc
import threading
import time
from collections.abc import Iterable, Iterator
from itertools import chain
from pathlib import Path
from typing import Any

from bow_msgs.action import RunSweep
from bow_msgs.msg import BasinMap, Block, Health, Plan, Receipt, Verdicts
from diagnostic_msgs.msg import DiagnosticArray
from rclpy.action import ActionServer, CancelResponse
from rclpy.subscription import Subscription
from sensor_msgs.msg import Image

from bow_sim.graph.inbox import Inbox
from bow_sim.graph.node_base import HEARTBEATS, LATCHED, STREAM, WORK, BowNode, RCLError, StartupError
from bow_sim.graph.node_process import run_node
from bow_sim.physics.errors import ParameterError
from bow_sim.protocol import cdr
from bow_sim.protocol.identity import random_id
from bow_sim.protocol.neighbours import CONSUMERS, Neighbour
from bow_sweep.coordinator import diagnostics
from bow_sweep.coordinator.cell_chooser import CellChooser
from bow_sweep.coordinator.goals import GOAL_WAIT_S, GoalGate, Hold, is_wrong
from bow_sweep.coordinator.painter import Painter, prepare
from bow_sweep.coordinator.results import playability_of, write_results
from bow_sweep.coordinator.resume import resume
from bow_sweep.coordinator.session import TICK_S, CoordinatorSession
from bow_sweep.coordinator.session_events import (
    AnswerGoal,
    CancelRequested,
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
from bow_sweep.coordinator.standard_messages import diagnostics_message, image_message, regimes_message
from bow_sweep.plan.sweep import Sweep
from bow_sweep.run.directory import Run, RunError
from bow_sweep.run.places import find_place

HELP = """
usage: ros2 run bow coordinator [--ros-args -r __ns:=/bow/RUN -p preset:=fig11d -p settings:="[x.count=16]"
                                 -p runs_dir:=runs -p resume:=RUN_DIRECTORY]

Runs sweeps. With `preset` or `settings` it begins one at once; otherwise it waits for a goal:
  ros2 action send_goal -f /bow/run_sweep bow_msgs/action/RunSweep "{spec: {preset: fig11d, settings: ['x.count=16']}}"
It sends out blocks as soon as a recorder, a classifier and at least one simulator are in its namespace (default /bow)
and report that they hear each other, and leaves each run in <runs_dir>/<run_id>. A goal that cannot be run ends as
aborted, with the reason in its result.

While a sweep runs, any cell can be inspected: its waveform goes out on `inspect`, and the dashboard shows it.
  ros2 service call /bow/inspect_cell bow_msgs/srv/InspectCell "{at: ['f_asym=3.1', 'f_init_ratio=0.67']}"
or a click on the map in RViz (display PointCloud2 of /bow/basin_map/points, fixed frame basin_map, tool Publish Point)
or Foxglove. The state of all nodes is on /diagnostics, once a second.
"""

DIAGNOSTICS_S = 1.0

PREPARE_S = 10.0
"""At the end the thread that imports libraries has this long to finish."""

TAKE_S = 0.02
"""Between two times at which heartbeats, receipts and verdicts are taken. To be woken for each of them, a thousand in a
second, would cost more than what is done with them; and what they add to the ledger is written at once."""

MOST_TAKEN = 256
"""Messages of a topic that are taken at a time, at most: the others must not wait for long."""


class CoordinatorNode(BowNode):
    """Serves `run_sweep`; what it does is decided in :class:`CoordinatorSession`."""

    says_ends = False

    def __init__(self) -> None:
        super().__init__("coordinator")
        texts = {
            "preset": "preset to run at once; empty = wait for a goal",
            "runs_dir": "directory in which run directories are made, each named by its run_id",
            "run_dir": "exact directory of the next run, instead of one below runs_dir",
            "run_id": "identity of the next run, 16 hexadecimal digits; empty = random",
            "resume": "directory of a run to resume at once",
            "places": "folder of notes that say where runs go, see `bow up`",
        }
        defaults = {"runs_dir": "runs"}
        text = {name: self.read_parameter(name, defaults.get(name, ""), what) for name, what in texts.items()}
        settings = self.read_parameter("settings", [""], '"name=value" settings over the preset')
        self._once = self.read_parameter("once", False, "end this process when the first run is finished")
        shown = self.read_parameter("dashboard", False, "a dashboard was started: end a run only when it has drawn it")
        self._locks = self.read_parameter(
            "lock", True, "lock run directories; false: not, for file systems without locks"
        )
        patience = self.read_parameter(
            "goal_wait", GOAL_WAIT_S, "seconds that a goal waits for a recorder and a classifier before it is refused"
        )
        self._gate = GoalGate(patience)
        self._runs_dir, self._run_dir, self._run_id = Path(text["runs_dir"]), text["run_dir"], text["run_id"]
        self._places = Path(text["places"]) if text["places"] else None
        self._goals: dict[bytes, Any] = {}
        self._results: dict[bytes, RunSweep.Result] = {}
        self._cancelled: list[bytes] = []
        self._session = CoordinatorSession(
            self.incarnation,
            self.health.host,
            self.get_namespace(),
            self.neighbours,
            self._create_run,
            time.monotonic,
            shown,
        )

        self._topics = {
            "plan": self.create_publisher(Plan, "plan", LATCHED),
            "blocks": self.create_publisher(Block, "blocks", WORK),
        }
        self._map = self.create_publisher(BasinMap, "basin_map", LATCHED)
        self._image = self.create_publisher(Image, "basin_map/image", LATCHED)
        self._regimes = self.create_publisher(Image, "basin_map/regimes", LATCHED)
        self._diagnostics = self.create_publisher(DiagnosticArray, "/diagnostics", 10)
        self._diagnosed = 0
        self._chooser = CellChooser(self, lambda: self._session.run)
        self._inboxes: dict[str, tuple[Inbox, Inbox]] = {}
        self._listen_to("")
        self._server = ActionServer(
            self,
            RunSweep,
            "run_sweep",
            execute_callback=self._end_goal,
            handle_accepted_callback=self._on_accepted,
            cancel_callback=self._on_cancel,
            result_timeout=60,
        )
        self.every(TAKE_S, lambda: self._handle(self._arrived()))
        self.every(TICK_S, self._tick)
        self.every(DIAGNOSTICS_S, self._publish_diagnostics)
        try:
            if text["resume"]:
                given = RunGiven(*resume(Path(text["resume"]).absolute(), self.get_logger().warning, self._locks))
            elif text["preset"] or any(settings):
                sweep = Sweep.from_spec(text["preset"], [setting for setting in settings if setting])
                given = self._create_run(sweep)
            else:
                given = None
        except (RunError, ParameterError) as error:
            raise StartupError(str(error)) from None
        self._preparing: threading.Thread | None = None
        self._painter = Painter.given()
        self._frozen = given is None
        if given is None:
            if self._painter is None:
                prepare()
            gc.freeze()  # the collection after each run need not look at these libraries: some hundredths of a second
            self.set_state(Health.READY, "waits for a goal on run_sweep")
        else:
            self._handle([given])

    def _create_run(self, sweep: Sweep, goal: bytes = b"") -> RunGiven:
        """Create the directory of a run, or resume the one that is there, if its place says so.

        `run_id` and `run_dir` count for the first one only. The run of a goal has a place if there is a note for the
        first eight bytes of the goal's UUID: these are its run_id then.
        """
        wanted = goal[:8].hex()
        place = find_place(self._places, wanted)
        if place is not None and place.resume:
            run, layers = resume(place.directory, self.get_logger().warning, self._locks)
            if run.run_id == wanted:
                return RunGiven(run, layers, place.dashboard)
            run.close()
            raise RunError(f"{place.directory}: holds run {run.run_id}; the goal is for run {wanted}")
        if place is not None:
            return RunGiven(Run.create(place.directory, wanted, sweep, self._locks), dashboard=place.dashboard)
        identity, self._run_id = self._run_id or random_id(), ""
        directory, self._run_dir = Path(self._run_dir) if self._run_dir else self._runs_dir / identity, ""
        return RunGiven(Run.create(directory.absolute(), identity, sweep, self._locks))

    def _prepare(self) -> None:
        """Import what the results need in a thread, while the first blocks are computed: no block waits for that."""
        if self._preparing is None and self._painter is None:
            self._preparing = threading.Thread(target=prepare, name="prepare", daemon=True)
            self._preparing.start()

    def destroy_node(self) -> None:
        """Destroy the action server too, which rclpy leaves to a collection of garbage."""
        self._server.destroy()
        super().destroy_node()

    def close(self) -> None:
        """Release the run directory."""
        if self._preparing is not None:
            self._preparing.join(PREPARE_S)  # Python must not end while a thread imports
        if self._painter is not None:
            self._painter.close()
        if self._frozen:
            gc.unfreeze()  # this node too: its DDS entities are destroyed by a collection, see leaving
        self._chooser.close()
        self._session.close()

    # ---- events

    def receive_health(self) -> None:
        """Subscribe to heartbeats, which are taken together with the answers."""
        self._heartbeats = [Inbox(self, Health, topic, HEARTBEATS, raw=False) for topic in self.heartbeat_topics()]
        self._by_hand = {inbox.subscription for inbox in self._heartbeats}
        self._heard: list[Event] = []

    def on_health(self, message: Health, neighbour: Neighbour | None) -> None:
        """Pass a heartbeat to the session."""
        if message.role == "dashboard" and message.state == Health.BUSY:
            self._chooser.show_again(message.incarnation, message.run_id)
        self._heard.append(HealthReceived(message, neighbour))

    @property
    def subscriptions(self) -> Iterator[Subscription]:
        """The subscriptions that the executor serves."""
        return (each for each in super().subscriptions if each not in self._by_hand)

    def _listen_to(self, station: str) -> None:
        """Subscribe to what recorder and classifier of a station answer."""
        if station not in self._inboxes:
            below = f"{station}/" if station else ""
            self._inboxes[station] = (
                Inbox(self, Verdicts, f"{below}verdicts", STREAM),
                Inbox(self, Receipt, f"{below}receipts", STREAM),
            )
            self._by_hand.update(inbox.subscription for inbox in self._inboxes[station])

    def _arrived(self) -> Iterator[Event]:
        """Take what waits, and give one event after the other: each is dealt with before the next is looked at."""
        for message in chain.from_iterable(inbox.take(MOST_TAKEN) for inbox in self._heartbeats):
            self._take_health(message)
            heard, self._heard = self._heard, []
            yield from heard
        for station, (verdicts, receipts) in self._inboxes.items():
            yield from (VerdictsReceived(data, station) for data in verdicts.take(MOST_TAKEN))
            yield from (ReceiptReceived(data, station) for data in receipts.take(MOST_TAKEN))

    def _on_accepted(self, goal: Any) -> None:
        key = bytes(goal.goal_id.uuid)
        self._goals[key] = goal
        event = GoalAccepted(key, goal.request.spec.preset, tuple(goal.request.spec.settings))
        refused = self._session.run is not None or is_wrong(event)  # the session says why
        self._goal_goes_on(event if refused else self._gate.take(event, *self._who_is_missing()))

    def _goal_goes_on(self, what: GoalAccepted | GoalRefused | Hold | None) -> None:
        """Do with a goal what the gate says."""
        match what:
            case Hold(why):
                self.get_logger().info(why)
                self.set_state(self.health.state, why)
            case GoalAccepted() | GoalRefused():
                self._handle([what])

    def _who_is_missing(self) -> tuple[float, list[str]]:
        """Return the time, and which nodes a new sweep lacks."""
        now = self.awake.now()
        return now, [f"no {role} is heard" for role in CONSUMERS if not self.neighbours.of_role(role, now)]

    def _on_cancel(self, goal: Any) -> CancelResponse:
        # The goal's answer has to wait until the action server has noted that it is being cancelled.
        self._cancelled.append(bytes(goal.goal_id.uuid))
        return CancelResponse.ACCEPT

    def _tick(self) -> None:
        while self._cancelled:
            key = self._cancelled.pop()
            self._goal_goes_on(self._gate.cancel(key))
            self._handle([CancelRequested(key)])
        self._goal_goes_on(self._gate.look(*self._who_is_missing()))
        self._handle([TimePassed()])

    def _handle(self, events: Iterable[Event]) -> None:
        """Pass events to the session and carry out what it answers."""
        try:
            instructions = self._session.handle_all(events, self.awake.now())
            counts = self._session.fetch_counts()
            self.health.messages += counts.messages
            self.health.ignored += counts.ignored
            for instruction in instructions:
                self._carry_out(instruction)
        except RunError as error:
            raise StartupError(str(error)) from None

    # ---- instructions

    def _carry_out(self, instruction: Instruction) -> None:
        match instruction:
            case Publish(topic, data):
                self._publish(topic, data)
                if topic == "plan":
                    self.log_run(cdr.decode("Plan", data))
            case ListenTo(station):
                self._listen_to(station)
            case PublishMap(values):
                self._map.publish(cdr.encode("BasinMap", values))
                self._image.publish(image_message(values, self.wall_time()))
                self._regimes.publish(regimes_message(values, self.wall_time()))
                self._chooser.take_map(values)
            case PublishFeedback(goal, values):
                self._goals[goal].publish_feedback(RunSweep.Feedback(**values))
            case AnswerGoal(goal, values):
                self._results[goal] = RunSweep.Result(**values)
                self._goals.pop(goal).execute()
            case SetState(state, detail, run_id):
                self.set_state(state, detail, run_id)
                if state == Health.BUSY:
                    self._prepare()
            case Log("error", line):  # rclpy wants one line of code for each severity
                self.get_logger().error(line)
            case Log("warning", line):
                self.get_logger().warning(line)
            case Log(_, line):
                self.get_logger().info(line)
            case WriteResults(run, basin):
                problem = write_results(run, basin, self._painter)
                self._handle([ResultsWritten(playability_of(run, basin), problem())])
            case RunEnded():
                self.finished = self._once
                if not self._once:
                    gc.collect()  # the parts of a figure refer to each other: 10 MB that only the collector frees

    def _publish(self, topic: str, data: bytes) -> None:
        try:
            self._topics[topic].publish(data)
        except RCLError as error:  # a subscriber hangs; a block that does not arrive is sent again
            if topic != "blocks":
                raise
            self.get_logger().warning(f"a block is not sent: {error}", throttle_duration_sec=5.0)

    def _end_goal(self, goal: Any) -> RunSweep.Result:
        """Return the result of a goal that was executed, and set its state."""
        result = self._results.pop(bytes(goal.goal_id.uuid))
        if goal.is_cancel_requested:
            goal.canceled()
        elif result.run_id:
            goal.succeed()
        else:
            goal.abort()
        return result

    def _publish_diagnostics(self) -> None:
        now, run, node, host = self.awake.now(), self._session.run, self.health.node, self.health.host
        nodes = diagnostics.in_turn([*self._session.nodes.values()], self._diagnosed)
        self._diagnosed += 1
        items = [
            diagnostics.health_of(self.health, True),
            *diagnostics.nodes_health(nodes, lambda incarnation: self.neighbours.is_alive(incarnation, now)),
            diagnostics.sweep_of(node, host, self.health.run_id, run.accounts() if run else None),
            diagnostics.last_word(node, host, "goal", self._session.refused, "no goal was refused lately"),
            diagnostics.last_word(node, host, "inspection", self._chooser.problem, self._chooser.latest),
        ]
        self._diagnostics.publish(diagnostics_message(items, self.wall_time()))
        self._chooser.publish_points()


def main() -> int:
    """Entry point of ``ros2 run bow coordinator``."""
    return run_node(CoordinatorNode, description=HELP)


if __name__ == "__main__":
    raise SystemExit(main())
