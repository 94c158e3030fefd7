"""The simulators that a coordinator knows, by their heartbeats: who is ready, and holds which blocks. No ROS, no clock.

A block is sent as a message and may be lost; what a simulator holds it says in every heartbeat. So what was sent and is
not taken in time is due again, and what was held and is no longer has ended, whoever missed which message.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

from bow_sim.protocol.neighbours import BUSY, CLOSED, DEAD, LEFT, READY, SILENT_S, is_gone
from bow_sweep.run.ledger import Event, Finished, Refused, SimulatorLost, SimulatorReady

TAKEN_S = 3.0
"""A simulator has this long to take a block that was sent to it."""

FIRST_PAUSE_S, LONGEST_PAUSE_S = 0.5, 8.0
"""A simulator that refuses a block gets no other for so long, twice as long each time."""

MOST = 4096
"""Simulators at most that are known: anybody may speak on a topic."""

SPOKE_S = 1.5
"""Nobody looks after the process of a simulator that was heard so recently."""


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
    listed: bool = False
    pause: float = 0.0
    resume_at: float = 0.0
    holds: set[tuple[int, int]] = field(default_factory=set)
    sent: dict[tuple[int, int], _Sent] = field(default_factory=dict)


class Pool:
    """Turns what becomes of simulators into events of the ledger.

    Parameters
    ----------
    emit
        Takes each event.
    host
        Of this machine: whether a silent process has ended can be seen there.
    complain
        Takes a line for people.
    """

    def __init__(self, emit: Callable[[Event], None], host: str, complain: Callable[[str], object]) -> None:
        self._emit, self._host, self._complain = emit, host, complain
        self._simulators: dict[str, _Simulator] = {}
        self._doubles: set[str] = set()

    def begin(self) -> None:
        """Begin a run: nobody is in its ledger yet, and what was heard before says nothing of it."""
        for simulator in self._simulators.values():
            simulator.ready = simulator.listed = False
            simulator.sent.clear()

    def on_health(self, message: Any, run_id: str, hears_us: bool, now: float) -> None:
        """Take in a simulator's heartbeat, or its supervisor's word that its process has ended.

        Parameters
        ----------
        message
            The Health.
        run_id
            Of the run in progress; "" for none.
        hears_us
            Whether blocks arrive there.
        now
            Seconds.
        """
        name = message.node
        known = self._simulators.get(name)
        if message.state == DEAD:
            if known is not None and (known.host, known.pid) == (message.host, message.pid):
                self._drop(name, message.detail, blame=True)
            return
        if message.state == CLOSED and message.detail == LEFT:
            if known is not None and known.incarnation == message.incarnation:
                self._drop(name, LEFT, blame=False)
            return
        if known is not None and known.incarnation != message.incarnation:
            if not self._has_ended(known, now):
                self._note_double(name, message, known)
                return
            self._drop(name, "restarted", blame=True)
            known = None
        if known is None:
            if len(self._simulators) >= MOST:
                return
            known = self._simulators[name] = _Simulator(message.incarnation, message.host, message.pid, now)
        known.heard = now
        known.holds = set(zip(message.held_blocks, message.held_attempts, strict=False))
        working = message.run_id == run_id and message.state in (READY, BUSY)
        known.ready = working and hears_us
        if not working:
            self._lose(name, message.detail or "not ready", blame=False)
        elif known.listed:
            refused = set(zip(message.refused_blocks, message.refused_attempts, strict=False))
            self._compare(name, known, refused, now)

    def _has_ended(self, known: _Simulator, now: float) -> bool:
        """Return whether a simulator is silent, or its process seen to be gone."""
        silent = now - known.heard
        return silent > SILENT_S or (silent > SPOKE_S and is_gone(known.host, known.pid, self._host))

    def _note_double(self, name: str, message: Any, known: _Simulator) -> None:
        if message.incarnation not in self._doubles and len(self._doubles) < MOST:
            self._doubles.add(message.incarnation)
            self._complain(
                f"{name} is there twice: process {message.pid} on {message.host} gets no work as long as process "
                f"{known.pid} on {known.host} lives; give it another name (-r __node:=NAME)"
            )

    def _compare(self, name: str, known: _Simulator, refused: set[tuple[int, int]], now: float) -> None:
        """Hold what was sent to a simulator against what it says."""
        for key, sent in list(known.sent.items()):
            if key in known.holds:
                sent.taken = True
            elif sent.taken and key not in refused:
                del known.sent[key]
                known.pause = 0.0
                self._emit(Finished(name, *key))
        for key, sent in list(known.sent.items()):
            if key in refused or (key not in known.holds and now - sent.at > TAKEN_S):
                why = "refused" if key in refused else f"not taken within {TAKEN_S:g} s"
                self._refuse(name, known, key, why, now)
                return

    def _refuse(self, name: str, known: _Simulator, key: tuple[int, int], why: str, now: float) -> None:
        """Let a simulator pause that does not compute a block; all that it was to compute is due again."""
        known.pause = min(max(2 * known.pause, FIRST_PAUSE_S), LONGEST_PAUSE_S)
        known.resume_at = now + known.pause
        self._complain(f"{name}: block {key[0]}, attempt {key[1]} {why}; its log says more")
        self._lose(name, f"block {key[0]}, attempt {key[1]} {why}", blame=False)

    def look(self, now: float, may_join: bool) -> None:
        """Miss silent simulators, and where `may_join` offer those that are ready; call a few times a second."""
        for name, simulator in list(self._simulators.items()):
            silent = now - simulator.heard
            if self._has_ended(simulator, now):
                # One of this machine that has not ended is stopped or stuck: that is not its block's doing.
                there = simulator.host == self._host and not is_gone(simulator.host, simulator.pid, self._host)
                why = f"silent for {silent:.0f} s" if silent > SILENT_S else "its process has ended"
                self._drop(name, why, blame=not there)
            elif may_join and self._can_join(simulator, now):
                simulator.listed = True
                simulator.sent.clear()
                self._emit(SimulatorReady(name))

    @staticmethod
    def _can_join(simulator: _Simulator, now: float) -> bool:
        free = simulator.ready and not simulator.listed and not simulator.holds
        return free and now >= simulator.resume_at

    def send(self, name: str, block: int, attempt: int, now: float) -> str:
        """Note that a block is sent to a simulator; return its incarnation, "" where it is gone."""
        simulator = self._simulators.get(name)
        if simulator is None or not simulator.listed:
            self._emit(Refused(name, block, attempt, "gone"))
            return ""
        simulator.sent[block, attempt] = _Sent(now)
        return simulator.incarnation

    def _lose(self, name: str, why: str, *, blame: bool) -> None:
        simulator = self._simulators[name]
        if simulator.listed:
            simulator.listed = False
            simulator.sent.clear()
            self._emit(SimulatorLost(name, why, blame))

    def _drop(self, name: str, why: str, *, blame: bool) -> None:
        self._lose(name, why, blame=blame)
        del self._simulators[name]
