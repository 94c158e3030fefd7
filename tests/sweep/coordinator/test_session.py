"""The coordinator's session: whatever arrives, in any order, twice, late or from strangers, its contract holds.

What holds after every step, see `World`:

- every instruction about a run concerns the run in progress; planned = done + quarantined + outstanding cells;
- the plan's epoch never decreases, what is settled stays settled, and nothing but the results follows a closed plan;
- a run closes only when every block is done or quarantined, or its goal was cancelled;
- it is finished only after its results are written and its bag is closed, or the recorder had its time;
- a simulator joins only while recorder and classifier are ready for the run;
- a block is sent once for each attempt, to a simulator that is ready, after its entry is in the ledger's file;
- only messages of this run and sweep, on its own blocks and by its classifier, change ledger and map;
- a recorder or classifier is replaced only after it has gone, and that begins a new epoch;
- each goal is answered once; one that comes while a run is in progress fails.
"""

from __future__ import annotations

import shutil
from typing import Any

import numpy as np
import recording
from coordinator_world import Node, World, receipt, verdicts
from hypothesis import settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, initialize, invariant, precondition, rule

from bow_sim.protocol import cdr
from bow_sim.protocol.neighbours import CONSUMERS, LEFT, SILENT_S
from bow_sim.protocol.states import NodeState, ReceiptKind
from bow_sweep.coordinator.session import ANNOUNCE_S
from bow_sweep.coordinator.session_events import (
    CancelRequested,
    GoalAccepted,
    ReceiptReceived,
    RunGiven,
    TimePassed,
    VerdictsReceived,
)
from bow_sweep.maps.basin_map import PENDING
from bow_sweep.run.directory import Run

PLAIN = recording.small_sweep("periods=10")
ADAPTIVE = recording.small_sweep(
    *("adaptive=0.8", "x.count=6", "y.count=5", "x.first=2", "x.last=12", "block_cells=8", "periods=10")
)


def state_of(run: Run, basin: Any) -> Any:
    """Return all that a message may change."""
    ledger = run.ledger
    blocks = [(b.state, b.attempt, dict(b.streams), dict(b.judged), dict(b.verdicts), b.on_disk) for b in ledger.blocks]
    return ledger.epoch, blocks, {name: list(held) for name, held in ledger.in_flight.items()}, basin.tested.tobytes()


roles = st.sampled_from(CONSUMERS)
names = st.sampled_from(["/bow/s1", "/bow/s2"])
blocks = st.integers(0, 4)
chunks = st.integers(0, 2)


