"""The classifier node: judges every chunk of the streams, publishes the verdicts.

What it knows and decides is in :class:`bow_classifier.stream.Classifier`; here are topics and health.
"""

from __future__ import annotations

import sys
from functools import partial
from typing import Any

from bow_msgs.msg import BridgeForce, Health, StickSlip, Verdicts

from bow_classifier.measured.listening import PAUSE_S
from bow_classifier.measured.tuning import BETA, WITHIN, Given, RecordingError
from bow_classifier.precompile import precompile
from bow_classifier.stream import Classifier
from bow_sim.graph.node_base import LOG_AGAIN_S, STREAM, BowNode, StartupError
from bow_sim.graph.node_process import run_node
from bow_sim.graph.outbox import Outbox
from bow_sim.protocol import cdr
from bow_sim.protocol.messages import STREAMS
from bow_sim.protocol.neighbours import Neighbour

HELP = """
usage: ros2 run bow classifier [--ros-args -r __ns:=/bow/RUN]
       ros2 run bow classifier --ros-args -p source:=/bridge_force -p sample_rate:=48000.0 -p f0:=196.0 -p beta:=0.09

Judges every cell of a sweep after every five periods: is the bridge force periodic, are there five significant slips,
five travelling corners? All three together are Helmholtz motion (Schumacher & Woodhouse 1995, section III.B).

One classifier serves one namespace (default /bow). It needs no parameters: the sweep and the thresholds of the tests
come with the plan, which the coordinator latches. Set them where the sweep is described, for example
    bow sweep fig11d --set classifier.correlation=0.93
and judge a recorded sweep again with others by `bow replay`.

listens to   plan, bridge_force, stick_slip      every sample, nothing left out; with record=verdicts the simulators
                                                 judge what they compute, and this node has nothing to do
publishes    verdicts                            per chunk and cell: correlation, period, slips, corners, regime
             health                              once a second: READY when a sweep is open and is heard

A real string is judged with the same tests, as it plays: `source` is a topic with the force at its bridge, blocks of
samples as std_msgs/msg/Float32MultiArray or Float64MultiArray. Unit, sign and offset do not matter. It takes the place
of coordinator and simulator: no sweep in its namespace then. Each stretch of sound, from when it is periodic near f0
until the string is silent for 2 s or samples are lost, is a run: a recorder records it, a dashboard shows it, the log
says what the string does. docs/desk.md has an example.

    sample_rate, f0    Hz; f0 within 3 %, or within `f0_within` (0: taken as it is)
    beta               distance of the bow from the bridge over the length of the string, 0.1 unless given
    level              r.m.s. of silence, in the unit of the signal; if given, what is louder is judged also where it is
                       not periodic: a string that is raucous from the start
    pause              seconds without samples that end a run, 1 unless given

It keeps the state of the blocks under way. If it is started again, the coordinator sees a new incarnation in its health
and has the unfinished blocks sent again. Ctrl-C stops it.
"""

CHECK_S = 0.05
"""Between two checks of the readers' heartbeats."""

TOPICS = {message: topic for topic, message in STREAMS.items()}

READERS = (("verdicts", "recorder"), ("verdicts", "coordinator"))
"""Pairs of topic and the role that has to receive it."""


class ClassifierNode(BowNode):
    """The one classifier of a run."""

    def __init__(self) -> None:
        super().__init__("classifier")
        precompile()
        self._classifier = Classifier(self.incarnation)
        self._outbox = Outbox(self, self.create_publisher(Verdicts, "verdicts", STREAM))
        self.subscribe_plan(self._on_plan)
        for kind in (BridgeForce, StickSlip):
            name = kind.__name__
            self.create_subscription(kind, TOPICS[name], partial(self._on_stream, name), STREAM, raw=True)
        self.every(CHECK_S, self._check_readers)
        self._measure()
        self.set_state(Health.STARTING, "waiting for a plan")

    def _measure(self) -> None:
        """Start the node of a measured string, where the parameters name one."""
        source = self.read_parameter("source", "", "topic with the force at the bridge of a real string; empty = none")
        texts = {
            "sample_rate": (0.0, "of the source, Hz"),
            "f0": (0.0, "frequency of the string, Hz"),
            "beta": (BETA, "distance of the bow from the bridge over the length of the string"),
            "f0_within": (WITHIN, "part of f0 by which it may be wrong; 0 = none"),
            "level": (0.0, "r.m.s. below which the source is silent, in its unit"),
            "pause": (PAUSE_S, "seconds without samples that end a run"),
        }
        number = {name: self.read_number(name, default, what) for name, (default, what) in texts.items()}
        if not source:
            return
        try:
            given = Given(number["sample_rate"], number["f0"], number["beta"], number["f0_within"])
        except RecordingError as error:
            raise StartupError(f"parameter {error}") from None
        from bow_classifier.measured_node import MeasuredNode

        self.companions = (MeasuredNode(source, given, number["level"], number["pause"], self.get_namespace()),)

    def ignore(self, why: str) -> None:
        """Count a message that does not belong here, and log why."""
        self._classifier.complain(f"ignored: {why}")
        self._report()

    def run_note(self) -> str:
        """Return how much this classifier has judged."""
        return f"{self.health.messages} messages taken since the start"

    def _on_plan(self, _: dict[str, Any], data: bytes) -> None:
        classifier = self._classifier
        classifier.plan(data)
        if classifier.problem:
            self.get_logger().error(f"cannot judge this sweep: {classifier.problem}")
            self.set_state(Health.FAILED, classifier.problem)
        elif classifier.task is None:
            self.set_state(Health.STARTING, "waiting for a plan", run="")
        elif self.health.run_id != classifier.task.outline.run_id:
            self.set_state(Health.STARTING, "a sweep opens", run=classifier.task.outline.run_id)
            self._check_readers()
        self._report()

    def on_health(self, message: Health, neighbour: Neighbour | None) -> None:
        """Become ready at once when the last of the readers reports that it receives the verdicts."""
        if message.role != self.health.role and self.health.state == Health.STARTING:
            self._check_readers()

    def _check_readers(self) -> None:
        """Be ready as long as the readers of this run report that they receive the verdicts."""
        task = self._classifier.task
        if task is None:
            return
        starting = self.health.state == Health.STARTING
        if self.is_heard(READERS, task.outline.run_id) and starting:
            self.set_state(Health.READY)
        self._outbox.send_hello(lambda: cdr.hello("Verdicts", self.incarnation))

    def _on_stream(self, name: str, data: bytes) -> None:
        sender = cdr.hello_from(name, data)
        if sender:
            self.heard(TOPICS[name], sender)
            return
        task = self._classifier.task
        if task is not None and task.outline.judged_at_source:
            return  # it is there for somebody else
        self._outbox.send(self._classifier.take(name, data))
        for kind, sender in self._classifier.senders:
            self.heard(TOPICS[kind], sender)
        self._classifier.senders.clear()
        self._report()

    def _report(self) -> None:
        """Copy the counts into the next heartbeat, and log the complaints."""
        counts, health = self._classifier.counts, self.health
        health.messages, health.bytes = counts.messages, counts.bytes
        health.duplicates, health.ignored = counts.duplicates, counts.ignored
        while self._classifier.complaints:
            self.get_logger().warning(self._classifier.complaints.popleft(), throttle_duration_sec=LOG_AGAIN_S)


def main() -> int:
    """Entry point of ``ros2 run bow classifier``."""
    return run_node(ClassifierNode, description=HELP)


if __name__ == "__main__":
    sys.exit(main())
