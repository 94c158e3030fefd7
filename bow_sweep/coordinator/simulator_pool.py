"""The simulators that a coordinator knows from their heartbeats: which are ready, and which blocks each of them holds.

A block is sent as a message, which may be lost; each heartbeat lists the blocks that the simulator holds. So a block
that was sent and is not taken in time is due again, and a block that was held and is not held any more has ended,
whichever messages were lost in between. No ROS, no clock.
"""

from __future__ import annotations

from collections.abc import Callable, Collection
from dataclasses import dataclass, field
from typing import Any, NamedTuple

from bow_sim.protocol.neighbours import LEFT, SILENT_S, is_gone
from bow_sim.protocol.states import NodeState
from bow_sweep.run.ledger_events import Event, Finished, Refused, SimulatorLost, SimulatorReady, SimulatorReturned

TAKEN_S = 3.0
"""A simulator has this many seconds to take a block that was sent to it."""

FIRST_PAUSE_S, LONGEST_PAUSE_S = 0.5, 8.0
"""Seconds without work for a simulator that refuses a block, doubled each time up to the longest."""

MAX_SIMULATORS = 4096
"""Simulators that are known at most: any process may publish heartbeats."""

RECENT_S = 1.5
"""The process of a simulator that was heard within this many seconds is not looked up in /proc."""


class Attempt(NamedTuple):
    """One attempt at a block."""

    block: int
    attempt: int


@dataclass
class _Sent:
    at: float
    taken: bool = False


@dataclass
class _Simulator:
    incarnation: str
    host: str
    pid: int
    heard: float
    ready: bool = False
    station: str = ""
    joined: bool = False  # it is in the ledger: blocks are sent to it
    pause: float = 0.0
    resume_at: float = 0.0
    holds: set[Attempt] = field(default_factory=set)
    sent: dict[Attempt, _Sent] = field(default_factory=dict)


