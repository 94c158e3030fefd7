"""The ledger, whatever happens in whatever order, in several stations: exact accounts."""

from collections.abc import Callable

from hypothesis import settings
from hypothesis import strategies as st
from hypothesis.stateful import Bundle, RuleBasedStateMachine, consumes, initialize, invariant, rule

from bow_sim.protocol.recording import RECORD, recorded_chunks
from bow_sweep.run import ledger as L  # noqa: N812  # events read better as L.Finished
from bow_sweep.run.ledger import Ledger, State

CHUNKS = 3


def chunk_sum(block: int, chunk: int) -> int:
    return 1000 * block + chunk


def verdict_sum(block: int, chunk: int) -> int:
    return 500_000 + 1000 * block + chunk


def planned_is_accounted_for(ledger: Ledger) -> bool:
    return sum(ledger.count(state) for state in State) == len(ledger.blocks)


STATIONS = ("", "lab", "attic")


class Sweeping(RuleBasedStateMachine):
    """Anything may happen in any order; the account always balances and resuming gives the same account."""

    simulators = Bundle("simulators")

    def __init__(self) -> None:
        super().__init__()
        self.recorded = range(CHUNKS)
        self.ledger = Ledger(6, CHUNKS)
        self.receipted: set[tuple[int, int, bool, str]] = set()
        self.judged: set[tuple[int, int, str]] = set()
        self.at: dict[str, str] = {}  # simulator -> station
        self.owner: dict[int, str] = {}  # block -> station that it was sent to last
        self.records: list = []
        self.now = 0.0
        self.names = 0
        self.synced: set[tuple[int, str]] = set()

    @initialize(record=st.sampled_from(list(RECORD)))
    def begin(self, record: str) -> None:
        self.recorded = recorded_chunks(record, CHUNKS)
        self.ledger = Ledger(6, CHUNKS, self.recorded)

    def follow(self, event: L.Event) -> None:
        """Note what is receipted and judged, and which blocks are on the disk, since a consumer was started."""
        if isinstance(event, L.ConsumerRestarted):
            self.forget(lambda _, station: station == event.station)
        if isinstance(event, L.Receipted):
            self.receipted.add((event.block, event.chunk, event.verdicts, event.station))
        if isinstance(event, L.Judged):
            self.judged.add((event.block, event.chunk, event.station))
        if isinstance(event, L.OnDisk):
            self.synced.add((event.block, event.station))

    def forget(self, which: Callable[[int, str], bool]) -> None:
        """Forget the answers of some blocks and stations."""
        for answers in (self.receipted, self.judged, self.synced):
            answers -= {answer for answer in answers if which(answer[0], answer[-1])}

    def do(self, event: L.Event) -> None:
        before = [block.state for block in self.ledger.blocks]
        held = {name: list(blocks) for name, blocks in self.ledger.in_flight.items()}
        self.follow(event)
        out = self.ledger.handle(event, self.now)
        for item in out:
            if isinstance(item, L.Dispatch):
                station = self.at[item.simulator]
                if self.owner.get(item.block, "") != station:
                    self.forget(lambda block, _, moved=item.block: block == moved)
                self.owner[item.block] = station
            if isinstance(item, L.Settled) and item.state is State.DONE:
                at = self.owner.get(item.block, "")
                assert (item.block, at) in self.synced, "done only when it is on the disk since the last restart"
                due = {(item.block, chunk, True, at) for chunk in range(CHUNKS)}
                due |= {(item.block, chunk, False, at) for chunk in self.recorded}
                assert due <= self.receipted, "done only when one station has receipted all that is to be recorded"
                assert {(item.block, chunk, at) for chunk in range(CHUNKS)} <= self.judged, "and judged all of it"
        for entry in (item.entry for item in out if isinstance(item, L.Record)):
            if entry["event"] in ("dispatched", "done"):
                assert entry.get("station", "") == self.owner.get(entry["block"], "")
        if isinstance(event, L.ConsumerRestarted) and {*self.at.values()} - {event.station}:
            for name, blocks in held.items():
                if self.at[name] != event.station:
                    assert self.ledger.in_flight[name][: len(blocks)] == blocks, "the others go on"
        self.records += [item.entry for item in out if isinstance(item, L.Record)]
        for old, block in zip(before, self.ledger.blocks, strict=False):
            if old in (State.DONE, State.QUARANTINED):
                assert block.state is old, "what is settled stays settled"

    @rule(target=simulators, station=st.sampled_from(STATIONS))
    def join(self, station: str) -> str:
        self.names += 1
        self.at[f"s{self.names}"] = station
        self.do(L.SimulatorReady(f"s{self.names}", station))
        return f"s{self.names}"

    @rule(simulator=consumes(simulators), blame=st.booleans())
    def lose(self, simulator: str, blame: bool) -> None:
        self.do(L.SimulatorLost(simulator, "x", blame))
        self.at.pop(simulator)

    @rule(number=st.integers(0, 9))
    def come_back(self, number: int) -> None:
        self.do(L.SimulatorReturned(f"s{number}"))
        assert all(0 <= block.crashes_alone <= block.crashes for block in self.ledger.blocks)

    @rule(simulator=simulators, refused=st.booleans(), stale=st.booleans())
    def end_goal(self, simulator: str, refused: bool, stale: bool) -> None:
        for block in self.ledger.in_flight.get(simulator, [])[:1]:
            attempt = self.ledger.blocks[block].attempt - stale
            self.do(L.Refused(simulator, block, attempt, "x") if refused else L.Finished(simulator, block, attempt))

    @rule(
        block=st.integers(0, 7),
        chunk=st.integers(0, CHUNKS),
        wrong=st.sampled_from([0, 0, 0, 0, 1]),
        station=st.sampled_from(STATIONS),
    )
    def receipt(self, block: int, chunk: int, wrong: int, station: str) -> None:
        self.do(L.Receipted(block, chunk, chunk_sum(block, chunk) + wrong, False, station))
        self.do(L.Receipted(block, chunk, verdict_sum(block, chunk), True, station))

    @rule(block=st.integers(0, 7), station=st.sampled_from(STATIONS))
    def sync(self, block: int, station: str) -> None:
        self.do(L.OnDisk(block, station))

    @rule(block=st.integers(0, 7), chunk=st.integers(0, CHUNKS), station=st.sampled_from(STATIONS))
    def judge(self, block: int, chunk: int, station: str) -> None:
        self.do(L.Judged(block, chunk, chunk_sum(block, chunk), verdict_sum(block, chunk), station))

    @rule(block=st.integers(0, 7), missing=st.integers(0, 20))
    def all_is_answered_where_it_is(self, block: int, missing: int) -> None:
        """Its station sends all answers, or all but one."""
        at = self.owner.get(block, "")
        events: list = [L.OnDisk(block, at)]
        for chunk in range(CHUNKS):
            events.append(L.Receipted(block, chunk, chunk_sum(block, chunk), False, at))
            events.append(L.Judged(block, chunk, chunk_sum(block, chunk), verdict_sum(block, chunk), at))
            events.append(L.Receipted(block, chunk, verdict_sum(block, chunk), True, at))
        for event in events[:missing] + events[missing + 1 :]:
            self.do(event)

    @rule(role=st.sampled_from(["recorder", "classifier"]), station=st.sampled_from(STATIONS))
    def restart(self, role: str, station: str) -> None:
        self.do(L.ConsumerRestarted(role, station))

    @rule(station=st.sampled_from(STATIONS))
    def lose_a_station(self, station: str) -> None:
        held = {block for blocks in self.ledger.in_flight.values() for block in blocks}
        waiting = {
            number: block.attempt
            for number, block in enumerate(self.ledger.blocks)
            if block.state is State.DISPATCHED and block.station == station and number not in held
        }
        self.do(L.StationLost(station))
        for number, attempt in waiting.items():
            block = self.ledger.blocks[number]
            assert block.state is State.DUE or block.attempt == attempt + 1, "nobody waits for its answers"

    @rule(seconds=st.floats(0, 30))
    def wait(self, seconds: float) -> None:
        self.now += seconds
        self.do(L.Tick())

    @rule(blocks=st.integers(1, 3))
    def grow(self, blocks: int) -> None:
        if len(self.ledger.blocks) < 12:
            self.do(L.Grown(len(self.ledger.blocks) + blocks))

    @invariant()
    def accounts_balance(self) -> None:
        assert planned_is_accounted_for(self.ledger)
        outstanding = self.ledger.count(State.DUE) + self.ledger.count(State.DISPATCHED)
        assert self.ledger.finished == (outstanding == 0)

    @invariant()
    def no_block_is_in_flight_twice_and_no_simulator_has_too_many(self) -> None:
        held = [block for blocks in self.ledger.in_flight.values() for block in blocks]
        assert len(held) == len(set(held))
        assert all(len(blocks) <= L.MAX_IN_FLIGHT for blocks in self.ledger.in_flight.values())

    @invariant()
    def a_resumed_ledger_has_the_same_account(self) -> None:
        again = Ledger.resume(len(self.ledger.blocks), CHUNKS, self.records, self.recorded)
        for state in (State.DONE, State.QUARANTINED):
            assert again.count(state) == self.ledger.count(state)
        assert [b.crashes for b in again.blocks if b.state is State.DUE] == [
            b.crashes for b in self.ledger.blocks if b.state in (State.DUE, State.DISPATCHED)
        ]


TestSweeping = Sweeping.TestCase
TestSweeping.settings = settings(max_examples=60, stateful_step_count=40, deadline=None)
