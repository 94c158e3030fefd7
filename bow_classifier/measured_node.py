"""The node of a measured string: samples from a topic in; plans and stream messages out, in place of a simulator's.

What it knows and decides is in :class:`bow_classifier.measured.session.Session`; here are topics and health. It runs in
the process of the classifier node.
"""

from __future__ import annotations

import math
import time
from collections import Counter
from importlib import import_module
from typing import Any

import numpy as np
from bow_msgs.msg import BridgeForce, Health, Plan, Receipt, StickSlip, Verdicts
from rclpy.event_handler import SubscriptionEventCallbacks
from rclpy.qos import HistoryPolicy, QoSProfile
from rclpy.subscription import Subscription

from bow_classifier.measured.samples import TYPES, SamplesError, samples_of
from bow_classifier.measured.session import Session
from bow_classifier.measured.tuning import Given
from bow_sim.graph.node_base import LATCHED, LOG_AGAIN_S, STREAM, STREAM_WRITER, BowNode, RCLError
from bow_sim.protocol import cdr
from bow_sim.protocol.neighbours import UNCONFIRMED_S
from bow_sim.simulator_session import FAILURES

TICK_S = 0.02
"""Between two looks at what can go on."""

FIND_S = 0.5
"""Between two looks for the source."""

DEPTH = 1000
"""Messages of the source that may wait."""

STOP_S = 5.0
"""How long a node that is told to stop waits until its run is closed."""

TOPICS = {
    "plan": (Plan, LATCHED),
    "bridge_force": (BridgeForce, STREAM_WRITER),
    "stick_slip": (StickSlip, STREAM_WRITER),
}
"""Topic -> type and quality of service, of what this node publishes."""

READERS = (("bridge_force", "classifier"), ("stick_slip", "classifier"))
RECORDED = (("bridge_force", "recorder"), ("stick_slip", "recorder"))
"""Pairs of topic and the role that has to receive it."""