class Pool:
    """Turns heartbeats of simulators, and their absence, into events of the ledger.

    Parameters
    ----------
    emit
        Takes each event.
    host
        Name of this machine: whether a silent process has ended can be seen only here.
    log_warning
        Takes a line for the log.
    station_of
        Returns the station of a simulator, by its name.
    """

    def __init__(
        self,
        emit: Callable[[Event], None],
        host: str,
        log_warning: Callable[[str], object],
        station_of: Callable[[str], str] = lambda _: "",
    ) -> None:
        self._emit, self._host, self._log_warning, self._station_of = emit, host, log_warning, station_of
        self._simulators: dict[str, _Simulator] = {}
        self._doubles: set[str] = set()
        self._silent: dict[str, str] = {}  # name -> incarnation that was silent for long: it may have died, or not

    def begin(self) -> None:
        """Begin a run: no simulator is in its ledger yet, and heartbeats of before do not count for it."""
        for simulator in self._simulators.values():
            simulator.ready = simulator.joined = False
            simulator.sent.clear()
        self._silent.clear()

    def on_health(self, message: Any, run_id: str, hears_us: bool, now: float) -> None:
        """Take a simulator's heartbeat, or the report of its supervisor that its process has ended.

        Parameters
        ----------
        message
            The Health.
        run_id
            Of the run in progress; "" if there is none.
        hears_us
            Whether blocks arrive at the simulator.
        now
            Seconds.
        """
        name = message.node
        known = self._simulators.get(name)
        silent = self._silent.pop(name, None)
        if message.state == NodeState.DEAD:
            if known is not None and (known.host, known.pid) == (message.host, message.pid):
                self._forget(name, message.detail, blame=True)
            return
        if silent == message.incarnation:  # it has not died: the network was silent
            self._emit(SimulatorReturned(name))
        if message.state == NodeState.CLOSED and message.detail == LEFT:
            if known is not None and known.incarnation == message.incarnation:
                self._forget(name, LEFT, blame=False)
            return
        if known is not None and known.incarnation != message.incarnation:
            if not self._has_ended(known, now):
                self._warn_of_double(name, message, known)
                return
            self._forget(name, "restarted", blame=True)
            known = None
        if known is None:
            if len(self._simulators) >= MAX_SIMULATORS:
                return
            known = self._simulators[name] = _Simulator(message.incarnation, message.host, message.pid, now)
            known.station = self._station_of(name)
        known.heard = now
        known.holds = _attempts(message.held_blocks, message.held_attempts)
        working = message.run_id == run_id and message.state in (NodeState.READY, NodeState.BUSY)
        known.ready = working and hears_us
        if not working:
            self._release(name, message.detail or "not ready", blame=False)
        elif known.joined:
            self._compare(name, known, _attempts(message.refused_blocks, message.refused_attempts), now)

    def check(
        self, now: float, may_join: bool, only: str | None = None, stations: Collection[str] | None = None
    ) -> None:
        """Forget simulators that have ended; if `may_join`, let those join that are ready.

        Parameters
        ----------
        now
            Seconds.
        may_join
            Whether recorder and classifier are ready for the work of more simulators.
        only
            Name of the simulator to look at; None for all.
        stations
            Those whose simulators may join; None for all.
        """
        for name in list(self._simulators) if only is None else [only]:
            simulator = self._simulators.get(name)
            if simulator is None:
                continue
            silent = now - simulator.heard
            if self._has_ended(simulator, now):
                # A process that still exists on this machine is stopped or stuck: its block is not the cause.
                exists = simulator.host == self._host and not is_gone(simulator.host, simulator.pid, self._host)
                why = f"silent for {silent:.0f} s" if silent > SILENT_S else "its process has ended"
                if simulator.joined and not exists and silent > SILENT_S and len(self._silent) < MAX_SIMULATORS:
                    self._silent[name] = simulator.incarnation
                self._forget(name, why, blame=not exists)
            elif may_join and (stations is None or simulator.station in stations) and self._can_join(simulator, now):
                simulator.joined = True
                simulator.sent.clear()
                self._emit(SimulatorReady(name, simulator.station))

    def release_stations(self, stations: Collection[str]) -> None:
        """Give the blocks of these stations, whose recorder or classifier has gone, to others."""
        for name, simulator in list(self._simulators.items()):
            if simulator.joined and simulator.station in stations:
                self._release(name, "the recorder or classifier of its station has gone", blame=False)

    def holding(self) -> list[tuple[str, str]]:
        """Return incarnation and station of the simulators that hold blocks and have no work of the ledger."""
        return [
            (each.incarnation, each.station) for each in self._simulators.values() if each.holds and not each.joined
        ]

    def send(self, name: str, block: int, attempt: int, now: float) -> str:
        """Note that a block is sent to a simulator; return its incarnation, or "" if it has gone."""
        simulator = self._simulators.get(name)
        if simulator is None or not simulator.joined:
            self._emit(Refused(name, block, attempt, "gone"))
            return ""
        simulator.sent[Attempt(block, attempt)] = _Sent(now)
        return simulator.incarnation

    def _has_ended(self, known: _Simulator, now: float) -> bool:
        """Return whether a simulator is silent, or its process does not exist any more."""
        silent = now - known.heard
        return silent > SILENT_S or (silent > RECENT_S and is_gone(known.host, known.pid, self._host))

    def _warn_of_double(self, name: str, message: Any, known: _Simulator) -> None:
        if message.incarnation not in self._doubles and len(self._doubles) < MAX_SIMULATORS:
            self._doubles.add(message.incarnation)
            self._log_warning(
                f"{name} is there twice: process {message.pid} on {message.host} gets no work as long as process "
                f"{known.pid} on {known.host} runs; give it another name (-r __node:=NAME)"
            )

    def _compare(self, name: str, known: _Simulator, refused: set[Attempt], now: float) -> None:
        """Compare what was sent to a simulator with what its heartbeat lists."""
        for attempt, sent in list(known.sent.items()):
            if attempt in known.holds:
                sent.taken = True
            elif sent.taken and attempt not in refused:
                del known.sent[attempt]
                known.pause = 0.0
                self._emit(Finished(name, *attempt))
        for attempt, sent in list(known.sent.items()):
            if attempt in refused or (attempt not in known.holds and now - sent.at > TAKEN_S):
                why = "refused" if attempt in refused else f"not taken within {TAKEN_S:g} s"
                self._pause(name, known, f"block {attempt.block}, attempt {attempt.attempt} {why}", now)
                return

    def _pause(self, name: str, known: _Simulator, why: str, now: float) -> None:
        """Give no work for a while to a simulator that does not compute a block; all its blocks are due again."""
        known.pause = min(max(2 * known.pause, FIRST_PAUSE_S), LONGEST_PAUSE_S)
        known.resume_at = now + known.pause
        self._log_warning(f"{name}: {why}; its log says more")
        self._release(name, why, blame=False)

    @staticmethod
    def _can_join(simulator: _Simulator, now: float) -> bool:
        idle = simulator.ready and not simulator.joined and not simulator.holds
        return idle and now >= simulator.resume_at

    def _release(self, name: str, why: str, *, blame: bool) -> None:
        """Take a simulator out of the ledger: its blocks go to others."""
        simulator = self._simulators[name]
        if simulator.joined:
            simulator.joined = False
            simulator.sent.clear()
            self._emit(SimulatorLost(name, why, blame))

    def _forget(self, name: str, why: str, *, blame: bool) -> None:
        self._release(name, why, blame=blame)
        del self._simulators[name]


def _attempts(blocks: Any, attempts: Any) -> set[Attempt]:
    """Return the attempts that two lists of a heartbeat describe; the longer list is cut."""
    return {Attempt(*pair) for pair in zip(blocks, attempts, strict=False)}
