"""The runs of a measured string: samples in; plans, stream messages and lines for the log out. No ROS, no clock.

A measured string takes the places of coordinator and simulator. Each stretch of the signal is a run of one cell and one
block, whose chunks go out as those of a simulator do. So classifier, recorder, replay and verification need to know
nothing of it, but that the last plan of the run says how long it was.
"""

from __future__ import annotations

import hashlib
from collections import deque
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np

from bow_classifier.measured.listening import PAUSE_S, Begin, End, Listener
from bow_classifier.measured.pieces import Piece
from bow_classifier.measured.tuning import CORNER, Given, Tuning
from bow_classifier.verdict.regimes import HELMHOLTZ, REGIMES, is_helmholtz
from bow_classifier.verdict.thresholds import Thresholds
from bow_sim.physics.parameters import CHUNK_PERIODS, Parameters
from bow_sim.protocol import cdr
from bow_sim.protocol.flow_control import Window
from bow_sim.protocol.identity import random_id
from bow_sim.protocol.measured import MEASURED
from bow_sim.protocol.states import BlockState, PlanState, ReceiptKind

LONGEST_S = 600.0
"""A stretch that lasts longer goes on in another run: what the classifier keeps of a run grows with it."""

PATIENCE_S = 15.0
"""How long a run waits for its readers when it opens, and for the recorder when it closes."""

STEADY_TESTS = 4
"""Tests in a row with one regime after which the log names it."""

AXES = ("f_asym", "f_init_ratio")
"""The axes of the map of one cell; a measured string has no such parameters, and they say nothing."""


class Out(NamedTuple):
    """A message to publish, or a line for the log where `topic` is "log" or "warning"."""

    topic: str
    data: bytes | str


@dataclass
class _Run:
    tuning: Tuning
    string: Parameters
    run_id: str = field(default_factory=random_id)
    pieces: deque[Piece] = field(default_factory=deque)
    window: Window = field(default_factory=Window)
    sent: int = 0
    recorder: bool = False  # whether there was one when it opened
    announced: float | None = None
    opened: bool = False
    ended: str = ""
    closing: float | None = None
    on_disk: bool = False

    @property
    def sweep_id(self) -> str:
        return hashlib.sha256(self.run_id.encode()).hexdigest()[:16]

    @property
    def longest(self) -> int:
        return int(LONGEST_S * self.tuning.f0 / CHUNK_PERIODS) + 1