class MeasuredNode(BowNode):
    """Has a measured string judged. It takes the place of the coordinator in its namespace.

    Parameters
    ----------
    source
        Name of the topic.
    given
        What is known of the string.
    level
        R.m.s. below which the signal is silence, in its own unit.
    pause
        Seconds without samples that end a run.
    namespace
        Of the graph.
    """

    says_ends = False

    def __init__(self, source: str, given: Given, level: float, pause: float, namespace: str) -> None:
        super().__init__("coordinator", "measured", namespace)
        self._source = self.resolve_topic_name(source)
        self._session = Session(self._source, given, self.incarnation, level, pause)
        self._subscription: Subscription | None = None
        self._looked_at = float("-inf")
        self._topics = {topic: self.create_publisher(kind, topic, qos) for topic, (kind, qos) in TOPICS.items()}
        self._failures: Counter[str] = Counter()  # of each topic in a row
        self._made_at: dict[str, float] = {}  # when its publisher was created again
        self.create_subscription(Verdicts, "verdicts", self._on_verdicts, STREAM, raw=True)
        self.create_subscription(Receipt, "receipts", self._on_receipt, STREAM, raw=True)
        self._said_hello = float("-inf")
        self.every(TICK_S, self._tick)
        self.set_state(Health.STARTING, f"waits for a publisher on {self._source}")

    # ---- the source

    def _look_for_source(self) -> None:
        """Subscribe as soon as somebody publishes, with the publisher's type and reliability."""
        now = self.awake.now()
        if self._subscription is not None or now - self._looked_at < FIND_S:
            return
        self._looked_at = now
        publishers = self.get_publishers_info_by_topic(self._source)
        if not publishers:
            return
        name = publishers[0].topic_type
        if name not in TYPES:
            self.set_state(
                Health.STARTING, f"{self._source} is of type {name}: should be one of {', '.join(sorted(TYPES))}"
            )
            return
        package, _, kind = name.split("/")
        qos = QoSProfile(
            history=HistoryPolicy.KEEP_LAST, depth=DEPTH, reliability=publishers[0].qos_profile.reliability
        )
        self._subscription = self.create_subscription(
            getattr(import_module(f"{package}.msg"), kind),
            self._source,
            self._on_samples,
            qos,
            event_callbacks=SubscriptionEventCallbacks(message_lost=self._on_lost, use_default_callbacks=False),
        )

    def _on_samples(self, message: Any) -> None:
        self.health.messages += 1
        try:
            samples = samples_of(message)
        except SamplesError as error:
            self.health.ignored += 1
            self.get_logger().warning(f"{self._source}: ignored: {error}", throttle_duration_sec=LOG_AGAIN_S)
            return
        self.health.bytes += samples.nbytes
        self._session.take(np.asarray(samples, np.float64), self.awake.now())
        self._carry_out()

    def _on_lost(self, info: Any) -> None:
        self._session.lose(f"{info.total_count_change} messages of {self._source} were lost")

    # ---- answers

    def _on_verdicts(self, data: bytes) -> None:
        try:
            values = cdr.unseal("Verdicts", data)
        except cdr.WireError as error:
            self.ignore(str(error))
            return
        self.heard("verdicts", values["incarnation"])
        if len(values["cells"]):
            self._session.verdicts(values, self.awake.now())

    def _on_receipt(self, data: bytes) -> None:
        values = self.decode("Receipt", data)
        if values is not None:
            self.heard("receipts", values["incarnation"])
            self._session.receipt(values, self.awake.now())

    # ---- time

    def _tick(self) -> None:
        self._look_for_source()
        self._go_on()

    def _go_on(self) -> None:
        now = self.awake.now()
        recorder = bool(self.neighbours.of_role("recorder", now))
        self._session.pass_time(now, recorder, self._missing, time.time_ns())
        self._carry_out()
        self._say_hello(now)
        state = Health.BUSY if self._session.run_id else Health.READY
        if self._subscription is not None:
            self.set_state(state, self._session.state, self._session.run_id)

    def _missing(self, run_id: str, recorder: bool) -> list[str]:
        if self.health.run_id != run_id:
            self.set_state(Health.STARTING, "a run opens", run_id)
        return self.missing_readers((*READERS, *(RECORDED if recorder else ())), run_id)

    def _say_hello(self, now: float) -> None:
        """Show that the streams work; the first chunks of a run wait until they are heard."""
        if now - self._said_hello < (0.1 if self.health.state == Health.STARTING else 1.0):
            return
        self._said_hello = now
        for topic, name in (("bridge_force", "BridgeForce"), ("stick_slip", "StickSlip")):
            self._publish(topic, cdr.hello(name, self.incarnation))

    def _carry_out(self) -> None:
        out, log = self._session.out, self.get_logger()
        while out:
            topic, what = out.popleft()
            if topic == "log":
                log.info(str(what))
            elif topic == "warning":
                log.warning(str(what))
            elif isinstance(what, bytes):
                self._publish(topic, what)

    def _publish(self, topic: str, data: bytes) -> None:
        try:
            self._topics[topic].publish(data)
            self._failures[topic] = 0
        except RCLError as error:  # a reader hangs; chunks without an answer are sent again
            self.get_logger().warning(f"{topic}: not published: {error}", throttle_duration_sec=LOG_AGAIN_S)
            self._failures[topic] += 1
            now = self.awake.now()
            if self._failures[topic] >= FAILURES and now - self._made_at.get(topic, -math.inf) > UNCONFIRMED_S:
                self._failures[topic], self._made_at[topic] = 0, now
                self.destroy_publisher(self._topics[topic])
                kind, qos = TOPICS[topic]
                self._topics[topic] = self.create_publisher(kind, topic, qos)
                self.get_logger().warning(f"{topic}: its publisher is created again")

    def close(self) -> None:
        """End the run in progress: what is judged is to be recorded."""
        self._session.stop()
        until = time.monotonic() + STOP_S
        while self._session.run_id and time.monotonic() < until and self.executor is not None:
            self.executor.spin_once(timeout_sec=TICK_S)
            self._go_on()
        self._session.give_up()
        self._carry_out()
