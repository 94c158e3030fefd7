"""The simulator node carries out what its session decides."""

from __future__ import annotations

import threading
import time
from collections.abc import Iterator
from typing import Any

import pytest
import rclpy
import recording
from bow_msgs.msg import Health, Receipt, StickSlip

from bow_sim.block_request import Judge
from bow_sim.graph.node_base import STREAM, RCLError
from bow_sim.node import MATCHED_S, TOPICS, SimulatorNode
from bow_sim.protocol import cdr
from bow_sim.protocol.messages import STREAMS
from bow_sim.protocol.neighbours import CONSUMERS
from bow_sim.simulator_events import (
    Event,
    Ignore,
    PlanReceived,
    ReceiptReceived,
    RecreatePublishers,
    Report,
    SetState,
)
from tests.support.example_maps import RUN, plan


@pytest.fixture
def simulator(ros_domain: int) -> Iterator[SimulatorNode]:
    rclpy.init()
    node = SimulatorNode()
    yield node
    node.close()
    node.destroy_node()
    rclpy.shutdown()


def test_publishers_that_fail_are_created_again(simulator: SimulatorNode) -> None:
    class Broken:
        def publish(self, _: bytes) -> None:
            raise RCLError("cannot publish data")

        def get_subscription_count(self) -> int:
            return 0

    hello = {topic: cdr.hello(name, simulator.incarnation) for topic, name in STREAMS.items()}
    originals = simulator._publisher_of
    simulator._publisher_of = dict.fromkeys(STREAMS, Broken())  # type: ignore[arg-type]
    assert not simulator._publish(hello)
    simulator._publisher_of = originals.copy()
    simulator._to_node.put(RecreatePublishers())
    simulator._carry_out()
    assert {topic: publisher.topic_name for topic, publisher in simulator._publisher_of.items()} == {
        topic: f"/bow/{topic}" for topic in STREAMS
    }
    assert not set(originals.values()) & set(simulator._publisher_of.values())
    assert simulator._publish(hello)


def test_what_records_no_streams_is_judged_here_and_only_by_who_can(simulator: SimulatorNode) -> None:
    sweep = recording.small_sweep("record=verdicts")
    opening = cdr.decode("Plan", recording.plan(sweep))
    lanes, cells = sweep.lanes(sweep.block(0)), sweep.block(0)
    message = {"spec.settings": sweep.settings(), "cells": cells, "x": lanes[sweep.x.name], "y": lanes[sweep.y.name]}
    simulator._on_plan(PlanReceived(opening))
    assert simulator._publisher_of["verdicts"].topic_name == "/bow/verdicts"
    with pytest.raises(ValueError, match="cannot judge"):
        simulator._prepare(message)
    asked: list[tuple[Any, ...]] = []

    def judge_of(*of: Any) -> Judge:
        asked.append(of)
        return lambda *_: b"verdicts"

    simulator._judge_of = judge_of
    assert simulator._prepare(message).judge is not None
    assert asked == [(opening, cells)]
    others = {**message, "spec.settings": recording.small_sweep().settings()}
    assert simulator._prepare(others).judge is None


def test_streams_are_wanted_as_soon_as_others_than_recorder_and_classifier_listen(simulator: SimulatorNode) -> None:
    for _ in CONSUMERS:
        simulator.create_subscription(StickSlip, "stick_slip", lambda _: None, STREAM)
    assert not simulator._others_listen()
    simulator.create_subscription(StickSlip, "stick_slip", lambda _: None, STREAM)
    deadline = time.monotonic() + 20
    while not simulator._others_listen():
        assert time.monotonic() < deadline
        time.sleep(0.01)


def test_the_heartbeat_names_blocks_held_and_refused(simulator: SimulatorNode) -> None:
    simulator._to_node.put(SetState(Health.READY, "", "r1"))
    simulator._to_node.put(Ignore("a block of nobody"))
    simulator._to_node.put(Report(Health.BUSY, "", held=((3, 1), (4, 2)), refused=((5, 1),)))
    simulator._carry_out()
    health = simulator.health
    assert (health.state, health.run_id, health.ignored) == (Health.BUSY, "r1", 1)
    assert (list(health.held_blocks), list(health.held_attempts)) == ([3, 4], [1, 2])
    assert (list(health.refused_blocks), list(health.refused_attempts)) == ([5], [1])


