"""The coordinator node: hands the blocks of a sweep to simulators until every one is done, recorded and judged."""

from __future__ import annotations

import gc
import time
from pathlib import Path
from typing import Any

import numpy as np
from bow_msgs.action import RunSweep, Simulate
from bow_msgs.msg import BasinMap, Health, Plan, Receipt, Verdicts
from diagnostic_msgs.msg import DiagnosticArray
from rcl_interfaces.msg import ParameterDescriptor
from rclpy.action import ActionServer, CancelResponse, GoalResponse
from sensor_msgs.msg import Image

from bow_sim import wire
from bow_sim.identity import fingerprint, random_id
from bow_sim.model import ParameterError
from bow_sim.ros import CONSUMERS, HEARD, LATCHED, STREAM, BowNode, StartupError, live, publishes

from . import announce
from .ledger import ConsumerRestarted, Dispatch, Event, Grown, Judged, NewEpoch, Record, Settled, State, Tick, receipted
from .plan import Sweep
from .pool import Pool
from .results import basin_of, playability_of, prepare, write_results, writing
from .resume import resume
from .run import Run, RunError

HELP = """
usage: ros2 run bow coordinator [--ros-args -r __ns:=/bow/RUN -p preset:=fig11d -p settings:="[x.count=16]"
                                 -p runs_dir:=runs -p resume:=RUN_DIRECTORY]

Runs sweeps. With `preset` or `settings` it begins one at once; otherwise it waits for a goal:
  ros2 action send_goal -f /bow/run_sweep bow_msgs/action/RunSweep "{spec: {preset: fig11d, settings: ['x.count=16']}}"
It hands out blocks as soon as a recorder, a classifier and at least one simulator are in its namespace (default /bow),
and leaves each run in <runs_dir>/<run_id>.
"""

TICK_S = 0.2
"""Between two looks at the pool, two maps and two progress messages: 5 Hz."""

IDLE_S = 10.0
"""After the plan has closed, a dashboard that is starting, or has no run yet, has this long to take this one up."""

CLOSE_S = 60.0
"""The recorder has this long to close the bag before the results are written without it."""


