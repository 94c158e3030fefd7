"""Which simulator has which block, and what is acknowledged: a pure state machine, events in, instructions out.

A block is *due* (to be sent), *dispatched* (sent to a simulator, not yet done), *done* or *quarantined* (given up).
Done means: the recorder has receipted the verdicts of every chunk, and the streams of every chunk that is recorded with
them; the classifier has judged the bytes that were recorded; and all of the block is on the disk. After every event,
planned = done + quarantined + outstanding, where outstanding = due + dispatched.

A block belongs to the station (:mod:`bow_sim.protocol.stations`) of the simulator that it was sent to last: only the
answers of recorder and classifier of that station count for it. Sent to another station, its account begins anew.

The machine has no clock and no file: the time is passed in, and an entry that must be on the disk before the next
instruction is returned as a :class:`Record`. :meth:`Ledger.resume` builds the machine again from such entries.
"""

from __future__ import annotations

import heapq
from collections.abc import Iterable, Mapping
from typing import Any

from bow_sim.protocol.stations import named
from bow_sweep.run.ledger_block import Block, Checksums
from bow_sweep.run.ledger_events import (
    AnswerEvent,
    ConsumerRestarted,
    Dispatch,
    Event,
    Finished,
    Grown,
    Instruction,
    Judged,
    NewEpoch,
    OnDisk,
    Receipted,
    Record,
    Refused,
    Settled,
    SimulatorLost,
    SimulatorReady,
    SimulatorReturned,
    State,
    StationLost,
    Tick,
)

POISON_CRASHES = 3
"""A block that was the only one in flight at a simulator in this many crashes is quarantined."""

MAX_IN_FLIGHT = 2
"""Blocks that a simulator holds at most: one being computed, one waiting, so that it is never idle."""

DISK_S = 300.0
"""Seconds that a block may wait for a slow disk when all its chunks are acknowledged."""

STALE_S = 6.0
"""Seconds without an acknowledgement after which a block is due again that no simulator holds any more."""