def test_blocks_taken_are_published_before_they_end_and_what_ends_at_once(
    simulator: SimulatorNode, monkeypatch: pytest.MonkeyPatch
) -> None:
    told: list[tuple[list[int], list[int]]] = []

    def publish(_: object, message: Health) -> None:
        told.append((list(message.held_blocks), list(message.refused_blocks)))

    monkeypatch.setattr("rclpy.publisher.Publisher.publish", publish)

    def report(held: str, refused: str = "", state: int = Health.BUSY) -> list[tuple[list[int], list[int]]]:
        told.clear()
        keys = (tuple((int(block), 1) for block in blocks) for blocks in (held, refused))
        simulator._to_node.put(Report(state, "", *keys))
        simulator._carry_out()
        return told

    assert report("", state=Health.READY) == [([], [])]
    assert report("1") == [([1], [])], "the state changes"
    assert report("12") == []
    assert report("2") == [([2], [])]
    assert report("23") == []
    assert report("2") == [([2, 3], []), ([2], [])], "nobody had heard that 3 was taken"
    assert report("24") == []
    simulator.publish_health()
    assert report("2") == [([2], [])]
    assert report("2", "5") == [([2], [5])]


def test_the_worker_takes_receipts_and_says_which_bytes_are_none(
    simulator: SimulatorNode, monkeypatch: pytest.MonkeyPatch
) -> None:
    taken: list[tuple[str, object]] = []

    def handle(event: Event) -> None:
        if isinstance(event, ReceiptReceived):
            taken.append((threading.current_thread().name, event.receipt["incarnation"]))

    monkeypatch.setattr(simulator, "_handle", handle)
    assert simulator._receipts.subscription not in list(simulator.subscriptions)
    receipts = simulator.create_publisher(Receipt, "receipts", STREAM)
    values = {"run_id": RUN, "sweep_id": RUN, "kind": [1], "block": [2], "chunk": [3], "attempt": [1], "checksum": [4]}
    deadline = time.monotonic() + 20
    while not receipts.get_subscription_count() and time.monotonic() < deadline:
        time.sleep(0.01)
    sent = [cdr.encode("Receipt", {**values, "incarnation": each * 16}) for each in "ab"]
    for data in (sent[0], sent[0][:-20], sent[1]):
        receipts.publish(data)
    while len(taken) < 2 and time.monotonic() < deadline:
        time.sleep(0.01)
    assert taken == [("kernel", "a" * 16), ("kernel", "b" * 16)]
    simulator._carry_out()
    assert simulator.health.ignored == 1
    assert {words.split()[0] for words in simulator.neighbours.hears(simulator.awake.now())} == {"a" * 16, "b" * 16}


def test_it_takes_no_work_before_the_coordinator_says_that_it_hears_it(simulator: SimulatorNode) -> None:
    """Blocks of a coordinator that is not known are ignored, and are sent again only after 3 s."""

    def heartbeat(role: str, incarnation: str, hears: str) -> None:
        message = Health(role=role, node=f"/bow/{role}", incarnation=incarnation, state=Health.READY, run_id=RUN)
        message.pid, message.number, message.hears = 1, 1, [f"{simulator.incarnation} {hears}"]
        simulator._take_health(message)

    opening = plan()
    assert not simulator.authority.objection(opening)
    simulator._on_plan(PlanReceived(opening))
    for role in ("recorder", "classifier"):
        heartbeat(role, role[:4] * 4, "bridge_force health stick_slip")
    assert simulator.health.state == Health.STARTING
    assert "coordinator" in simulator.health.detail
    heartbeat("coordinator", opening["incarnation"], "health")
    assert simulator.health.state == Health.READY


def test_it_publishes_nothing_before_both_consumers_are_matched_or_have_had_the_time(
    simulator: SimulatorNode, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("bow_sim.node.MATCHED_S", 600.0)
    assert not simulator._is_matched()
    for consumer in (1, 2):
        for topic in STREAMS:
            simulator.create_subscription(TOPICS[topic][0], topic, lambda _: None, STREAM)
        deadline = time.monotonic() + 20
        while (
            min(p.get_subscription_count() for p in simulator._publisher_of.values()) < consumer
            and time.monotonic() < deadline
        ):
            time.sleep(0.01)
        assert simulator._is_matched() == (consumer == 2)
    monkeypatch.setattr("bow_sim.node.CONSUMERS", ("a", "b", "c"))
    assert not simulator._is_matched()
    monkeypatch.setattr("bow_sim.node.MATCHED_S", MATCHED_S)
    simulator._made -= MATCHED_S
    assert simulator._is_matched()