class CoordinatorNode(BowNode):
    """Serves `run_sweep`; owns every block until it is done."""

    def __init__(self) -> None:
        super().__init__("coordinator")
        texts = {
            "preset": "preset to run at once; empty = wait for a goal",
            "runs_dir": "directory in which run directories are made, each named by its run_id",
            "run_dir": "exact directory of the next run, instead of one below runs_dir",
            "run_id": "identity of the next run, 16 hexadecimal digits; empty = random",
            "resume": "directory of a run to go on with at once",
        }
        defaults = {"runs_dir": "runs"}
        text = {
            name: self.declare_parameter(name, defaults.get(name, ""), ParameterDescriptor(description=what)).value
            for name, what in texts.items()
        }
        settings = self.declare_parameter(
            "settings", [""], ParameterDescriptor(description='"name=value" settings over the preset')
        ).value
        once = ParameterDescriptor(description="end this process when the first run is finished")
        self._once = self.declare_parameter("once", False, once).value
        shown = ParameterDescriptor(description="a dashboard was started: end a run only when it has drawn it")
        self._shown = self.declare_parameter("dashboard", False, shown).value
        lock = ParameterDescriptor(description="lock run directories", read_only=True)
        self._locks = self.declare_parameter("lock", True, lock).value
        self._runs_dir, self._run_dir, self._run_id = Path(text["runs_dir"]), text["run_dir"], text["run_id"]
        self._run: Run | None = None
        self._goal: Any = None
        self._closing = False
        self._nodes: dict[str, Health] = {}
        self._consumers: dict[str, str] = {}
        self._ready: set[str] = set()
        self._tested = -1
        self._announced: Plan | None = None
        self._last_tick = self._last_beat = time.monotonic()

        self._plan = self.create_publisher(Plan, "plan", LATCHED)
        self._map = self.create_publisher(BasinMap, "basin_map", LATCHED)
        self._image = self.create_publisher(Image, "basin_map/image", LATCHED)
        self._diagnostics = self.create_publisher(DiagnosticArray, "diagnostics", 10)
        self.create_subscription(Health, "health", self._on_health, HEARD)
        self.create_subscription(Receipt, "receipts", self._on_receipts, STREAM, raw=True)
        self.create_subscription(Verdicts, "verdicts", self._on_verdicts, STREAM, raw=True)
        self._pool = Pool(self, self._handle)
        self._server = ActionServer(
            self,
            RunSweep,
            "run_sweep",
            execute_callback=self._conclude,
            goal_callback=self._on_goal,
            handle_accepted_callback=self._on_accepted,
            cancel_callback=lambda _: CancelResponse.ACCEPT,
            result_timeout=60,
        )
        self.create_timer(TICK_S, self._tick)
        try:
            if text["resume"]:
                self._begin(*resume(Path(text["resume"]), self.get_logger().warning, self._locks))
            elif text["preset"] or any(settings):
                self._begin(self._create(Sweep.from_spec(text["preset"], [s for s in settings if s])))
            else:
                self.become(Health.READY, "waits for a goal on run_sweep")
        except (RunError, ParameterError) as error:
            raise StartupError(str(error)) from None
        prepare()  # now, while the others start

    # ---- beginning and end

    def _create(self, sweep: Sweep) -> Run:
        identity, self._run_id = self._run_id or random_id(), ""
        directory, self._run_dir = Path(self._run_dir) if self._run_dir else self._runs_dir / identity, ""
        return Run.create(directory, identity, sweep, self._locks)

    def _begin(self, run: Run, recorded: dict[str, np.ndarray] | None = None) -> None:
        self._run, self._closing = run, False
        self._ready = set()
        self._pool.begin()
        sweep = run.sweep
        self._basin = basin_of(recorded or {}, sweep)
        self._spec = announce.spec_message(run)
        self._began = time.monotonic()
        self._done_before = run.cells_in(State.DONE)
        self._tested = -1
        if run.ledger.finished:  # it was cut off between its last block and its report
            self._go_on_or_close(run)
        else:
            self._publish_plan(Plan.OPEN)
        if not self._closing:
            self.become(Health.STARTING, "waiting for recorder and classifier", run.run_id)
        self.get_logger().info(f"run {run.run_id}: {sweep.cells} cells, {run.blocks.count} blocks, in {run.directory}")

    def _finish(self) -> None:
        """Write the report, answer the goal, and wait for the next one."""
        run = self._run
        assert run is not None
        wall = time.monotonic() - self._began
        this_time = run.cells_in(State.DONE) - self._done_before
        with writing(run.directory, StartupError):
            report = run.report(self._basin, wall, {"cells_this_time": this_time, "playability": self._playability})
        cells = report["cells"]
        message = f"{cells['done']} of {cells['planned']} cells done, {cells['quarantined']} quarantined"
        if self._goal is not None:
            self._goal.bow_outcome = announce.result_message(run, report, message)
            self._goal.execute()
            self._goal = None
        self.get_logger().info(f"run {run.run_id}: {message} in {wall:.1f} s")
        run.close()
        self._run = None
        self.finished = self._once
        self.become(Health.READY, f"finished run {run.run_id}: {message}", "")
        if not self.finished:
            gc.collect()  # a figure is a knot of its parts, 10 MB of it

    def close(self) -> None:
        """Leave the ledger as it is: the run can be resumed."""
        if self._run is not None:
            self._run.close()

    # ---- the goal

    def _on_goal(self, goal: RunSweep.Goal) -> GoalResponse:
        try:
            if self._run is not None:
                raise RunError(f"run {self._run.run_id} is not finished; one sweep at a time")
            Sweep.from_spec(goal.spec.preset, goal.spec.settings)
        except (ParameterError, RunError) as error:
            self.get_logger().error(f"goal rejected: {error}")
            self.become(self.health.state, f"goal rejected: {error}")
            return GoalResponse.REJECT
        return GoalResponse.ACCEPT

    def _on_accepted(self, goal: Any) -> None:
        self._goal = goal
        try:
            self._begin(self._create(Sweep.from_spec(goal.request.spec.preset, goal.request.spec.settings)))
        except RunError as error:
            self.get_logger().error(str(error))
            goal.bow_outcome = RunSweep.Result(message=str(error))
            goal.execute()
            self._goal = None

    def _conclude(self, goal: Any) -> RunSweep.Result:
        result: RunSweep.Result = goal.bow_outcome
        if goal.is_cancel_requested:
            goal.canceled()
        elif result.run_id:
            goal.succeed()
        else:
            goal.abort()
        return result

    # ---- what comes in

    def _on_health(self, message: Health) -> None:
        now = time.monotonic()
        self._nodes[message.node] = message
        if message.role == "simulator":
            self._pool.on_health(message, self._run.run_id if self._run else "", now)
        elif message.role in CONSUMERS and message.state != Health.DEAD and self._run is not None:
            if message.run_id == self._run.run_id and message.state in (Health.READY, Health.BUSY):
                self._ready.add(message.role)
            known = self._consumers.setdefault(message.role, message.incarnation)
            if known != message.incarnation:
                self._consumers[message.role] = message.incarnation
                self.get_logger().warning(f"{message.role} restarted: unfinished blocks are due again")
                self._handle(ConsumerRestarted(message.role))
        self._finish_when_closed()

    def _mine(self, values: Any) -> bool:
        run = self._run
        if run is not None and (values["run_id"], values["sweep_id"]) == (run.run_id, run.sweep.sweep_id):
            return True
        self.health.ignored += 1
        return False

    def _on_receipts(self, data: bytes) -> None:
        try:
            receipt = wire.decode("Receipt", data)
        except wire.WireError:
            self.health.ignored += 1
            return
        columns = [receipt[name].tolist() for name in ("kind", "block", "chunk", "checksum")]
        if not self._mine(receipt) or len({len(column) for column in columns}) != 1:
            return
        for kind, block, chunk, checksum in zip(*columns, strict=True):
            self._handle(receipted(kind, block, chunk, checksum))
        self.health.messages += len(columns[0])

    def _on_verdicts(self, data: bytes) -> None:
        try:
            verdict = wire.unseal("Verdicts", data)
        except wire.WireError:
            self.health.ignored += 1
            return
        run = self._run
        if not self._mine(verdict) or run is None:
            return
        block, chunk, cells = verdict["block"], verdict["chunk"], verdict["cells"]
        if (
            verdict["classifier"] != run.sweep.thresholds.hash
            or block >= run.blocks.count
            or chunk >= run.sweep.chunks
            or not np.array_equal(cells, run.blocks.block(block))
        ):
            self.health.ignored += 1
            return
        self._basin.take(chunk, cells, verdict)
        self._handle(Judged(block, chunk, verdict["chunk_checksum"], verdict["checksum"]))
        self.health.messages += 1

    # ---- the ledger

    def _handle(self, event: Event) -> None:
        run = self._run
        if run is None or self._closing:
            return
        out = run.ledger.handle(event, time.monotonic())
        run.record(item.entry for item in out if isinstance(item, Record))
        for item in out:
            match item:
                case Dispatch(block, attempt, simulator):
                    self._send(run, block, attempt, simulator)
                case NewEpoch():
                    self._ready.discard(getattr(event, "role", ""))
                    self._publish_plan(Plan.OPEN)
                case Settled(block, State.QUARANTINED, why):
                    run.quarantined[block] = why
                    self.get_logger().error(f"block {block} is quarantined: {why}")
        if run.ledger.finished:
            self._go_on_or_close(run)

    def _go_on_or_close(self, run: Run) -> None:
        """Begin the next round of an adaptive sweep, which everybody hears of before its blocks; else close the run."""
        if run.next_round(self._basin):
            self._publish_plan(Plan.OPEN)
            self._handle(Grown(run.blocks.count))
        else:
            self._close_run()

    def _send(self, run: Run, block: int, attempt: int, simulator: str) -> None:
        cells = run.blocks.block(block)
        lanes = run.sweep.lanes(cells)
        goal = Simulate.Goal(
            run_id=run.run_id,
            sweep_id=run.sweep.sweep_id,
            epoch=run.ledger.epoch,
            fingerprint=fingerprint(),
            block=block,
            attempt=attempt,
            cells=cells,
            x=lanes[run.sweep.x.name],
            y=lanes[run.sweep.y.name],
        )
        self._pool.send(simulator, goal, self._spec)

    def _close_run(self) -> None:
        """Tell everybody that the run is over, and draw the map while they close what they write."""
        assert self._run is not None
        self._closing = True
        self._closed_at = time.monotonic()
        self._publish_map()
        self._publish_plan(Plan.CLOSED)
        self.become(Health.BUSY, "drawing the map, while the bag is closed")
        self._playability = playability_of(self._run, self._basin)
        with writing(self._run.directory, StartupError):
            write_results(self._run, self._basin)
        self.become(Health.BUSY, "waiting for the bag to close")

    # ---- five times a second

    def _tick(self) -> None:
        now = time.monotonic()
        if now - self._last_tick > 1.5:  # stopped, or the machine slept
            self._pool.slept(now - self._last_tick)
        self._last_tick = now
        if now - self._last_beat >= 1.0:
            self._last_beat = now
            self._publish_diagnostics()
        run = self._run
        if run is None:
            return
        if self._goal is not None and self._goal.is_cancel_requested and not self._closing:
            self.get_logger().warning(f"run {run.run_id} is cancelled; it can be resumed: -p resume:={run.directory}")
            self._close_run()
        if self._closing:
            self._finish_when_closed()
            return
        if len(self._ready) == 2 and self._answers_reach_us():
            if self.health.state == Health.STARTING:
                self.become(Health.BUSY)
            self._pool.look(run.run_id, now)
        self._handle(Tick())
        if self._run is not None and not self._closing:
            self._publish_plan(Plan.OPEN, if_changed=True)
            self._publish_map()
            self._publish_progress()

    def _finish_when_closed(self) -> None:
        """Finish once a recorder has closed the bag and no dashboard is still at work, or they take too long."""
        run = self._run
        if not self._closing or run is None:
            return
        gone, waited = (Health.CLOSED, Health.FAILED, Health.DEAD), time.monotonic() - self._closed_at
        late = waited > IDLE_S
        nodes = [node for node in self._nodes.values() if node.run_id == run.run_id or (not node.run_id and not late)]
        recorded = any(node.role == "recorder" and node.state in (Health.CLOSED, Health.FAILED) for node in nodes)
        drawn = [node.state in gone for node in nodes if node.role == "dashboard"]
        if (recorded and all(drawn) and (drawn or late or not self._shown)) or waited > CLOSE_S:
            self._finish()

    def _answers_reach_us(self) -> bool:
        return publishes(self, "recorder", "receipts") and publishes(self, "classifier", "verdicts")

    # ---- what goes out

    def _publish_plan(self, state: int, if_changed: bool = False) -> None:
        assert self._run is not None
        message = announce.plan_message(self._run, state)
        if not if_changed or message != self._announced:
            self._announced = message
            self._plan.publish(message)

    def _publish_map(self) -> None:
        assert self._run is not None
        tested = int(self._basin.tested.sum())
        if tested != self._tested:
            self._tested = tested
            message = announce.map_message(self._run, self._basin)
            self._map.publish(wire.encode("BasinMap", message))
            self._image.publish(announce.image_message(message, self.get_clock().now().to_msg()))

    def _publish_progress(self) -> None:
        if self._goal is not None and self._run is not None:
            done = self._run.cells_in(State.DONE) - self._done_before
            rate = done / max(time.monotonic() - self._began, 1e-9)
            self._goal.publish_feedback(announce.feedback_message(self._run, self._basin, rate))

    def _publish_diagnostics(self) -> None:
        nodes = [*self._nodes.values(), self.health]
        self._diagnostics.publish(announce.diagnostics_message(nodes, self.get_clock().now().to_msg()))


def main() -> int:
    """Entry point of ``ros2 run bow coordinator``."""
    return live(CoordinatorNode, description=HELP)


if __name__ == "__main__":
    raise SystemExit(main())
