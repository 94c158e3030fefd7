"""The classifier node: judges every chunk of the streams, publishes the verdicts.

All that it knows is in :class:`bow_classifier.stream.Classifier`; here are topics, health and what to do when a
subscriber hangs.
"""

from __future__ import annotations

import sys
from collections import deque
from collections.abc import Iterable
from functools import partial

from bow_msgs.msg import BridgeForce, Health, Plan, StickSlip, Verdicts

from bow_classifier.precompile import precompile
from bow_classifier.stream import Classifier
from bow_sim.graph.node_base import HEARD, STREAM, BowNode, RCLError, live
from bow_sim.protocol import cdr
from bow_sim.protocol.authority import Authority
from bow_sim.protocol.neighbours import FIRST_HELLO_S, HELLO_S, Neighbour

HELP = """
usage: ros2 run bow classifier [--ros-args -r __ns:=/bow/RUN]

Judges every cell of a sweep after every five periods: is the bridge force periodic, are there five significant slips,
five travelling corners? All three together are Helmholtz motion (Schumacher & Woodhouse 1995, section III.B).

One classifier serves one namespace (default /bow). It needs no parameters: the sweep and the thresholds of the tests
come with the plan, which the coordinator latches. Set them where the sweep is described, for example
    bow sweep fig11d --set classifier.correlation=0.93
and judge a recorded sweep again with others by `bow replay`.

listens to   plan, bridge_force, stick_slip      every sample, nothing left out
publishes    verdicts                            per chunk and cell: correlation, period, slips, corners, regime
             health                              once a second: READY when a sweep is open and is heard

It keeps the state of the blocks under way. If it is started again, the coordinator sees a new incarnation in its health
and has the unfinished blocks sent again. Ctrl-C stops it.
"""

LOOK_S = 0.05
"""Between two looks at who listens."""

TOPICS = {"BridgeForce": "bridge_force", "StickSlip": "stick_slip"}

READERS = (("verdicts", "recorder"), ("verdicts", "coordinator"))
"""Who has to hear what."""

RETRY_S = 0.25
"""Between two tries to publish while a subscriber hangs: publish() itself waits 0.1 s, and the node must breathe."""

SAY_AGAIN_S = 5.0
"""Between two lines in the log on the same trouble."""


class ClassifierNode(BowNode):
    """The one classifier of a run."""

    def __init__(self) -> None:
        super().__init__("classifier")
        precompile()
        self._classifier = Classifier(self.incarnation)
        self._outbox: deque[bytes] = deque()
        self._hanging = False
        self._authority = Authority(self.works_for)
        self._last_sent = 0.0
        self._verdicts = self.create_publisher(Verdicts, "verdicts", STREAM)
        self.create_subscription(Plan, "plan", self._on_plan, HEARD, raw=True)
        for kind in (BridgeForce, StickSlip):
            name = kind.__name__
            self.create_subscription(kind, TOPICS[name], partial(self._on_stream, name), STREAM, raw=True)
        self.every(LOOK_S, self._look)
        self.every(RETRY_S, self._publish)
        self.become(Health.STARTING, "waiting for a plan")

    def _on_plan(self, data: bytes) -> None:
        classifier = self._classifier
        try:
            why = self._authority.objection(cdr.decode("Plan", data))
        except cdr.WireError as error:
            why = str(error)
        if why:
            classifier.complain(f"plan ignored: {why}")
            self._note()
            return
        classifier.plan(data)
        if classifier.problem:
            self.get_logger().error(f"cannot judge this sweep: {classifier.problem}")
            self.become(Health.FAILED, classifier.problem)
        elif classifier.task is None:
            self.become(Health.STARTING, "waiting for a plan", run="")
        elif self.health.run_id != classifier.task.outline.run_id:
            self.become(Health.STARTING, "a sweep opens", run=classifier.task.outline.run_id)
            self._look()
        self._note()

    def on_health(self, message: Health, neighbour: Neighbour | None) -> None:
        """Become ready at once when the last of the readers says that it hears us."""
        if message.role != self.health.role and self.health.state == Health.STARTING:
            self._look()

    def _look(self) -> None:
        """Be ready as long as the readers of this run say that they hear our verdicts."""
        task = self._classifier.task
        if task is None:
            return
        starting, now = self.health.state == Health.STARTING, self.awake.now()
        if now - self._last_sent >= (FIRST_HELLO_S if starting else HELLO_S) and not self._outbox:
            self._send([cdr.hello("Verdicts", self.incarnation)])
        if self.is_heard(READERS, task.outline.run_id) and starting:
            self.become(Health.READY)

    def _on_stream(self, name: str, data: bytes) -> None:
        sender = cdr.hello_from(name, data)
        if sender:
            self.heard(TOPICS[name], sender)
            return
        self._send(self._classifier.take(name, data))
        for kind, sender in self._classifier.senders:
            self.heard(TOPICS[kind], sender)
        self._classifier.senders.clear()
        self._note()

    def _note(self) -> None:
        counts, health = self._classifier.counts, self.health
        health.messages, health.bytes = counts.messages, counts.bytes
        health.duplicates, health.ignored = counts.duplicates, counts.ignored
        while self._classifier.complaints:
            self.get_logger().warning(self._classifier.complaints.popleft(), throttle_duration_sec=SAY_AGAIN_S)

    def _send(self, messages: Iterable[bytes]) -> None:
        self._outbox.extend(messages)
        if not self._hanging:
            self._publish()

    def _publish(self) -> None:
        """Publish what is due, in order; keep what cannot go out now. Credit bounds how much that can be."""
        while self._outbox:
            try:
                self._verdicts.publish(self._outbox[0])
            except RCLError as error:
                self._hanging = True
                listeners = self.get_subscriptions_info_by_topic(self._verdicts.topic_name)
                names = ", ".join(sorted({listener.node_name for listener in listeners}))
                self.get_logger().warning(
                    f"{self._verdicts.topic_name}: {len(self._outbox)} messages wait, one of the subscribers hangs "
                    f"({names}): {error}",
                    throttle_duration_sec=SAY_AGAIN_S,
                )
                return
            self._outbox.popleft()
            self._last_sent = self.awake.now()
        self._hanging = False


def main() -> int:
    """Entry point of ``ros2 run bow classifier``."""
    return live(ClassifierNode, description=HELP)


if __name__ == "__main__":
    sys.exit(main())