class Ledger:
    """The bookkeeping of one run; changed by :meth:`handle` alone.

    Parameters
    ----------
    blocks, chunks
        How many blocks the sweep has so far, and how many chunks each block has.
    recorded
        The chunks whose streams are recorded; None for all.

    Attributes
    ----------
    epoch
        Number of the latest (re)start of coordinator, recorder or classifier, from 1.
    announced
        The epoch of the plan. That of a block is greater where a consumer of its station was restarted while other
        stations were at work: their blocks go on.
    blocks
        State of each block.
    in_flight
        Simulator -> the blocks that it holds, the one being computed first.
    """

    def __init__(self, blocks: int, chunks: int, recorded: range | None = None) -> None:
        if blocks < 1 or chunks < 1:
            raise ValueError(f"{blocks} blocks of {chunks} chunks: there should be at least one of each")
        self.chunks = chunks
        self.recorded = range(chunks) if recorded is None else recorded
        self.epoch = self.announced = 1
        self.blocks = [Block() for _ in range(blocks)]
        self.in_flight: dict[str, list[int]] = {}
        self._station: dict[str, str] = {}  # of each simulator
        self._blamed: dict[str, tuple[int, bool]] = {}  # simulator that was lost -> suspect block, and if it was alone
        self._restarted: dict[str, int] = {}  # station -> epoch in which a consumer of it was restarted
        self._open: set[int] = set(range(blocks))
        self._due = list(range(blocks))

    @classmethod
    def resume(
        cls, blocks: int, chunks: int, entries: Iterable[Mapping[str, Any]], recorded: range | None = None
    ) -> Ledger:
        """Return the ledger of an interrupted run, in a new epoch, from its recorded entries."""
        ledger = cls(blocks, chunks, recorded)
        for entry in entries:
            ledger.epoch = max(ledger.epoch, int(entry.get("epoch", 1)))
            number = entry.get("block")
            if not isinstance(number, int) or not 0 <= number < blocks:
                continue
            block = ledger.blocks[number]
            block.attempt = max(block.attempt, int(entry.get("attempt", 0)))
            match entry.get("event"):
                case "died":
                    block.count_crash(entry["alone"])
                case "returned":
                    block.count_crash(entry["alone"], -1)
                case "done":
                    block.state = State.DONE
                    block.station = str(entry.get("station", ""))
                case "quarantined":
                    block.state = State.QUARANTINED
                case "reopened":
                    block.state = State.DUE
        ledger.epoch += 1
        ledger.announced = ledger.epoch
        ledger._open = {n for n, block in enumerate(ledger.blocks) if block.state is State.DUE}
        ledger._due = sorted(ledger._open)
        return ledger

    # ---- reading

    def count(self, state: State) -> int:
        """Return how many blocks are in a state."""
        return sum(block.state is state for block in self.blocks)

    def is_quarantined(self, number: int) -> bool:
        """Return whether there is such a block and it is quarantined."""
        return number < len(self.blocks) and self.blocks[number].state is State.QUARANTINED

    def is_of(self, number: int, station: str) -> bool:
        """Return whether there is such a block and it belongs to a station."""
        return number < len(self.blocks) and self.blocks[number].station == station

    def epoch_of(self, number: int) -> int:
        """Return the epoch in which a block was sent last."""
        return self.epoch_at(self.blocks[number].station)

    def epoch_at(self, station: str) -> int:
        """Return the epoch of the blocks that are sent to a station now."""
        return max(self.announced, self._restarted.get(station, 0))

    @property
    def finished(self) -> bool:
        """Whether no block is outstanding."""
        return not self._open

    # ---- changing

    def handle(self, event: Event, now: float) -> list[Instruction]:
        """Take in an event at `now` (seconds, any origin) and return what to do, in order."""
        return self.handle_all([event], now)

    def handle_all(self, events: Iterable[Event], now: float) -> list[Instruction]:
        """Take in, in their order, several events, as :meth:`handle` does."""
        out: list[Instruction] = []
        for event in events:
            if isinstance(event, (Receipted, Judged, OnDisk)):
                self._answer(event, now, out)
            else:
                self._change(event, now, out)
                self._dispatch_due(now, out)  # an answer frees no simulator and makes no block due
        return out

    def _answer(self, answer: AnswerEvent, now: float, out: list[Instruction]) -> None:
        """Take in an answer on a chunk or a block, in the fewest steps: there are thousands in a second."""
        if isinstance(answer, Receipted):
            number, chunk, checksum, of_verdicts, station = answer
            if self._concerns(number, chunk, station) and (of_verdicts or chunk in self.recorded):
                block = self.blocks[number]
                receipts = block.verdicts if of_verdicts else block.streams
                self._answered(number, chunk, receipts.setdefault(chunk, checksum) != checksum, now, out)
        elif isinstance(answer, Judged):
            number, chunk, chunk_checksum, checksum, station = answer
            if self._concerns(number, chunk, station):
                checksums, block = Checksums(chunk_checksum, checksum), self.blocks[number]
                differs = block.judged.setdefault(chunk, checksums) != checksums
                differs |= block.judged_before.get(chunk, checksums) != checksums
                self._answered(number, chunk, differs, now, out)
        else:
            number, station = answer
            if self._concerns(number, 0, station) and not self.blocks[number].on_disk:  # it is said again and again
                self.blocks[number].on_disk = True
                self._answered(number, 0, False, now, out)

    def _change(self, event: Event, now: float, out: list[Instruction]) -> None:
        """Take in an event that is no answer on a chunk or a block."""
        match event:
            case SimulatorReady(simulator, station):
                self.in_flight.setdefault(simulator, [])
                self._station[simulator] = station
            case SimulatorLost(simulator, why, blame):
                self._lose(simulator, why, blame, now, out)
            case SimulatorReturned(simulator):
                self._take_back(simulator, out)
            case Finished(simulator, number, attempt):
                self._remove_in_flight(simulator, number, attempt)
                if self._is_dispatched(number, attempt):
                    self.blocks[number].touched = now
            case Refused(simulator, number, attempt, why):
                self._remove_in_flight(simulator, number, attempt)
                if self._is_dispatched(number, attempt):
                    self._make_due(number, why, out)
            case ConsumerRestarted(role, station):
                self._restart(role, station, out)
            case StationLost(station):
                for number in self._not_held():
                    if self.blocks[number].state is State.DISPATCHED and self.blocks[number].station == station:
                        self._make_due(number, "the recorder or classifier of its station has gone", out)
            case Grown(blocks):
                fresh = range(len(self.blocks), blocks)
                self.blocks += [Block() for _ in fresh]
                self._open.update(fresh)
                self._due = sorted([*self._due, *fresh])
            case Tick():
                self._expire(now, out)

    def _concerns(self, number: int, chunk: int, station: str) -> bool:
        return number in self._open and 0 <= chunk < self.chunks and self.blocks[number].station == station

    def _is_dispatched(self, number: int, attempt: int) -> bool:
        block = self.blocks[number]
        return block.state is State.DISPATCHED and block.attempt == attempt

    def _remove_in_flight(self, simulator: str, number: int, attempt: int) -> None:
        """Remove a block from a simulator's in-flight list, unless the report is for an older attempt."""
        if number in self.in_flight.get(simulator, ()) and self.blocks[number].attempt == attempt:
            self.in_flight[simulator].remove(number)

    def _make_due(self, number: int, why: str, out: list[Instruction]) -> None:
        block = self.blocks[number]
        block.state = State.DUE
        heapq.heappush(self._due, number)
        out.append(Record({"event": "due", "block": number, "attempt": block.attempt, "why": why}))

    def _settle(self, number: int, state: State, why: str, out: list[Instruction]) -> None:
        block = self.blocks[number]
        if block.state is State.DUE:
            self._due.remove(number)
            heapq.heapify(self._due)
        block.state = state
        block.discard_answers()
        block.judged_before.clear()
        self._open.discard(number)
        entry = {"event": state.value, "block": number, "attempt": block.attempt, **named(block.station)}
        out.append(Record({**entry, "why": why} if why else entry))
        out.append(Settled(number, state, why))

    def _answered(self, number: int, chunk: int, differs: bool, now: float, out: list[Instruction]) -> None:
        block = self.blocks[number]
        block.touched = now
        why = f"chunk {chunk}: two answers differ" if differs else block.contradiction(chunk)
        if why:
            self._settle(number, State.QUARANTINED, f"nondeterministic: {why}", out)
        elif block.on_disk and self._all_answered(block):
            self._settle(number, State.DONE, "", out)

    def _all_answered(self, block: Block) -> bool:
        streams = len(block.streams) == len(self.recorded)
        return streams and len(block.judged) == len(block.verdicts) == self.chunks

    def _lose(self, simulator: str, why: str, blame: bool, now: float, out: list[Instruction]) -> None:
        # A block may be done while the report that the simulator has finished it is still on its way: it is left out.
        lost = [number for number in self.in_flight.pop(simulator, []) if self.blocks[number].state is State.DISPATCHED]
        self._station.pop(simulator, None)
        self._blamed.pop(simulator, None)
        for place, number in enumerate(lost):
            block = self.blocks[number]
            if blame and place == 0:  # only the block being computed is suspect
                alone = len(lost) == 1
                block.count_crash(alone)
                self._blamed[simulator] = (number, alone)
                out.append(
                    Record({"event": "died", "block": number, "simulator": simulator, "alone": alone, "why": why})
                )
                if block.crashes_alone >= POISON_CRASHES:
                    why_poison = f"poison: {block.crashes_alone} simulators crashed while computing only this block"
                    self._settle(number, State.QUARANTINED, why_poison, out)
                    continue
            self._make_due(number, why, out)

    def _take_back(self, simulator: str, out: list[Instruction]) -> None:
        """Count the loss of a simulator that has come back no more as a crash of its block."""
        number, alone = self._blamed.pop(simulator, (-1, False))
        if number >= 0:
            self.blocks[number].count_crash(alone, -1)
            out.append(Record({"event": "returned", "block": number, "simulator": simulator, "alone": alone}))

    def _restart(self, role: str, station: str, out: list[Instruction]) -> None:
        """Have the blocks of a station sent again, in a new epoch: that of the run if no other station is at work."""
        self.epoch += 1
        out.append(Record({"event": "restarted", "role": role, "epoch": self.epoch, **named(station)}))
        alone = all(other == station for other in self._station.values())
        for simulator, held in self.in_flight.items():
            if alone or self._station[simulator] == station:
                held.clear()
        for number in sorted(self._open):
            block = self.blocks[number]
            if alone or block.station == station:
                block.discard_answers()
                if block.state is State.DISPATCHED:
                    self._make_due(number, f"{role} restarted", out)
        if alone:
            self.announced = self.epoch
            out.append(NewEpoch(self.epoch))
        else:
            self._restarted[station] = self.epoch

    def _not_held(self) -> list[int]:
        """Return the outstanding blocks that no simulator has in flight."""
        return sorted(self._open.difference(*self.in_flight.values()))

    def _expire(self, now: float, out: list[Instruction]) -> None:
        for number in self._not_held():
            block = self.blocks[number]
            patience = DISK_S if self._all_answered(block) else STALE_S
            if block.state is State.DISPATCHED and now - block.touched > patience:
                self._make_due(number, f"no answer for {patience:g} s", out)

    def _dispatch_due(self, now: float, out: list[Instruction]) -> None:
        """Send due blocks to the simulators with fewest in flight; a suspect block goes to one that has no other."""
        postponed = []
        while self._due:
            number = heapq.heappop(self._due)
            block = self.blocks[number]
            most = 1 if block.suspect else MAX_IN_FLIGHT
            free = [
                (len(held), name)
                for name, held in self.in_flight.items()
                if len(held) < most and not any(self.blocks[n].suspect for n in held)
            ]
            if not free:
                postponed.append(number)
                if not block.suspect:
                    break
                continue
            simulator = min(free)[1]
            station = self._station[simulator]
            if station != block.station:
                block.move(station)
            block.state, block.touched = State.DISPATCHED, now
            block.attempt += 1
            self.in_flight[simulator].append(number)
            entry = {"event": "dispatched", "block": number, "attempt": block.attempt}
            entry |= {"epoch": self.epoch_at(station), "simulator": simulator, **named(station)}
            out.append(Record(entry))
            out.append(Dispatch(number, block.attempt, simulator))
        for number in postponed:
            heapq.heappush(self._due, number)