class Session:
    """The runs of a measured string, one after another.

    Parameters
    ----------
    source
        Name of the topic, for people.
    given
        What is known of the string.
    incarnation
        Of the node.
    level, pause
        As for :class:`~bow_classifier.measured.listening.Listener`.

    Attributes
    ----------
    out
        What to publish, and lines for the log; the caller removes them with ``popleft``.
    """

    def __init__(self, source: str, given: Given, incarnation: str, level: float = 0.0, pause: float = PAUSE_S) -> None:
        self._source, self._given, self._incarnation = source, given, incarnation
        self._listener = Listener(given, level, pause)
        self._thresholds = Thresholds(corner=CORNER)
        self._runs: deque[_Run] = deque()
        self.out: deque[Out] = deque()
        self._latest, self._named = (-1, 0), -1  # regime, and how many tests in a row; regime that the log named

    @property
    def run_id(self) -> str:
        """Of the run in progress; "" without one."""
        return self._runs[0].run_id if self._runs else ""

    @property
    def state(self) -> str:
        """What is done, in words."""
        return self._listener.state

    # ---- the signal

    def take(self, samples: np.ndarray, now: float) -> None:
        """Take in samples, float64, that came at `now`, seconds."""
        self._follow(self._listener.take(samples, now))

    def lose(self, what: str) -> None:
        """Take note that samples were lost."""
        self.out.append(Out("warning", what))
        self._follow(self._listener.end(what))

    def _follow(self, events: Iterator[Begin | Piece | End]) -> None:
        for event in events:
            match event:
                case Begin(tuning):
                    self._begin(tuning)
                case End(why):
                    self._runs[-1].ended = why
                case piece:
                    self._runs[-1].pieces.append(piece)
        while self._listener.complaints:
            self.out.append(Out("warning", f"{self._source}: {self._listener.complaints.popleft()}"))

    def _begin(self, tuning: Tuning) -> None:
        string = Parameters(
            sample_rate=tuning.f0 * tuning.period,
            period=tuning.period,
            bow_bridge=tuning.delay,
            periods=CHUNK_PERIODS * (int(LONGEST_S * tuning.f0 / CHUNK_PERIODS) + 1),
        )
        self._runs.append(_Run(tuning, string))

    # ---- answers

    def verdicts(self, values: Mapping[str, Any], now: float) -> None:
        """Take in decoded verdicts of the run in progress."""
        if not self._runs or values["run_id"] != self.run_id:
            return
        run = self._runs[0]
        run.window.answered((0, values["chunk"]), now, judged=True)
        code = int(values["regime"][0])
        regime = HELMHOLTZ if is_helmholtz(code) else code  # extra slips cannot be told from a force alone
        count = self._latest[1] + 1 if regime == self._latest[0] else 1
        self._latest = (regime, count)
        if count == STEADY_TESTS and regime != self._named:
            self._named = regime
            seconds = (values["chunk"] + 1 - STEADY_TESTS) * CHUNK_PERIODS / run.tuning.f0
            self.out.append(Out("log", f"{seconds:.2f} s: {REGIMES[regime].replace('_', ' ')}"))

    def receipt(self, values: Mapping[str, Any], now: float) -> None:
        """Take in a decoded Receipt."""
        if not self._runs or values["run_id"] != self.run_id:
            return
        run = self._runs[0]
        for kind, chunk in zip(values["kind"].tolist(), values["chunk"].tolist(), strict=True):
            if kind == ReceiptKind.BLOCK:
                run.on_disk = True
            elif kind == ReceiptKind.STREAMS:
                run.window.answered((0, chunk), now, receipted=True)

    # ---- time

    def pass_time(self, now: float, recorder: bool, missing: Callable[[str, bool], list[str]], stamp: int) -> None:
        """Go on with the runs.

        Parameters
        ----------
        now
            Seconds.
        recorder
            Whether a recorder is alive.
        missing
            Takes a run_id, and whether it has a recorder; returns which readers do not hear the streams yet.
        stamp
            Nanoseconds since 1970.
        """
        self._follow(self._listener.pass_time(now))
        if not self._runs:
            return
        run = self._runs[0]
        if not run.opened:
            self._open(run, now, recorder, missing)
        elif run.closing is None:
            self._send(run, now, recorder, stamp)
        else:
            self._close(run, now, recorder)

    def stop(self) -> None:
        """End the stretch in progress: the node is told to stop."""
        self._follow(self._listener.end("the node was told to stop"))

    def give_up(self) -> None:
        """Close the runs that are left: the node ends, and what is not answered will not be."""
        while self._runs:
            run = self._runs.popleft()
            if run.announced is not None:
                self._plan(run, PlanState.CLOSED, BlockState.QUARANTINED)
                what = f"{len(run.window)} tests and {len(run.pieces)} chunks without an answer"
                self.out.append(Out("warning", f"run {run.run_id} is given up: {what}"))

    def _open(self, run: _Run, now: float, recorder: bool, missing: Callable[[str, bool], list[str]]) -> None:
        if run.announced is None:  # when it becomes the first
            run.announced, run.recorder = now, recorder
            self._latest, self._named = (-1, 0), -1
            self._plan(run)
            self.out.append(Out("log", f"run {run.run_id} opens: {self._about(run)}"))
        lacking = missing(run.run_id, run.recorder)
        if lacking and now - run.announced < PATIENCE_S:
            return
        if lacking:
            self.out.append(Out("warning", f"run {run.run_id} begins all the same: {', '.join(lacking)}"))
            run.recorder = False
        run.opened = True

    def _send(self, run: _Run, now: float, recorder: bool, stamp: int) -> None:
        if not recorder:
            run.recorder = False
        for unanswered in run.window.overdue(now):
            self._publish(unanswered)
        while run.pieces and not run.window.full and run.sent < run.longest:
            messages = self._messages(run, run.pieces.popleft(), stamp)
            run.window.sent((0, run.sent), messages, now)
            run.sent += 1
            self._publish(messages)
        if not run.recorder:
            for chunk in range(max(0, run.sent - 2 * run.window.limit), run.sent):
                run.window.answered((0, chunk), now, receipted=True)
        if not run.ended and (run.sent >= run.longest or (recorder and not run.recorder)):
            self._split(run, f"longer than {LONGEST_S:g} s" if run.sent >= run.longest else "a recorder has come")
        if run.ended and not run.pieces and not len(run.window):
            if run.sent:
                run.string = run.string.replace(periods=CHUNK_PERIODS * run.sent)
                self._plan(run)
            run.closing = now

    def _split(self, run: _Run, why: str) -> None:
        """Go on with a stretch in another run."""
        self._begin(run.tuning)
        self._runs[-1].pieces, run.pieces, run.ended = run.pieces, deque(), why

    def _close(self, run: _Run, now: float, recorder: bool) -> None:
        assert run.closing is not None
        waits = run.recorder and recorder and run.sent > 0 and not run.on_disk
        if waits and now - run.closing < PATIENCE_S:
            return
        if waits:
            self.out.append(Out("warning", f"run {run.run_id}: the recorder does not say that it is on the disk"))
        done = BlockState.DONE if run.sent else BlockState.QUARANTINED
        self._plan(run, PlanState.CLOSED, done)
        seconds = run.sent * CHUNK_PERIODS / run.tuning.f0
        what = "" if run.recorder else "; not recorded"
        self.out.append(Out("log", f"run {run.run_id} closes: {run.ended}; {run.sent} tests, {seconds:.1f} s{what}"))
        self._runs.popleft()

    # ---- messages

    def _about(self, run: _Run) -> str:
        """Return in words what is measured."""
        found, given = run.tuning, self._given
        return (
            f"measured {self._source}: {given.sample_rate:g} Hz, f0 {found.f0:.2f} Hz, beta {found.beta:.3f}, "
            f"polarity {found.sign:+.0f}"
        )

    def _plan(self, run: _Run, state: PlanState = PlanState.OPEN, block: BlockState = BlockState.OUTSTANDING) -> None:
        values = {
            "run_id": run.run_id,
            "sweep_id": run.sweep_id,
            "epoch": 1,
            "state": state,
            "spec.preset": MEASURED,
            "spec.settings": settings_of(run.string, self._thresholds),
            "fingerprint": self._about(run),
            "classifier": self._thresholds.hash,
            "block_states": [block],
            "rounds": [],
            "incarnation": self._incarnation,
        }
        self.out.append(Out("plan", cdr.encode("Plan", values)))

    def _messages(self, run: _Run, piece: Piece, stamp: int) -> dict[str, bytes]:
        chunk, samples = run.sent, run.tuning.samples
        identity = {"run_id": run.run_id, "sweep_id": run.sweep_id, "block": 0, "chunk": chunk, "attempt": 1}
        common = {**identity, "incarnation": self._incarnation, "cells": (0,), "samples": samples}
        common |= {"first_sample": chunk * samples, "stamp": stamp, "header.stamp": stamp}
        slips = piece.slips._asdict()
        if not chunk:
            slips["slipping"] = np.zeros(1, np.uint8)  # what was before the run is not known to its readers
        force = cdr.encode("BridgeForce", {**common, "data": piece.force})
        return {"bridge_force": force, "stick_slip": cdr.encode("StickSlip", {**common, **slips})}

    def _publish(self, messages: Mapping[str, cdr.Buffer]) -> None:
        self.out.extend(Out(topic, bytes(data)) for topic, data in messages.items())


def settings_of(string: Parameters, thresholds: Thresholds) -> tuple[str, ...]:
    """Return the complete settings of the plan of a measured string, sorted."""
    lines = [line for line in string.settings() if not line.startswith(tuple(f"{name}=" for name in AXES))]
    for key, name in zip("xy", AXES, strict=True):
        value = getattr(string, name)
        axis = {"name": name, "scale": "linear", "first": value, "last": value, "count": 1}
        lines += [f"{key}.{part}={text}" for part, text in axis.items()]
    lines += [f"classifier.{line}" for line in thresholds.settings()]
    return tuple(sorted([*lines, "block_cells=1"]))
