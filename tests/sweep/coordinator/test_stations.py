"""A coordinator with two stations: each has consumers of its own; the work of one that is lost goes to the other."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
import recording
from coordinator_world import Node, receipt, verdicts

from bow_sim.protocol import cdr
from bow_sim.protocol.neighbours import CONSUMERS, Neighbours
from bow_sim.protocol.states import NodeState, ReceiptKind
from bow_sweep.coordinator.session import TICK_S, CoordinatorSession
from bow_sweep.coordinator.session_events import (
    HealthReceived,
    Instruction,
    ListenTo,
    Publish,
    ReceiptReceived,
    RunGiven,
    TimePassed,
    VerdictsReceived,
)
from bow_sweep.run.directory import Run
from bow_sweep.run.ledger import State

OWN = "c" * 16
SWEEP = recording.small_sweep("periods=10")


class TwoStations:
    """A session that knows the stations lab and attic; it is told of their nodes by their heartbeats."""

    def __init__(self, directory: Path) -> None:
        self.now = 100.0
        self.neighbours = Neighbours(OWN, "here")
        given = RunGiven(Run.create(directory, recording.RUN, SWEEP))
        self.session = CoordinatorSession(OWN, "here", "/bow", self.neighbours, lambda *_: given, lambda: self.now)
        self.run = given.run
        self.out: list[Instruction] = []
        self.do(given)
        self.nodes = {
            f"{station}/{role}": Node(role, f"/bow/{station}/{role}", f"{role[0]}{station:0<15}", 7)
            for station in ("lab", "attic")
            for role in (*CONSUMERS, "simulator")
        }

    def do(self, event: Any) -> None:
        self.out += self.session.handle(event, self.now)

    def beat(self, *names: str, state: int = NodeState.READY) -> None:
        for name in names:
            node = self.nodes[name]
            node.run_id, node.state = recording.RUN, state
            message = node.health(OWN)
            self.do(HealthReceived(message, self.neighbours.take(message, self.now)))

    def dies(self, name: str) -> None:
        """Its supervisor reports it."""
        message = self.nodes[name].health(OWN, state=NodeState.DEAD, detail="killed", run_id="", pid=7)
        self.nodes[name].pid += 1
        self.do(HealthReceived(message, None))
        self.neighbours.forget(self.nodes[name].incarnation)

    def tick(self, seconds: float = TICK_S) -> None:
        self.now += seconds
        self.do(TimePassed())

    def sent(self) -> list[dict[str, Any]]:
        """Return the addressed blocks since the last call."""
        out, self.out = self.out, []
        blocks = [cdr.decode("Block", one.data) for one in out if isinstance(one, Publish) and one.topic == "blocks"]
        return [block for block in blocks if block["simulator"]]

    def of(self, station: str) -> str:
        return self.nodes[f"{station}/simulator"].incarnation


@pytest.fixture
def world(tmp_path: Path) -> Iterator[TwoStations]:
    made = TwoStations(tmp_path / "run")
    yield made
    made.session.close()


LAB, ATTIC = (tuple(f"{name}/{role}" for role in (*CONSUMERS, "simulator")) for name in ("lab", "attic"))


def test_simulators_join_as_soon_as_the_consumers_of_their_own_station_are_ready(world: TwoStations) -> None:
    world.beat("lab/recorder", "attic/classifier", "lab/simulator", "attic/simulator")
    assert [one.station for one in world.out if isinstance(one, ListenTo)] == ["lab", "attic"]
    world.tick()
    assert world.sent() == [], "one recorder and one classifier, but of different stations"
    world.beat("lab/classifier")
    world.tick()
    assert {block["simulator"] for block in world.sent()} == {world.of("lab")}
    assert not world.out
    world.beat("attic/recorder")
    world.tick()
    assert world.run.ledger.in_flight == {"/bow/lab/simulator": [0, 1], "/bow/attic/simulator": [2]}


def test_a_block_is_done_by_the_answers_of_its_station(world: TwoStations) -> None:
    world.beat(*LAB)
    (block, *_) = [one["block"] for one in world.sent()]
    for station in ("attic", "", "lab"):
        assert world.run.ledger.blocks[block].state is State.DISPATCHED
        for chunk in range(SWEEP.chunks):
            data = verdicts(world.run, block, chunk)
            judged = cdr.unseal("Verdicts", data)
            both = [(ReceiptKind.STREAMS, judged["chunk_checksum"]), (ReceiptKind.VERDICTS, judged["checksum"])]
            world.do(VerdictsReceived(data, station))
            world.do(ReceiptReceived(receipt(world.run, [(kind, block, chunk, sum_) for kind, sum_ in both]), station))
        world.do(ReceiptReceived(receipt(world.run, [(ReceiptKind.BLOCK, block, 0, 0)]), station))
    assert world.run.ledger.blocks[block].state is State.DONE
    assert '"station": "lab"' in (world.run.directory / "ledger.jsonl").read_text()


def test_a_block_that_only_waits_for_the_disk_of_a_station_that_is_cut_off_is_due(
    world: TwoStations,
) -> None:
    world.beat(*LAB)
    first, *_ = taken = [(block["block"], block["attempt"]) for block in world.sent()]
    world.nodes["lab/simulator"].held = list(taken)
    world.beat(*LAB, state=NodeState.BUSY)
    for chunk in range(SWEEP.chunks):
        data = verdicts(world.run, first[0], chunk)
        judged = cdr.unseal("Verdicts", data)
        both = [(ReceiptKind.STREAMS, judged["chunk_checksum"]), (ReceiptKind.VERDICTS, judged["checksum"])]
        world.do(VerdictsReceived(data, "lab"))
        world.do(ReceiptReceived(receipt(world.run, [(kind, first[0], chunk, sum_) for kind, sum_ in both]), "lab"))
    world.nodes["lab/simulator"].held.remove(first)
    world.beat("lab/simulator", state=NodeState.BUSY)
    block = world.run.ledger.blocks[first[0]]
    assert block.state is State.DISPATCHED
    for _ in range(10):
        world.tick(1.0)
        world.beat(*ATTIC)
    assert block.state is State.DUE, "it goes to attic, whose simulator has two already"


def test_the_work_of_a_station_without_its_recorder_goes_to_the_other_and_what_it_holds_is_void(
    world: TwoStations,
) -> None:
    world.beat(*LAB)
    taken = [(block["block"], block["attempt"]) for block in world.sent()]
    world.nodes["lab/simulator"].held = list(taken)
    world.beat(*LAB, *ATTIC)
    world.sent()
    world.dies("lab/recorder")
    world.tick()
    moved = world.sent()
    assert {block["simulator"] for block in moved} == {world.of("attic")}
    assert {block["block"] for block in moved} <= {block for block, _ in taken}
    plan_epoch = world.run.ledger.announced
    assert {block["epoch"] for block in moved} == {plan_epoch}

    world.nodes["lab/recorder"].incarnation = "r" * 16
    world.beat(*LAB)
    assert world.run.ledger.announced == plan_epoch, "the blocks of the other station stay valid"
    assert len(world.run.ledger.in_flight["/bow/attic/simulator"]) == 2
    world.tick(1.1)
    told = [one for one in world.sent() if one["simulator"] == world.of("lab")]
    assert [(len(one["cells"]), one["attempt"], one["epoch"] > plan_epoch) for one in told] == [(0, 0, True)]