class Coordinating(RuleBasedStateMachine):
    """Throws everything at a session."""

    def __init__(self) -> None:
        super().__init__()
        self.world = World()
        self.runs = 0

    @initialize(slow=st.booleans(), adaptive=st.booleans(), at_work=st.booleans())
    def begin(self, slow: bool, adaptive: bool, at_work: bool) -> None:
        self.world.slow_results = slow
        self.send_goal("adaptive" if adaptive else "plain")
        if at_work:
            self.all_take_up()

    def all_take_up(self) -> None:
        roles = {f"/bow/{role}": role for role in CONSUMERS} | dict.fromkeys(("/bow/s1", "/bow/s2"), "simulator")
        for name, role in roles.items():
            if name not in self.world.nodes:
                self.start(role, name)
        for name in list(self.world.nodes):
            self.take_up(name)

    def start(self, role: str, name: str) -> None:
        self.world.born += 1
        self.world.nodes[name] = Node(role, name, f"a{self.world.born:015}", self.world.born)

    def take_up(self, name: str) -> None:
        node = self.world.nodes[name]
        if self.world.plan and not self.world.is_closed:
            node.run_id, node.state = self.world.plan["run_id"], NodeState.READY
        self.world.beat(node)

    # ---- goals

    @rule(which=st.sampled_from(["plain", "adaptive", "wrong"]))
    def send_goal(self, which: str) -> None:
        world = self.world
        self.runs += which != "wrong" and world.session.run is None
        if self.runs > 3:
            return
        world.born += 1
        goal = f"goal {world.born}".encode()
        sweep = {"plain": PLAIN, "adaptive": ADAPTIVE}.get(which)
        busy = world.session.run
        world.goals[goal] = ""
        event = GoalAccepted(goal, "", sweep.settings() if sweep else ("x.count=0",))
        if sweep is None or busy is not None:
            world.do(event)
            assert goal not in world.goals
            assert world.session.run is busy
            return
        out = world.session.handle(event, world.now)
        run = world.session.run
        assert run is not None
        world.goal, world.goals[goal] = goal, run.run_id
        for instruction in out:
            world.carry_out(instruction)

    @rule(own=st.booleans())
    def cancel(self, own: bool) -> None:
        goal = self.world.goal if own else b"another"
        if goal is not None:
            self.world.cancelled.add(goal)
            self.world.do(CancelRequested(goal))

    # ---- other nodes

    @rule(role=roles, second=st.booleans())
    def start_consumer(self, role: str, second: bool) -> None:
        name = f"/bow/{role}{'_2' * second}"
        self.start(role, name)
        self.world.beat(self.world.nodes[name])

    @rule(name=names)
    def start_simulator(self, name: str) -> None:
        self.start("simulator", name)
        self.world.beat(self.world.nodes[name])

    @rule(which=st.integers(0, 9), ready=st.sampled_from([True, True, True, False]))
    def heartbeat(self, which: int, ready: bool) -> None:
        if not self.world.nodes:
            return
        name = sorted(self.world.nodes)[which % len(self.world.nodes)]
        if ready:
            self.take_up(name)
        else:
            self.world.nodes[name].state = NodeState.STARTING
            self.world.beat(self.world.nodes[name])

    @rule(which=st.integers(0, 9), how=st.sampled_from(["dead", "left", "silent"]))
    def end_node(self, which: int, how: str) -> None:
        if not self.world.nodes:
            return
        node = self.world.nodes.pop(sorted(self.world.nodes)[which % len(self.world.nodes)])
        if how == "dead":
            self.world.beat(node, state=NodeState.DEAD)
        elif how == "left":
            self.world.beat(node, state=NodeState.CLOSED, detail=LEFT)

    @rule(arrives=st.booleans(), twice=st.booleans(), which=st.integers(0, 5))
    def post(self, arrives: bool, twice: bool, which: int) -> None:
        if not self.world.mail:
            return
        which %= len(self.world.mail)
        values = self.world.mail[which] if twice else self.world.mail.pop(which)
        for node in list(self.world.nodes.values()):
            key = (values["block"], values["attempt"])
            if arrives and node.incarnation == values["simulator"] and len(node.held) < 2 and key not in node.held:
                node.held.append(key)
                self.world.beat(node)

    @rule(name=names, chunks=st.integers(0, 2), refuses=st.sampled_from([False, False, True]))
    def compute(self, name: str, chunks: int, refuses: bool) -> None:
        node = self.world.nodes.get(name)
        if node is None or not node.held:
            return
        key = node.held.pop(0)
        if refuses:
            self.world.beat(node, refused=(key,))
            return
        for chunk in range(chunks):
            self.answer(key[0], chunk)
        if chunks == PLAIN.chunks:
            self.see_on_disk(key[0])
        self.world.beat(node)

    # ---- what they answer

    @rule(block=blocks, chunk=chunks)
    def answer(self, block: int, chunk: int) -> None:
        self.judge(block, chunk)
        run = self.world.session.run
        if run is not None:
            checksum = cdr.decode("Verdicts", verdicts(run, block, chunk))["checksum"]
            entries = [(ReceiptKind.STREAMS, block, chunk, 7), (ReceiptKind.VERDICTS, block, chunk, checksum)]
            self.world.do(ReceiptReceived(receipt(run, entries)))

    @rule(block=blocks, chunk=chunks)
    def judge(self, block: int, chunk: int) -> None:
        run = self.world.session.run
        if run is None:
            return
        if block < run.blocks.count and chunk < run.sweep.chunks:
            self.world.tests |= {(cell, chunk) for cell in run.blocks.block(block).tolist()}
        self.world.do(VerdictsReceived(verdicts(run, block, chunk)))

    @rule(first=blocks, last=blocks)
    def answer_together(self, first: int, last: int) -> None:
        """What was answered on some blocks while the coordinator was busy arrives at once."""
        run, events = self.world.session.run, []
        for block in range(first, last + 1) if run is not None else ():
            for chunk in range(run.sweep.chunks):
                if block < run.blocks.count:
                    self.world.tests |= {(cell, chunk) for cell in run.blocks.block(block).tolist()}
                data = verdicts(run, block, chunk)
                checksum = cdr.decode("Verdicts", data)["checksum"]
                entries = [(ReceiptKind.STREAMS, block, chunk, 7), (ReceiptKind.VERDICTS, block, chunk, checksum)]
                events += [VerdictsReceived(data), ReceiptReceived(receipt(run, entries))]
            events.append(ReceiptReceived(receipt(run, [(ReceiptKind.BLOCK, block, 0, 0)])))
        self.world.do(*events)

    @rule(block=blocks)
    def see_on_disk(self, block: int) -> None:
        run = self.world.session.run
        if run is not None:
            self.world.do(ReceiptReceived(receipt(run, [(ReceiptKind.BLOCK, block, 0, 0)])))

    @rule(block=blocks, chunk=chunks)
    def differ(self, block: int, chunk: int) -> None:
        """The recorder has other bytes than the classifier: the block is not deterministic."""
        self.judge(block, chunk)
        run = self.world.session.run
        if run is not None:
            self.world.do(ReceiptReceived(receipt(run, [(ReceiptKind.STREAMS, block, chunk, 8)])))

    @rule()
    def strange(self) -> None:
        """What is not of this run, or is no message, is counted and changes nothing."""
        world, active = self.world, self.world.session._active
        if active is None:
            return
        run = active.run
        right = verdicts(run, 0, 0)
        entries = [(ReceiptKind.BLOCK, 0, 0, 0)]
        strange = [
            VerdictsReceived(verdicts(run, 0, 0, run_id="f" * 16)),
            VerdictsReceived(verdicts(run, 0, 0, sweep_id="f" * 16)),
            VerdictsReceived(verdicts(run, 0, 0, classifier="0" * 16)),
            VerdictsReceived(verdicts(run, 0, 0, cells=run.blocks.block(0)[::-1])),
            VerdictsReceived(verdicts(run, run.blocks.count, 0)),
            VerdictsReceived(verdicts(run, 0, run.sweep.chunks)),
            VerdictsReceived(right[:-1]),
            VerdictsReceived(right[:-1] + bytes([right[-1] ^ 1])),
            ReceiptReceived(receipt(run, entries, run_id="f" * 16)),
            ReceiptReceived(receipt(run, entries, sweep_id="f" * 16)),
            ReceiptReceived(receipt(run, entries, checksum=[1, 2])),
            ReceiptReceived(receipt(run, entries)[:-9]),
        ]
        for event in strange:
            before, ignored = state_of(run, active.basin), world.ignored
            world.do(event)
            assert world.ignored == ignored + 1, event
            assert state_of(run, active.basin) == before, event

    @rule()
    def hello(self) -> None:
        self.world.do(VerdictsReceived(cdr.hello("Verdicts", "a" * 16)))

    @precondition(lambda self: self.world.is_closed)
    @rule()
    def close_bag(self) -> None:
        for node in list(self.world.nodes.values()):
            if node.role == "recorder" and self.world.plan:
                node.run_id, node.state = self.world.plan["run_id"], NodeState.CLOSED
                self.world.beat(node)

    @rule()
    def write_results(self) -> None:
        self.world.write()

    @rule(seconds=st.sampled_from([0.1, 1.0, 4.0, 12.0, 70.0]), silent=st.booleans())
    def time_passes(self, seconds: float, silent: bool) -> None:
        self.world.now += seconds
        if not silent:
            for node in list(self.world.nodes.values()):
                self.world.beat(node)
        self.tick()

    def tick(self) -> None:
        world, run = self.world, self.world.session.run
        late = world.now - world.plan_at >= ANNOUNCE_S
        world.do(TimePassed())
        if world.session.run is not None and run is world.session.run and not world.is_closed:
            assert world.goal not in world.cancelled, "a cancelled run closes"
            ready = all(world.is_ready(role, run.run_id) for role in CONSUMERS)
            assert ready or not late or world.plan_at == world.now, "the plan is repeated for those that lack it"

    @rule()
    def work(self) -> None:
        """All that are there do their work for a second."""
        self.world.now += 1.0
        for name in list(self.world.nodes):
            self.take_up(name)
        self.tick()
        while self.world.mail:
            self.post(True, False, 0)
        for name in ("/bow/s1", "/bow/s2"):
            self.compute(name, PLAIN.chunks, False)
        if self.world.is_closed:
            self.close_bag()
            self.world.write()

    @rule()
    def restart_coordinator(self) -> None:
        """The coordinator is started again and resumes its run in a later epoch; nobody waits for the goal any more."""
        world, active = self.world, self.world.session._active
        if active is None:
            return
        world.session.close()
        epoch = active.run.ledger.epoch
        layers = {**active.basin.layers, "tested": active.basin.layers["regime"] != PENDING}
        tests = world.tests
        world.goals.clear()
        world.begin_process()
        run = Run.resume(active.run.directory)
        world.tests = tests
        assert run.ledger.epoch > epoch
        assert run.blocks.extends(active.run.blocks)
        world.do(RunGiven(run, layers))

    # ---- what always holds

    @invariant()
    def every_goal_but_that_of_the_run_in_progress_is_answered(self) -> None:
        assert set(self.world.goals) <= {self.world.goal}

    @invariant()
    def accounts_balance(self) -> None:
        run = self.world.session.run
        if run is not None:
            accounts = run.accounts()
            assert accounts["planned"] == accounts["done"] + accounts["quarantined"] + accounts["outstanding"]
            assert self.world.plan["run_id"] == run.run_id

    @invariant()
    def the_map_has_the_verdicts_that_came_and_no_others(self) -> None:
        active = self.world.session._active
        if active is not None:
            tested = np.argwhere(active.basin.layers["regime"] != PENDING)
            assert {(cell, test) for test, cell in tested.tolist()} == self.world.tests

    def teardown(self) -> None:
        try:
            self.come_to_an_end()
        finally:
            self.world.session.close()
            shutil.rmtree(self.world.directory)

    def come_to_an_end(self) -> None:
        """With simulators that answer, the run in progress comes to its end, and its goal is answered."""
        world = self.world
        if world.born % 2:  # the nodes that are there go on, or new ones take their places
            for name in sorted(world.nodes):
                world.beat(world.nodes.pop(name), state=NodeState.DEAD)
            world.mail.clear()
        world.now += 2 * SILENT_S
        for _ in range(150):
            if world.session.run is None:
                break
            self.all_take_up()
            self.work()
        assert world.session.run is None, "the run does not come to its end"
        assert not world.goals


TestCoordinating = Coordinating.TestCase
TestCoordinating.settings = settings(max_examples=30, stateful_step_count=40, deadline=None)
