"""Heartbeats of simulators become events of the ledger, whichever messages are lost, late or from strangers."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import pytest
from hypothesis import settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, initialize, invariant, rule

from bow_sim.protocol.neighbours import LEFT, SILENT_S
from bow_sim.protocol.states import NodeState
from bow_sweep.coordinator.simulator_pool import FIRST_PAUSE_S, TAKEN_S, Pool
from bow_sweep.run.ledger import (
    Dispatch,
    Event,
    Finished,
    Judged,
    Ledger,
    OnDisk,
    Receipted,
    SimulatorLost,
    SimulatorReady,
    SimulatorReturned,
    State,
    Tick,
)

RUN, NAME = "r" * 16, "/bow/simulator_1"


def health(
    state: int = NodeState.READY, held: list[tuple[int, int]] | None = None, refused: list | None = None, **changes: Any
) -> Any:
    values = {
        "node": NAME,
        "incarnation": "1" * 16,
        "host": "there",
        "pid": 7,
        "run_id": RUN,
        "detail": "",
        "state": state,
    }
    for name, keys in (("held", held or []), ("refused", refused or [])):
        values |= {f"{name}_blocks": [key[0] for key in keys], f"{name}_attempts": [key[1] for key in keys]}
    return SimpleNamespace(**{**values, **changes})


class World:
    """A pool, its events and its warnings."""

    def __init__(self) -> None:
        self.events: list[Event] = []
        self.warnings: list[str] = []
        self.pool = Pool(self.events.append, "here", self.warnings.append)

    def hear(self, now: float, hears_us: bool = True, **changes: Any) -> None:
        self.pool.on_health(health(**changes), RUN, hears_us, now)

    def take(self) -> list[Event]:
        events, self.events[:] = list(self.events), []
        return events


@pytest.fixture
def world() -> World:
    """A pool with one simulator that is ready."""
    made = World()
    made.hear(0.0)
    made.pool.check(0.0, may_join=True)
    assert made.take() == [SimulatorReady(NAME)]
    return made


def test_the_simulator_that_was_heard_joins_and_no_other_is_looked_at() -> None:
    world, other = World(), "/bow/simulator_2"
    for name in (NAME, other):
        world.hear(0.0, node=name, incarnation=name[-1] * 16)
    world.pool.check(0.0, may_join=True, only=other)
    assert [event.simulator for event in world.take()] == [other]
    world.hear(SILENT_S + 1, node=other, incarnation="2" * 16)
    world.pool.check(SILENT_S + 1, may_join=True, only=other)
    world.pool.check(SILENT_S + 1, may_join=True, only="/bow/nobody")
    assert world.take() == []
    world.pool.check(SILENT_S + 1, may_join=True)
    world.hear(SILENT_S + 2)
    world.pool.check(SILENT_S + 2, may_join=True)
    assert [event.simulator for event in world.take()] == [NAME], "the silent one was forgotten, and came back"


def test_a_simulator_joins_when_it_is_ready_and_reports_that_blocks_arrive() -> None:
    world = World()
    for changes in ({"hears_us": False}, {"state": NodeState.STARTING}, {"run_id": "x"}, {"held": [(1, 1)]}):
        world.hear(0.0, **changes)  # type: ignore[arg-type]
        world.pool.check(0.0, may_join=True)
        assert world.take() == []
    world.hear(0.0)
    world.pool.check(0.0, may_join=False)
    assert world.take() == []
    world.pool.check(0.0, may_join=True)
    assert world.take() == [SimulatorReady(NAME)]


def test_a_block_that_is_not_held_any_more_has_ended(world: World) -> None:
    assert world.pool.send(NAME, 4, 1, 0.0) == "1" * 16
    world.hear(0.1)
    assert world.take() == []
    world.hear(0.2, state=NodeState.BUSY, held=[(4, 1)])
    assert world.take() == []
    world.hear(0.3)
    assert world.take() == [Finished(NAME, 4, 1)]


def test_a_block_that_is_not_taken_in_time_is_due_again_and_a_refused_one_at_once(world: World) -> None:
    world.pool.send(NAME, 4, 1, 0.0)
    world.hear(TAKEN_S)
    assert world.take() == []
    world.hear(TAKEN_S + 0.1)
    assert [type(event) for event in world.take()] == [SimulatorLost]
    world.pool.check(TAKEN_S + 0.2, may_join=True)
    assert world.take() == []  # a pause
    later = TAKEN_S + FIRST_PAUSE_S + 0.1
    world.hear(later)
    world.pool.check(later, may_join=True)
    assert world.take() == [SimulatorReady(NAME)]
    world.pool.send(NAME, 5, 1, later)
    world.hear(later, refused=[(5, 1)])
    assert [type(event) for event in world.take()] == [SimulatorLost]


def test_a_simulator_is_lost_only_when_its_own_supervisor_reports_it_or_it_is_silent_for_long(world: World) -> None:
    world.hear(1.0, state=NodeState.DEAD, incarnation="", pid=8)
    world.hear(1.0, state=NodeState.CLOSED, detail=LEFT, incarnation="2" * 16)
    assert world.take() == []
    world.hear(1.0, state=NodeState.DEAD, incarnation="", detail="killed")
    assert world.take() == [SimulatorLost(NAME, "killed", blame=True)]
    world.hear(2.0)
    world.pool.check(2.0, may_join=True)
    world.take()
    world.pool.check(2.0 + SILENT_S, may_join=True)
    assert world.take() == []
    world.pool.check(2.1 + SILENT_S, may_join=True)
    (lost,) = world.take()
    assert isinstance(lost, SimulatorLost)
    assert lost.blame  # of another machine: no supervisor here reports it


def test_a_simulator_of_this_machine_that_is_stopped_is_not_blamed() -> None:
    import os

    world = World()
    world.hear(0.0, host="here", pid=os.getpid())
    world.pool.check(0.0, may_join=True)
    world.pool.check(SILENT_S + 0.1, may_join=True)
    lost = world.take()[-1]
    assert isinstance(lost, SimulatorLost)
    assert not lost.blame


@pytest.mark.parametrize(
    ("changes", "returns"),
    [
        ({}, True),
        ({"state": NodeState.CLOSED, "detail": LEFT}, True),
        ({"incarnation": "2" * 16}, False),
        ({"state": NodeState.DEAD, "incarnation": ""}, False),
    ],
    ids=["heard", "leaves", "restarted", "dead"],
)
def test_a_silence_is_taken_back_when_the_same_process_is_heard_again(
    world: World, changes: dict[str, Any], returns: bool
) -> None:
    for now in (10.0, 50.0):
        world.hear(now)
        world.pool.check(now, may_join=True)
        world.take()
        world.pool.check(now + SILENT_S + 1, may_join=True)
        assert [type(event) for event in world.take()] == [SimulatorLost]
        world.hear(now + 20, **changes)
        assert world.take() == [SimulatorReturned(NAME)] * returns
        world.hear(now + 21)
        world.hear(now + 22, node=f"/bow/other_{now:g}", incarnation="")
        assert world.take() == [], "once, and at once"
        if not returns:
            return


def test_a_silence_of_the_run_before_is_not_taken_back_in_this_one(world: World) -> None:
    world.pool.check(SILENT_S + 1, may_join=True)
    world.take()
    world.pool.begin()
    world.hear(20.0)
    assert world.take() == []


def test_a_second_simulator_of_the_same_name_gets_no_work_and_one_warning(world: World) -> None:
    for now in (1.0, 2.0, 3.0):
        world.hear(now, incarnation="2" * 16, pid=9)
        world.hear(now)
        world.pool.check(now, may_join=True)
    assert world.take() == []
    assert len(world.warnings) == 1
    assert "process 9 on there gets no work" in world.warnings[0]
    assert world.pool.send(NAME, 0, 1, 3.0) == "1" * 16
    world.hear(4.0 + SILENT_S, incarnation="2" * 16, pid=9)  # the first is silent by now
    world.pool.check(4.0 + SILENT_S, may_join=True)
    assert [type(event) for event in world.take()] == [SimulatorLost, SimulatorReady]
    assert world.pool.send(NAME, 0, 2, 4.0 + SILENT_S) == "2" * 16


class Sweeps(RuleBasedStateMachine):
    """Pool and ledger together; heartbeats and blocks are lost, simulators crash."""

    names = st.sampled_from(["/bow/s1", "/bow/s2", "/bow/s3"])

    @initialize()
    def begin(self) -> None:
        self.now = 0.0
        self.ledger = Ledger(5, 2)
        self.pool = Pool(self.emit, "here", lambda _: None)
        self.living: dict[str, tuple[str, list[tuple[int, int]]]] = {}
        self.born = 0
        self.mail: list[tuple[str, int, int]] = []

    def emit(self, event: Event) -> None:
        for item in self.ledger.handle(event, self.now):
            if isinstance(item, Dispatch):
                incarnation = self.pool.send(item.simulator, item.block, item.attempt, self.now)
                if incarnation:
                    self.mail.append((incarnation, item.block, item.attempt))

    def beat(self, name: str, **changes: Any) -> None:
        incarnation, held = self.living[name]
        state = NodeState.BUSY if held else NodeState.READY
        message = health(state, held, node=name, incarnation=incarnation, **changes)
        self.pool.on_health(message, RUN, True, self.now)

    @rule(name=names)
    def start(self, name: str) -> None:
        if name not in self.living:
            self.born += 1
            self.living[name] = (f"{self.born:016}", [])
            self.beat(name)

    @rule(name=names, stranger=st.booleans())
    def heartbeat(self, name: str, stranger: bool) -> None:
        if stranger:
            self.pool.on_health(health(node=name, incarnation="f" * 16, pid=99), RUN, True, self.now)
        elif name in self.living:
            self.beat(name)

    @rule(seconds=st.sampled_from([0.1, 1.0, 4.0, 12.0]), silent=st.booleans())
    def time_passes(self, seconds: float, silent: bool) -> None:
        self.now += seconds
        if not silent:
            for name in self.living:
                self.beat(name)
        self.pool.check(self.now, may_join=True)
        self.emit(Tick())

    @rule(arrives=st.booleans(), which=st.integers(0, 9))
    def post(self, arrives: bool, which: int) -> None:
        if not self.mail:
            return
        incarnation, block, attempt = self.mail.pop(which % len(self.mail))
        for name, (own, held) in self.living.items():
            if arrives and own == incarnation and len(held) < 2:
                held.append((block, attempt))
                self.beat(name)

    @rule(name=names, answered=st.booleans())
    def compute(self, name: str, answered: bool) -> None:
        _, held = self.living.get(name, ("", []))
        if held:
            self.answer(held.pop(0)[0], answered)

    def answer(self, block: int, answered: bool) -> None:
        for chunk in range(2 if answered else 1):
            self.emit(Judged(block, chunk, 5, 6))
            self.emit(Receipted(block, chunk, 5, verdicts=False))
            self.emit(Receipted(block, chunk, 6, verdicts=True))
        if answered:
            self.emit(OnDisk(block))

    @rule(name=names, reported=st.booleans())
    def crash(self, name: str, reported: bool) -> None:
        if name in self.living:
            message = health(NodeState.DEAD, node=name, incarnation="")
            del self.living[name]
            if reported:
                self.pool.on_health(message, RUN, True, self.now)

    @invariant()
    def no_simulator_has_more_than_two_blocks(self) -> None:
        if hasattr(self, "ledger"):
            assert sum(self.ledger.count(state) for state in State) == 5
            assert all(len(held) <= 2 for held in self.ledger.in_flight.values())

    def teardown(self) -> None:
        """One simulator that answers is enough: every block is settled in the end."""
        if not hasattr(self, "ledger"):
            return
        for name in list(self.living):
            self.crash(name, True)
        self.mail.clear()
        self.start("/bow/s1")
        for _ in range(300):
            while self.mail:
                self.post(True, 0)
            self.compute("/bow/s1", True)
            self.time_passes(1.0, False)
            if self.ledger.finished:
                return
        raise AssertionError("blocks stay outstanding")


TestSweeps = Sweeps.TestCase
TestSweeps.settings = settings(max_examples=60, stateful_step_count=40, deadline=None)
