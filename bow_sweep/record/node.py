"""The recorder node: subscribes to all topics of a run, writes the messages to a bag, and publishes receipts.

A latched `plan` opens and closes the bag of a run. Messages of streams and verdicts are stored once by identity, and
answered every time they arrive. A receipt for a chunk is published when its bytes are in the file, and one for a block
when all of it is on the disk. A recorder that is started again continues the bag in a new file.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from importlib import import_module
from pathlib import Path
from typing import Any

from bow_msgs.msg import Health, Receipt
from rclpy.qos import DurabilityPolicy, HistoryPolicy, QoSProfile, ReliabilityPolicy
from rclpy.serialization import deserialize_message
from rclpy.subscription import Subscription

from bow_sim.graph.inbox import Inbox
from bow_sim.graph.node_base import STREAM, BowNode
from bow_sim.graph.node_process import run_node
from bow_sim.graph.outbox import Outbox
from bow_sim.protocol import cdr
from bow_sim.protocol.neighbours import SILENT_S, Neighbour
from bow_sim.protocol.states import PlanState
from bow_sim.protocol.stations import HEALTH, station_of
from bow_sim.protocol.sweep_outline import SweepOutline
from bow_sweep.record.bag import BagError, bag_folder
from bow_sweep.record.session import COMMIT_S, AlreadyClosedError, Session, log_name
from bow_sweep.record.topics import STORED_ONCE, TOPICS, Qos, Topic
from bow_sweep.run.lock import LockedError, LockError
from bow_sweep.run.places import find_place

HELP = """
usage: ros2 run bow recorder [--ros-args -r __ns:=/bow/RUN -p runs_dir:=runs | -p run_dir:=DIRECTORY]

