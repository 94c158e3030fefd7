"""The recorder node: subscribes to everything on the graph of a run, writes it to a bag, and gives receipts.

A latched `plan` opens the bag of a run and closes it. Streams and verdicts are stored once by identity and answered
every time; a receipt goes out after its bytes are in the file, and one for every block when all of it is on the disk.
After a restart the bag goes on in its next file.
"""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Callable
from importlib import import_module
from pathlib import Path
from typing import Any

from bow_msgs.msg import Health, Receipt
from rcl_interfaces.msg import ParameterDescriptor
from rclpy.qos import DurabilityPolicy, HistoryPolicy, QoSProfile, ReliabilityPolicy
from rclpy.serialization import deserialize_message

from bow_sim.graph.node_base import STREAM, BowNode, RCLError, live
from bow_sim.protocol import cdr
from bow_sim.protocol.authority import Authority
from bow_sim.protocol.neighbours import FIRST_HELLO_S, HELLO_S, SILENT_S, Neighbour
from bow_sim.protocol.states import PlanState
from bow_sim.protocol.sweep_outline import SweepOutline
from bow_sweep.record.bag import FOLDER, BagError
from bow_sweep.record.session import COMMIT_S, AlreadyClosedError, Session, log_name
from bow_sweep.record.topics import STORED_ONCE, TOPICS, Qos, Topic
from bow_sweep.run.lock import LockedError, LockError

HELP = """
usage: ros2 run bow recorder [--ros-args -r __ns:=/bow/RUN -p runs_dir:=runs | -p run_dir:=DIRECTORY]

Records everything on the graph of its namespace (default /bow): when the latched topic `plan` opens a run, into the
rosbag2 directory <runs_dir>/<run_id>/bag, or <run_dir>/bag; when it closes it, the bag is finished.
Answers on `receipts` for every chunk and verdict that is in the file.
"""

DEPTH = 1000
"""Messages kept for us on topics that are not KEEP_ALL."""

RETRY_S = 0.25
"""Between two tries to publish receipts while a subscriber hangs: publish() itself waits 0.1 s."""

COMPLAINTS = 20
"""Different complaints put in the log at most, for each run: rubbish is counted, not repeated."""


AGAIN_S = 2.0
"""Between two receipts for a block that is on the disk and not done: the first may have got lost."""

READERS = (("receipts", "coordinator"),)
"""Who has to hear what."""


def subscription_qos(qos: Qos) -> QoSProfile:
    """Return what to ask for on a topic offered with `qos`: what it gives, and room for it."""
    if qos.history == "keep_all":
        return STREAM
    return QoSProfile(
        depth=DEPTH,
        history=HistoryPolicy.KEEP_LAST,
        reliability=ReliabilityPolicy.RELIABLE if qos.reliability == "reliable" else ReliabilityPolicy.BEST_EFFORT,
        durability=DurabilityPolicy.TRANSIENT_LOCAL
        if qos.durability == "transient_local"
        else DurabilityPolicy.VOLATILE,
    )


