"""The coordinator node: hands the blocks of a sweep to simulators until every one is done, recorded and judged."""

from __future__ import annotations

import gc
import time
from pathlib import Path
from typing import Any

import numpy as np
from bow_msgs.action import RunSweep
from bow_msgs.msg import BasinMap, Block, Health, Plan, Receipt, Verdicts
from diagnostic_msgs.msg import DiagnosticArray
from rcl_interfaces.msg import ParameterDescriptor
from rclpy.action import ActionServer, CancelResponse
from sensor_msgs.msg import Image

from bow_sim.graph.node_base import LATCHED, STREAM, WORK, BowNode, RCLError, StartupError, live
from bow_sim.physics.errors import ParameterError
from bow_sim.protocol import cdr
from bow_sim.protocol.identity import random_id
from bow_sim.protocol.neighbours import CONSUMERS, FIRST_HELLO_S, HELLO_S, Neighbour
from bow_sweep.coordinator import messages
from bow_sweep.coordinator.closing import DRAW_S, DRAW_SAY_S, waits_for
from bow_sweep.coordinator.consumers import Consumers
from bow_sweep.coordinator.results import basin_of, playability_of, prepare, write_results, writing
from bow_sweep.coordinator.resume import resume
from bow_sweep.coordinator.simulator_pool import Pool
from bow_sweep.plan.sweep import Sweep
from bow_sweep.run.directory import Run, RunError
from bow_sweep.run.ledger import (
    ConsumerRestarted,
    Dispatch,
    Event,
    Grown,
    Judged,
    NewEpoch,
    Record,
    Settled,
    State,
    Tick,
    receipted,
)

HELP = """
usage: ros2 run bow coordinator [--ros-args -r __ns:=/bow/RUN -p preset:=fig11d -p settings:="[x.count=16]"
                                 -p runs_dir:=runs -p resume:=RUN_DIRECTORY]

Runs sweeps. With `preset` or `settings` it begins one at once; otherwise it waits for a goal:
  ros2 action send_goal -f /bow/run_sweep bow_msgs/action/RunSweep "{spec: {preset: fig11d, settings: ['x.count=16']}}"
It hands out blocks as soon as a recorder, a classifier and at least one simulator are in its namespace (default /bow)
and say that they hear each other, and leaves each run in <runs_dir>/<run_id>.
"""

TICK_S = 0.2
"""Between two looks at the pool, two maps and two progress messages: 5 Hz."""