Records everything on the graph of its namespace (default /bow): when the latched topic `plan` opens a run, into the
rosbag2 directory <runs_dir>/<run_id>/bag, or <run_dir>/bag; when it closes it, the bag is finished.
In the namespace /bow/RUN/NAME with -p station:=NAME it records the station NAME of the run, into bag/NAME.
Answers on `receipts` for every chunk and verdict that is in the file.
"""

DEPTH = 1000
"""History depth of subscriptions to topics that are not KEEP_ALL."""

MOST_TAKEN = 1000
"""Messages with verdicts that are taken one after the other, at most."""

COMPLAINTS = 20
"""Complaints that are logged for each run, at most; further invalid messages are only counted."""

AGAIN_S = 2.0
"""Between two receipts for a block that is on the disk and not done: the first may be lost."""

RUN_ROLES = ("coordinator", "dashboard", "supervisor")
"""Nodes of the run whose log the recorder of each station records."""

READERS = (("receipts", "coordinator"),)
"""Pairs of topic and the role that has to receive it."""


def subscription_qos(qos: Qos) -> QoSProfile:
    """Return the quality of service to request on a topic that is offered with `qos`."""
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

    says_ends = False

    def __init__(self) -> None:
        super().__init__("recorder")
        runs_dir = self.read_parameter("runs_dir", "runs", "directory of the run directories, each named by its run_id")
        run_dir = self.read_parameter("run_dir", "", "exact run directory, instead of one below runs_dir")
        self._sync = self.read_parameter(
            "sync", True, "report a block as stored only when it is on the disk; false: when it is in the file"
        )
        self._locks = self.read_parameter(
            "lock", True, "lock run directories; false: not, for file systems without locks"
        )
        self._runs_dir, self._run_dir = Path(runs_dir), Path(run_dir) if run_dir else None
        places = self.read_parameter("places", "", "folder of notes that say where runs go, see `bow up`")
        self._places = Path(places) if places else None
        self._session: Session | None = None
        self._waiting: tuple[dict[str, Any], bytes] | None = None
        self._done_with: tuple[str, int] = ("", 0)  # run and epoch that are closed, or that cannot be recorded
        self._complained = self._counted = 0
        self._waits_until = self._answered_again_at = 0.0
        self._loggers = self.get_namespace().strip("/").replace("/", ".")
        run = self.run_namespace.strip("/").replace("/", ".")
        self._shared_loggers = tuple(f"{run}.{role}" for role in RUN_ROLES) if self.station else ()
        self._outbox = Outbox(self, self.create_publisher(Receipt, "receipts", STREAM))
        self.subscribe_plan(self._on_plan)
        for topic in TOPICS.values():
            kind, qos, name = _class_of(topic), subscription_qos(topic.qos), self.topic(topic.name)
            if topic.name == "verdicts":  # taken every 20 ms: nothing of them is answered sooner
                self._verdicts, self._take_verdicts = Inbox(self, kind, name, qos), self._taker(topic, kind)
            elif topic.name not in ("plan", "receipts"):  # the session writes our receipts
                for each in self.heartbeat_topics() if topic.name == HEALTH else (name,):
                    self.create_subscription(kind, each, self._taker(topic, kind), qos, raw=True)
        self.every(COMMIT_S, self._tick)
        self.set_state(Health.READY, "waits for a plan")

    @property
    def subscriptions(self) -> Iterator[Subscription]:
        """The subscriptions that the executor serves."""
        return (each for each in super().subscriptions if each is not self._verdicts.subscription)

    def _taker(self, topic: Topic, kind: type) -> Callable[[bytes], None]:
        checked = topic.name in (HEALTH, "basin_map/image", "basin_map/regimes", "/diagnostics", "/rosout")
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
        """Whether a message without identity may enter the bag: it can be decoded, and is of this namespace."""
        if topic.name == "/rosout" and not log_name(data).startswith((self._loggers, *self._shared_loggers)):
            return False
        try:
            message = deserialize_message(data, kind)
            if topic.name == HEALTH:
                return self.concerns(message.role, message.node)
            if topic.name == "/diagnostics":  # all graphs of a domain share it
                nodes = [status.name.partition(":")[0] for status in message.status]
                stations = [station_of(node, self.run_namespace) for node in nodes]
                return "" in stations and None not in stations  # of the coordinator of this run
        except Exception:  # the type support may raise any exception
            self.health.ignored += 1
            return False
        return True

    # ---- the plan opens and closes the bag

    def run_note(self) -> str:
        """Return how much is in the bag."""
        session = self._session
        return f"{session.messages} messages, {session.bytes / 1e6:.0f} MB recorded" if session is not None else ""

    def ignore(self, why: str) -> None:
        """Count a message that does not belong here, and log why."""
        self.health.ignored += 1
        self._complain(why)

    def _on_plan(self, plan: dict[str, Any], data: bytes) -> None:
        session = self._session
        if session is not None:
            if (plan["run_id"], plan["sweep_id"]) == (session.expected.run_id, session.expected.sweep_id):
                session.plan(plan, data, time.time_ns())
                return
            self._finish(f"run {plan['run_id']} opens")
        self._waiting = None
        if (plan["run_id"], plan["epoch"]) == self._done_with:
            self.authority.release()
            self.health.ignored += plan["state"] == PlanState.OPEN
            return
        self._waiting, self._waits_until = (plan, data), self.awake.now() + SILENT_S
        self._open()

    def _open(self) -> None:
        assert self._waiting is not None
        plan, data = self._waiting
        run = str(plan["run_id"])
        if not self.works_for(
            plan["incarnation"], run
        ):  # the plan is from a bag, or the coordinator has not received our heartbeat yet
            if self.awake.now() > self._waits_until:
                self._waiting = None
                self.authority.release()
                self.ignore(f"plan: run {run}: no living coordinator {plan['incarnation']} that hears this recorder")
            return
        self._waiting = None
        try:
            SweepOutline.of(plan)  # checks the run_id before it names a directory
            place = find_place(self._places, run)
            directory = self._run_dir or (place.directory if place else self._runs_dir / run)
            if plan["state"] == PlanState.CLOSED and not bag_folder(directory, self.station).is_dir():
                return  # the run ended before this recorder started
            session = (directory, plan, data, self.incarnation, time.time_ns())
            self._session = Session(*session, sync=self._sync, lock=self._locks, station=self.station)
        except LockedError as error:
            self._waiting = (plan, data)
            self.set_state(Health.STARTING, str(error), run)
        except AlreadyClosedError as error:
            self._done_with = (run, plan["epoch"])
            self.set_state(Health.CLOSED, str(error), run)
        except (BagError, LockError, OSError, ValueError, LookupError) as error:
            self._done_with = (run, plan["epoch"])
            self.get_logger().error(f"run {run} cannot be recorded: {error}")
            self.set_state(Health.FAILED, f"cannot record: {error}", run)
        else:
            self._complained = self._counted = 0
            for file in self._session.report["files"]:
                if file["did"] != "keep":
                    self.get_logger().warning(
                        f"{file['file']} is {file['was']}, {file['did']}: {file['messages']} messages stay; taken out: "
                        f"{', '.join(file['aside']) or 'nothing'}"
                    )
            self.get_logger().info(f"run {run} opens: records to {self._session.bag.path.parent}")
            self.set_state(Health.STARTING, f"opened {self._session.bag.path}", run)
            self._tick()

    def on_health(self, message: Health, neighbour: Neighbour | None) -> None:
        """Continue at once when the coordinator reports that it receives our messages."""
        if message.role == "coordinator" and (self._waiting is not None or self.health.state == Health.STARTING):
            self._tick()

    # ---- every 20 ms

    def _tick(self) -> None:
        if self._waiting is not None and self._session is None:
            self._open()
        for data in self._verdicts.take(MOST_TAKEN):
            self._take_verdicts(data)
        session = self._session
        if session is None:
            return
        if session.closed:
            self._finish("the plan is closed")
            return
        if self.awake.now() - self._answered_again_at >= AGAIN_S:
            self._answered_again_at = self.awake.now()
            session.repeat_receipts()
        self._commit(session)
        self._check_readers(session)

    def _check_readers(self, session: Session) -> None:
        """Be BUSY as long as the coordinator of this run reports that it receives the receipts."""
        starting = self.health.state == Health.STARTING
        if self.is_heard(READERS, session.expected.run_id) and starting:
            self.set_state(Health.BUSY, f"records to {session.bag.path}")
        self._outbox.send_hello(session.empty_receipt)

    def publish_health(self) -> None:
        """Publish the state of this node now, with the counts of the open bag."""
        session = getattr(self, "_session", None)
        if session is not None:
            self._count(session)
        super().publish_health()

    def _count(self, session: Session) -> None:
        self.health.messages, self.health.bytes = session.messages, session.bytes
        self.health.duplicates = session.stored.duplicates
        self.health.ignored, self._counted = self.health.ignored + session.ignored - self._counted, session.ignored

    def _commit(self, session: Session) -> None:
        try:
            message = session.commit(time.time_ns())
        except OSError as error:
            self._fail(session, error)
            return
        self._outbox.send([message] if message else ())
        for complaint in list(session.complaints):
            self._complain(complaint)
        session.complaints.clear()

    def _complain(self, complaint: str) -> None:
        self._complained += 1
        if self._complained <= COMPLAINTS:
            self.get_logger().warning(f"ignored: {complaint}")

    def _finish(self, why: str) -> None:
        """Finish the bag, so that it can be read by its index."""
        session, self._session = self._session, None
        if session is None:
            return
        run = session.expected.run_id
        self._done_with = (run, session.last_plan["epoch"]) if session.closed else ("", 0)
        self.authority.release()
        try:
            message = session.close(time.time_ns())
        except OSError as error:
            self._fail(session, error)
            return
        self._outbox.send([message] if message else ())
        self._count(session)
        how_much = f"{session.messages} messages, {session.bytes / 1e6:.0f} MB in {session.bag.path.parent}"
        if session.passed:
            how_much += f"; {session.passed} of the streams are not recorded (record={session.expected.record})"
        self.get_logger().info(f"run {run} closes, {why}: {how_much}")
        self.set_state(Health.CLOSED, f"{session.bag.path.parent} is closed: {why}", run)

    def _fail(self, session: Session, error: OSError) -> None:
        """Give up a bag that cannot be written any more: committed messages stay, no more receipts are published."""
        self._session = None
        self._done_with = (session.expected.run_id, session.last_plan["epoch"])
        self.authority.release()
        session.abandon()
        what = f"{session.bag.path}: {error.strerror or error}; nothing more is recorded; make room and resume"
        self.get_logger().error(what)
        self.set_state(Health.FAILED, what, session.expected.run_id)

    def close(self) -> None:
        """Finish the bag; chunks still under way get no receipt, so they will be sent again."""
        self._finish("the recorder was told to stop")


def _class_of(topic: Topic) -> type:
    package, _, name = topic.type.split("/")
    kind: type = getattr(import_module(f"{package}.msg"), name)
    return kind


def main() -> int:
    """Entry point of ``ros2 run bow recorder``."""
    return run_node(RecorderNode, description=HELP)


if __name__ == "__main__":
    raise SystemExit(main())