class RecorderNode(BowNode):
    """Records one run after the other."""

    def __init__(self) -> None:
        super().__init__("recorder")
        texts = {
            "runs_dir": ("runs", "directory of the run directories, each named by its run_id"),
            "run_dir": ("", "exact run directory, instead of one below runs_dir"),
        }
        runs_dir, run_dir = (
            self.declare_parameter(name, default, ParameterDescriptor(description=what, read_only=True)).value
            for name, (default, what) in texts.items()
        )
        switches = {
            "sync": "say that a block is stored only when it is on the disk; false: when it is in the file",
            "lock": "lock run directories; false: not, for file systems without locks",
        }
        self._sync, self._locks = (
            self.declare_parameter(name, True, ParameterDescriptor(description=what, read_only=True)).value
            for name, what in switches.items()
        )
        self._runs_dir, self._run_dir = Path(runs_dir), Path(run_dir) if run_dir else None
        self._session: Session | None = None
        self._waiting: tuple[dict[str, Any], bytes] | None = None
        self._done_with: tuple[str, int] = ("", 0)  # run and epoch that are closed, or that cannot be recorded
        self._complained = self._counted = 0
        self._outbox: deque[bytes] = deque()
        self._try_at = self._last_sent = self._waits_until = self._last_said = 0.0
        self._authority = Authority(self.works_for)
        # In the bag a topic has the name that readers look for, also where it is remapped on the graph.
        prefix = self.get_namespace().rstrip("/")
        self._names = {name: name if name.startswith("/") else f"{prefix}/{name}" for name in TOPICS}
        self._loggers = self.get_namespace().strip("/").replace("/", ".")
        self._receipts = self.create_publisher(Receipt, "receipts", STREAM)
        for topic in TOPICS.values():
            if topic.name == "receipts":
                continue  # our own: written as they are made
            kind = _class_of(topic)
            taker = self._on_plan if topic.name == "plan" else self._taker(topic, kind)
            self.create_subscription(kind, topic.name, taker, subscription_qos(topic.qos), raw=True)
        self.every(COMMIT_S, self._tick)
        self.become(Health.READY, "waits for a plan")

    def _taker(self, topic: Topic, kind: type) -> Callable[[bytes], None]:
        checked = topic.name in ("health", "basin_map/image", "diagnostics", "/rosout")
        sealed = STORED_ONCE.get(topic.name, "")

        def take(data: bytes) -> None:
            if sealed and (sender := cdr.hello_from(sealed, data)):
                self.heard(topic.name, sender)
                return
            session = self._session
            if session is None:
                return
            if checked and not self._readable(topic, kind, data):
                return
            session.take(topic.name, data, time.time_ns())
            for name, sender in session.senders:
                self.heard(name, sender)
            session.senders.clear()
            if session.full:
                self._commit(session)

        return take

    def _readable(self, topic: Topic, kind: type, data: bytes) -> bool:
        """Whether a message that has no identity may enter the bag: it is one, and of our namespace."""
        if topic.name == "/rosout" and not log_name(data).startswith(self._loggers):
            return False
        try:
            deserialize_message(data, kind)
        except Exception:  # rclpy raises what the type support likes
            self.health.ignored += 1
            return False
        return True

    # ---- the plan opens and closes the bag

    def _on_plan(self, data: bytes) -> None:
        try:
            plan = cdr.decode("Plan", data)
        except cdr.WireError as error:
            self._complain(f"plan: {error}")
            return
        why = self._authority.objection(plan)
        if why:
            self.health.ignored += 1
            self._complain(f"plan: {why}")
            return
        session = self._session
        if session is not None:
            if (plan["run_id"], plan["sweep_id"]) == (session.expected.run_id, session.expected.sweep_id):
                session.plan(plan, data, time.time_ns())
                return
            self._finish(f"run {plan['run_id']} opens")
        self._waiting = None
        if (plan["run_id"], plan["epoch"]) == self._done_with:
            self._authority.release()
            self.health.ignored += plan["state"] == PlanState.OPEN
            return
        self._waiting, self._waits_until = (plan, data), self.awake.now() + SILENT_S
        self._open()

    def _open(self) -> None:
        assert self._waiting is not None
        plan, data = self._waiting
        run = str(plan["run_id"])
        if not self.works_for(plan["incarnation"], run):  # a plan out of a bag, or it has not heard of us yet
            if self.awake.now() > self._waits_until:
                self._waiting = None
                self._authority.release()
                self.health.ignored += 1
                self._complain(f"plan: run {run}: no living coordinator {plan['incarnation']} that hears this recorder")
            return
        self._waiting = None
        try:
            SweepOutline.of(plan)  # before its run_id names a directory
            directory = self._run_dir or self._runs_dir / run
            if plan["state"] == PlanState.CLOSED and not (directory / FOLDER).is_dir():
                return  # over before we came
            session = (directory, plan, data, self._names, self.incarnation, time.time_ns())
            self._session = Session(*session, sync=self._sync, lock=self._locks)
        except LockedError as error:
            self._waiting = (plan, data)
            self.become(Health.STARTING, str(error), run)
        except AlreadyClosedError as error:
            self._done_with = (run, plan["epoch"])
            self.become(Health.CLOSED, str(error), run)
        except (BagError, LockError, OSError, ValueError, LookupError) as error:
            self._done_with = (run, plan["epoch"])
            self.get_logger().error(f"run {run} cannot be recorded: {error}")
            self.become(Health.FAILED, f"cannot record: {error}", run)
        else:
            self._complained = self._counted = 0
            for file in self._session.report["files"]:
                if file["did"] != "keep":
                    self.get_logger().warning(
                        f"{file['file']} is {file['was']}, {file['did']}: {file['messages']} messages stay; taken out: "
                        f"{', '.join(file['aside']) or 'nothing'}"
                    )
            self.become(Health.STARTING, f"opened {self._session.bag.path}", run)
            self._tick()

    def on_health(self, message: Health, neighbour: Neighbour | None) -> None:
        """Go on at once when the coordinator says that it hears us."""
        if message.role == "coordinator" and (self._waiting is not None or self.health.state == Health.STARTING):
            self._tick()

    # ---- time

    def _tick(self) -> None:
        if self._waiting is not None and self._session is None:
            self._open()
        session = self._session
        if session is None:
            return
        if session.closed:
            self._finish("the plan is closed")
            return
        if self.awake.now() - self._last_said >= AGAIN_S:
            self._last_said = self.awake.now()
            session.say_again()
        self._commit(session)
        self._look(session)
        self._publish()

    def _look(self, session: Session) -> None:
        """Be at work as long as the coordinator of this run says that it hears our receipts."""
        run, starting, now = session.expected.run_id, self.health.state == Health.STARTING, self.awake.now()
        if now - self._last_sent >= (FIRST_HELLO_S if starting else HELLO_S) and not self._outbox:
            self._send(session.empty_receipt())
        if self.is_heard(READERS, run) and starting:
            self.become(Health.BUSY, f"records to {session.bag.path}")

    def beat(self) -> None:
        """Publish the state of this node now, with the counts of the open bag."""
        session = getattr(self, "_session", None)
        if session is not None:
            self._count(session)
        super().beat()

    def _count(self, session: Session) -> None:
        self.health.messages, self.health.bytes = session.messages, session.bytes
        self.health.duplicates = session.inventory.duplicates
        self.health.ignored, self._counted = self.health.ignored + session.ignored - self._counted, session.ignored

    def _commit(self, session: Session) -> None:
        try:
            message = session.commit(time.time_ns())
        except OSError as error:
            self._fail(session, error)
            return
        self._send(message)
        for complaint in list(session.complaints):
            self._complain(complaint)
        session.complaints.clear()

    def _send(self, message: bytes | None) -> None:
        if message is not None:
            self._outbox.append(message)
            self._publish()

    def _publish(self) -> None:
        """Publish the receipts that are due, in order; what cannot go out now waits. Credit bounds how many can."""
        while self._outbox and time.monotonic() >= self._try_at:
            try:
                self._receipts.publish(self._outbox[0])
            except RCLError as error:
                self._try_at = time.monotonic() + RETRY_S
                listeners = self.get_subscriptions_info_by_topic(self._receipts.topic_name)
                names = ", ".join(sorted({listener.node_name for listener in listeners}))
                self.get_logger().warning(
                    f"{len(self._outbox)} receipts wait, one of the subscribers hangs ({names}): {error}",
                    throttle_duration_sec=5.0,
                )
            else:
                self._outbox.popleft()
                self._last_sent = self.awake.now()

    def _complain(self, complaint: str) -> None:
        self._complained += 1
        if self._complained <= COMPLAINTS:
            self.get_logger().warning(f"ignored: {complaint}")

    def _finish(self, why: str) -> None:
        """Close the bag properly."""
        session, self._session = self._session, None
        if session is None:
            return
        run = session.expected.run_id
        self._done_with = (run, session.last_plan["epoch"]) if session.closed else ("", 0)
        self._authority.release()
        try:
            message = session.close(time.time_ns())
        except OSError as error:
            self._fail(session, error)
            return
        self._send(message)
        self._count(session)
        self.become(Health.CLOSED, f"{session.bag.path.parent} is closed: {why}", run)

    def _fail(self, session: Session, error: OSError) -> None:
        """Give up a bag that the disk does not take: what was committed stays, no receipt is given any more."""
        self._session = None
        self._done_with = (session.expected.run_id, session.last_plan["epoch"])
        self._authority.release()
        session.abandon()
        what = f"{session.bag.path}: {error.strerror or error}; nothing more is recorded; make room and resume"
        self.get_logger().error(what)
        self.become(Health.FAILED, what, session.expected.run_id)

    def close(self) -> None:
        """Finish the bag; what is still under way is not answered and so will be sent again."""
        self._finish("the recorder was told to stop")


def _class_of(topic: Topic) -> type:
    package, _, name = topic.type.split("/")
    kind: type = getattr(import_module(f"{package}.msg"), name)
    return kind


def main() -> int:
    """Entry point of ``ros2 run bow recorder``."""
    return live(RecorderNode, description=HELP)


if __name__ == "__main__":
    raise SystemExit(main())
