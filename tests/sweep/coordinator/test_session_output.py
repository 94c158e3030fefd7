"""What the coordinator's session writes and publishes, and how often, where much arrives."""

from __future__ import annotations

import json
import os
import shutil
from itertools import product

import numpy as np
import pytest
import recording
from coordinator_world import Node, World, receipt, verdicts

from bow_sim.protocol import cdr
from bow_sim.protocol.neighbours import CONSUMERS, FIRST_HELLO_S
from bow_sim.protocol.states import NodeState, ReceiptKind
from bow_sweep.coordinator import active_run
from bow_sweep.coordinator.session import TICK_S
from bow_sweep.coordinator.session_events import (
    HealthReceived,
    Publish,
    PublishMap,
    ReceiptReceived,
    RunGiven,
    TimePassed,
    VerdictsReceived,
)
from bow_sweep.run.directory import LEDGER

PLAIN = recording.small_sweep("periods=10")


def test_what_arrives_together_is_one_write_of_the_ledger(monkeypatch: pytest.MonkeyPatch) -> None:
    """Two blocks are done, and their simulator gets the third: three entries, on the disk before anything is sent."""
    world, syncs = World(), []
    run = world.create(PLAIN, b"").run
    world.do(RunGiven(run))
    for number, (role, name) in enumerate([*((role, f"/bow/{role}") for role in CONSUMERS), ("simulator", "/bow/s")]):
        world.nodes[name] = node = Node(role, name, f"{number:016}", number, NodeState.READY, run.run_id)
        world.beat(node)
    while (done := len(world.sent)) < 2:
        world.do(TimePassed())
    simulator, events = world.nodes["/bow/s"], []
    for block in range(done):
        for chunk in range(run.sweep.chunks):
            data = verdicts(run, block, chunk)
            checksum = cdr.decode("Verdicts", data)["checksum"]
            entries = [(ReceiptKind.STREAMS, block, chunk, 7), (ReceiptKind.VERDICTS, block, chunk, checksum)]
            events += [VerdictsReceived(data), ReceiptReceived(receipt(run, entries))]
        events.append(ReceiptReceived(receipt(run, [(ReceiptKind.BLOCK, block, 0, 0)])))
    simulator.held = sorted(world.sent)
    world.beat(simulator)
    simulator.held = []
    message = simulator.health(world.own)
    neighbour = world.neighbours.take(message, world.now)
    genuine = os.fsync
    monkeypatch.setattr(os, "fsync", lambda file: syncs.append(file) or genuine(file))
    out = world.session.handle_all([*events, HealthReceived(message, neighbour)], world.now)
    assert len(syncs) == 1
    entries_there = [json.loads(line) for line in (run.directory / LEDGER).read_text().splitlines()]
    assert [(entry["event"], entry["block"]) for entry in entries_there[-3:]] == [
        ("done", 0),
        ("done", 1),
        ("dispatched", 2),
    ]
    assert sum(isinstance(one, Publish) and one.topic == "blocks" for one in out) == 1
    world.session.close()
    shutil.rmtree(world.directory)


def test_a_growing_map_goes_out_at_every_second_tick() -> None:
    world = World()
    run = world.create(PLAIN, b"").run
    world.session.handle(RunGiven(run), 0.0)
    judged, times = product(range(run.blocks.count), range(run.sweep.chunks)), []
    for tick, (block, chunk) in enumerate(judged, 1):
        now = TICK_S * tick + 0.01 * (tick % 2)  # timers are late
        world.session.handle(VerdictsReceived(verdicts(run, block, chunk)), now)
        times += [tick for event in world.session.handle(TimePassed(), now) if isinstance(event, PublishMap)]
    assert len(times) > 1
    assert times == list(range(2, tick + 1, 2))
    world.session.close()
    shutil.rmtree(world.directory)


def test_maps_of_many_cells_go_out_less_often(monkeypatch: pytest.MonkeyPatch) -> None:
    world = World()
    monkeypatch.setattr(active_run, "MAP_CELLS_PER_S", PLAIN.cells / 3)  # one in three seconds
    run = world.create(PLAIN, b"").run
    world.session.handle(RunGiven(run), 0.0)

    def maps(block: int, now: float) -> list[int]:
        world.session.handle(VerdictsReceived(verdicts(run, block, 0)), now)
        out = world.session.handle(TimePassed(), now)
        return [int(np.count_nonzero(event.values["tests"])) for event in out if isinstance(event, PublishMap)]

    sizes = [run.blocks.size(block) for block in range(3)]
    assert maps(0, 1.0) == [sizes[0]]
    assert maps(1, 3.5) == []
    assert maps(2, 4.0) == [sum(sizes)], "the one that was left out is in the next"
    world.session.close()
    shutil.rmtree(world.directory)


def test_a_simulator_that_does_not_hear_blocks_gets_a_hello_at_once_but_not_with_every_heartbeat() -> None:
    world = World()
    run = world.create(PLAIN, b"").run
    world.do(RunGiven(run))
    node = Node("simulator", "/bow/s", "0" * 16, 0, NodeState.STARTING, run.run_id)

    def hellos(hears: str) -> int:
        message = node.health(world.own, hears=[f"{world.own} {hears}"])
        neighbour = world.neighbours.take(message, world.now)
        out = world.session.handle(HealthReceived(message, neighbour), world.now)
        return sum(isinstance(one, Publish) and one.topic == "blocks" for one in out)

    assert [hellos("health"), hellos("health")] == [1, 0]
    world.now += 1.01 * FIRST_HELLO_S
    assert [hellos("health"), hellos("health")] == [1, 0]
    world.now += 1.01 * FIRST_HELLO_S
    assert hellos("blocks health") == 0
    world.session.close()
    shutil.rmtree(world.directory)