ANNOUNCE_S = 1.0
"""The plan is said again so often as long as recorder, classifier or a simulator have not taken it up."""


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
        text = {name: self._declared(name, defaults.get(name, ""), what) for name, what in texts.items()}
        settings = self._declared("settings", [""], '"name=value" settings over the preset')
        self._once = self._declared("once", False, "end this process when the first run is finished")
        self._shown = self._declared("dashboard", False, "a dashboard was started: end a run only when it has drawn it")
        self._locks = self._declared("lock", True, "lock run directories; false: not, for file systems without locks")
        self._runs_dir, self._run_dir, self._run_id = Path(text["runs_dir"]), text["run_dir"], text["run_id"]
        self._run: Run | None = None
        self._goal: Any = None
        self._closing = False
        self._nodes: dict[str, Health] = {}
        self._consumers = Consumers(self.neighbours, self.get_logger().error)
        self._tested = -1
        self._announced: Plan | None = None
        self._last_report = self._last_plan = self._last_hello = 0.0

        self._plan = self.create_publisher(Plan, "plan", LATCHED)
        self._map = self.create_publisher(BasinMap, "basin_map", LATCHED)
        self._image = self.create_publisher(Image, "basin_map/image", LATCHED)
        self._diagnostics = self.create_publisher(DiagnosticArray, "diagnostics", 10)
        self._blocks = self.create_publisher(Block, "blocks", WORK)
        self.create_subscription(Receipt, "receipts", self._on_receipts, STREAM, raw=True)
        self.create_subscription(Verdicts, "verdicts", self._on_verdicts, STREAM, raw=True)
        self._pool = Pool(self._handle, self.health.host, self.get_logger().warning)
        self._server = ActionServer(
            self,
            RunSweep,
            "run_sweep",
            execute_callback=self._conclude,
            handle_accepted_callback=self._on_accepted,
            cancel_callback=lambda _: CancelResponse.ACCEPT,
            result_timeout=60,
        )
        self.every(TICK_S, self._tick)
        try:
            if text["resume"]:
                self._begin(*resume(Path(text["resume"]).absolute(), self.get_logger().warning, self._locks))
            elif text["preset"] or any(settings):
                self._begin(self._create(Sweep.from_spec(text["preset"], [s for s in settings if s])))
            else:
                self.become(Health.READY, "waits for a goal on run_sweep")
        except (RunError, ParameterError) as error:
            raise StartupError(str(error)) from None
        prepare()  # now, while the others start

    def _declared(self, name: str, default: Any, what: str) -> Any:
        return self.declare_parameter(name, default, ParameterDescriptor(description=what, read_only=True)).value

    # ---- beginning and end

    def _create(self, sweep: Sweep) -> Run:
        identity, self._run_id = self._run_id or random_id(), ""
        directory, self._run_dir = Path(self._run_dir) if self._run_dir else self._runs_dir / identity, ""
        return Run.create(directory.absolute(), identity, sweep, self._locks)

    def _begin(self, run: Run, recorded: dict[str, np.ndarray] | None = None) -> None:
        self._run, self._closing = run, False
        self._pool.begin()
        sweep = run.sweep
        self._basin = basin_of(recorded or {}, sweep)
        self._began = time.monotonic()
        self._done_before = run.cells_in(State.DONE)
        self._tested = -1
        self.become(Health.STARTING, "a sweep opens", run.run_id)
        if run.ledger.finished:  # it was cut off between its last block and its report
            self._go_on_or_close(run)
        else:
            self._publish_plan(Plan.OPEN)
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
            self._goal.bow_outcome = messages.result_message(run, report, message)
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

    def _on_accepted(self, goal: Any) -> None:
        """Begin a sweep; a goal that cannot be is aborted rather than rejected, as a rejection tells no reason."""
        try:
            if self._run is not None:
                raise RunError(f"run {self._run.run_id} is not finished; one sweep at a time")
            run = self._create(Sweep.from_spec(goal.request.spec.preset, goal.request.spec.settings))
        except (ParameterError, RunError) as error:
            self.get_logger().error(f"goal refused: {error}")
            self.become(self.health.state, f"goal refused: {error}")
            goal.bow_outcome = RunSweep.Result(message=str(error))
            goal.execute()
            return
        self._goal = goal
        self._begin(run)

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

    def on_health(self, message: Health, neighbour: Neighbour | None) -> None:
        """Note who is there and who is ready."""
        run_id = self._run.run_id if self._run else ""
        self._nodes[message.node] = message
        if message.role == "simulator":
            hears_us = neighbour is not None and "blocks" in neighbour.hears
            self._pool.on_health(message, run_id, hears_us, self.awake.now())
        elif message.role in CONSUMERS and neighbour is not None and self._consumers.take(neighbour, self.awake.now()):
            self.get_logger().warning(f"{message.role} restarted: unfinished blocks are due again")
            self._handle(ConsumerRestarted(message.role))
        self._begin_work()
        self._finish_when_closed()

    def _mine(self, values: Any) -> bool:
        run = self._run
        if run is not None and (values["run_id"], values["sweep_id"]) == (run.run_id, run.sweep.sweep_id):
            return True
        self.health.ignored += 1
        return False

    def _on_receipts(self, data: bytes) -> None:
        try:
            receipt = cdr.decode("Receipt", data)
        except cdr.WireError:
            self.health.ignored += 1
            return
        self.heard("receipts", receipt["incarnation"])
        columns = [receipt[name].tolist() for name in ("kind", "block", "chunk", "checksum")]
        if not self._mine(receipt) or len({len(column) for column in columns}) != 1:
            return
        for kind, block, chunk, checksum in zip(*columns, strict=True):
            self._handle(receipted(kind, block, chunk, checksum))
        self.health.messages += len(columns[0])

    def _on_verdicts(self, data: bytes) -> None:
        sender = cdr.hello_from("Verdicts", data)
        if sender:
            self.heard("verdicts", sender)
            return
        try:
            verdict = cdr.unseal("Verdicts", data)
        except cdr.WireError:
            self.health.ignored += 1
            return
        run = self._run
        if not self._mine(verdict) or run is None:
            return
        self.heard("verdicts", verdict["incarnation"])
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
        out = run.ledger.handle(event, self.awake.now())
        run.record(item.entry for item in out if isinstance(item, Record))
        for item in out:
            match item:
                case Dispatch(block, attempt, simulator):
                    self._send(run, block, attempt, simulator)
                case NewEpoch():
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
        incarnation = self._pool.send(simulator, block, attempt, self.awake.now())
        if incarnation:
            self._publish_block(messages.block_message(run, self.incarnation, incarnation, block, attempt))

    def _say_hello(self, now: float) -> None:
        """Show simulators that blocks arrive, more often while one does not say so."""
        run = self._run
        simulators = self.neighbours.of_role("simulator", now)
        deaf = any("blocks" not in simulator.hears for simulator in simulators)
        if run is not None and simulators and now - self._last_hello >= (FIRST_HELLO_S if deaf else HELLO_S):
            self._last_hello = now
            self._publish_block(messages.block_message(run, self.incarnation))

    def _publish_block(self, message: bytes) -> None:
        try:
            self._blocks.publish(message)
        except RCLError as error:  # a subscriber hangs: what is not taken is sent again
            self.get_logger().warning(f"a block is not sent: {error}", throttle_duration_sec=5.0)

    def _close_run(self) -> None:
        """Tell everybody that the run is over, and draw the map while they close what they write."""
        assert self._run is not None
        self._closing = True
        self._closed_at = self.awake.now()
        self._publish_map()
        self._publish_plan(Plan.CLOSED)
        self.become(Health.BUSY, "drawing the map, while the bag is closed")
        self._playability = playability_of(self._run, self._basin)
        if problem := write_results(self._run, self._basin, StartupError):
            self.get_logger().error(f"not drawn: {problem}")
            self.become(Health.BUSY, f"not drawn: {problem}")
        self.become(Health.BUSY, "waiting for the bag to close")

    # ---- five times a second

    def _tick(self) -> None:
        now = self.awake.now()
        if now - self._last_report >= 1.0:
            self._last_report = now
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
        if now - self._last_plan >= ANNOUNCE_S and self._consumers.untold(run.run_id, now):
            self._publish_plan(Plan.OPEN)
        self._say_hello(now)
        self._begin_work()
        self._handle(Tick())
        if self._run is not None and not self._closing:
            self._publish_plan(Plan.OPEN, if_changed=True)
            self._publish_map()
            self._publish_progress()

    def _begin_work(self) -> None:
        """Hand out blocks as long as recorder and classifier of this run are ready; else say for whom it waits."""
        run = self._run
        if run is None or self._closing:
            return
        now = self.awake.now()
        waits_for = self._consumers.missing(run.run_id, now)
        self._pool.look(now, may_join=not waits_for)
        if not waits_for and not self.neighbours.of_role("simulator", now):
            waits_for = ["no simulator is heard"]
        if waits_for:
            self.become(Health.STARTING, f"waiting in {self.get_namespace()}: {', '.join(waits_for)}")
        elif self.health.state == Health.STARTING:
            self.become(Health.BUSY)

    def _finish_when_closed(self) -> None:
        """Finish once a recorder has closed the bag and no dashboard is still at work, or they take too long."""
        run = self._run
        if self._closing and run is not None:
            waited = self.awake.now() - self._closed_at
            missing = waits_for(self._nodes.values(), run.run_id, waited, self._shown)
            if not missing:
                self._finish()
            elif missing == "dashboard" and waited > DRAW_SAY_S:
                self.become(Health.BUSY, f"waiting for the dashboard to draw its last picture, {DRAW_S:g} s at most")

    # ---- what goes out

    def _publish_plan(self, state: int, if_changed: bool = False) -> None:
        assert self._run is not None
        message = messages.plan_message(self._run, state, self.incarnation)
        if not if_changed or message != self._announced:
            self._announced, self._last_plan = message, self.awake.now()
            self._plan.publish(message)

    def _publish_map(self) -> None:
        assert self._run is not None
        tested = int(self._basin.tested.sum())
        if tested != self._tested:
            self._tested = tested
            message = messages.map_message(self._run, self._basin)
            self._map.publish(cdr.encode("BasinMap", message))
            self._image.publish(messages.image_message(message, self.wall_time()))

    def _publish_progress(self) -> None:
        if self._goal is not None and self._run is not None:
            done = self._run.cells_in(State.DONE) - self._done_before
            rate = done / max(time.monotonic() - self._began, 1e-9)
            self._goal.publish_feedback(messages.feedback_message(self._run, self._basin, rate))

    def _publish_diagnostics(self) -> None:
        nodes = [*self._nodes.values(), self.health]
        self._diagnostics.publish(messages.diagnostics_message(nodes, self.wall_time()))


def main() -> int:
    """Entry point of ``ros2 run bow coordinator``."""
    return live(CoordinatorNode, description=HELP)


if __name__ == "__main__":
    raise SystemExit(main())
