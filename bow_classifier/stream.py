"""The classifier without ROS (DESIGN.md): stream messages in, verdict messages out.

The node passes it messages from DDS, replay and verify those of a bag. Of each block it classifies only the next
expected chunk, from any attempt. An earlier chunk is answered again with the first answer; a later one, and messages
that do not belong to the sweep, are counted and ignored. Its memory is bounded: the state of a block is deleted when
the plan reports that the block is settled, and messages wait for their other half only up to `AHEAD` chunks ahead.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from typing import Any, NamedTuple

import numpy as np

from bow_classifier.block_classifier import BlockClassifier, Verdicts
from bow_classifier.features.slips import Intervals
from bow_classifier.task import Task
from bow_sim.physics.errors import ParameterError
from bow_sim.protocol import cdr
from bow_sim.protocol.cdr_in_place import Template
from bow_sim.protocol.states import BlockState, PlanState
from bow_sim.protocol.sweep_outline import SweepOutline

FORCE, SLIP = "BridgeForce", "StickSlip"
"""The two messages of a chunk."""

AHEAD = 64
"""Chunks of a block that may wait for the message of the other topic: twice as many as a simulator may have under way.
The topics are delivered separately; one can be ahead of the other."""

COMPLAINTS = 100
"""Largest number of complaints kept; the oldest are deleted first."""


class Refused(Exception):
    """A message is ignored; the text gives the reason."""


@dataclass
class Counts:
    """Counts since the start, as in the message Health; `nondeterministic`: duplicates with other content."""

    messages: int = 0
    bytes: int = 0
    judged: int = 0
    duplicates: int = 0
    ignored: int = 0
    nondeterministic: int = 0


class _Half(NamedTuple):
    values: Mapping[str, Any]
    attempts: list[int]  # that sent it while it waited: each gets an answer


class _Answer(NamedTuple):
    checksums: Mapping[str, int]  # of the two messages
    numbers: Mapping[str, int]  # of the message Verdicts, without the attempt
    verdicts: Verdicts


@dataclass
class _Block:
    classifier: BlockClassifier | None
    messages: Template  # of its verdicts
    waiting: dict[str, dict[int, _Half]] = field(default_factory=lambda: {FORCE: {}, SLIP: {}})
    answers: list[_Answer] = field(default_factory=list)  # by chunk

    @property
    def next(self) -> int:
        return len(self.answers)


class Classifier:
    """Classifies the chunks of the sweep in progress.

    Parameters
    ----------
    incarnation
        Identifies this classifier in its verdicts.

    Attributes
    ----------
    task
        The sweep in progress; None if there is none, or none that can be classified.
    problem
        Why the announced sweep cannot be classified; "" if nothing is wrong.
    counts
        Counts of messages.
    complaints
        Why messages were ignored, for the log: the latest `COMPLAINTS` lines; remove them with ``popleft``.
    senders
        Message name and sender's incarnation of the messages taken; the caller clears it after reading.
    """

    def __init__(self, incarnation: str) -> None:
        self.incarnation = incarnation
        self.task: Task | None = None
        self.problem = ""
        self.counts = Counts()
        self.complaints: deque[str] = deque(maxlen=COMPLAINTS)
        self.senders: set[tuple[str, str]] = set()
        self._plan = ("", "", "", -1)
        self._blocks: dict[int, _Block] = {}
        self._settled: frozenset[int] = frozenset()

    def open(self, task: Task | None) -> None:
        """Begin another sweep, or none; what is known of the one before is forgotten."""
        self.task, self.problem = task, ""
        self._blocks, self._settled = {}, frozenset()

    def settle(self, blocks: Iterable[int]) -> None:
        """Delete the state of `blocks`, all that are done or given up; their messages are ignored from now on."""
        self._settled = frozenset(blocks)
        for block in self._settled & self._blocks.keys():
            del self._blocks[block]

    def plan(self, data: cdr.Buffer) -> None:
        """Take a Plan message: the sweep it opens or closes, and which blocks are settled.

        A plan of the sweep in progress with an older epoch comes from a coordinator that is no longer in charge.
        """
        try:
            plan = cdr.decode("Plan", data)
        except cdr.WireError as error:
            self.complain(f"plan ignored: {error}")
            return
        name, epoch = (plan["run_id"], plan["sweep_id"], plan["classifier"]), plan["epoch"]
        if plan["state"] != PlanState.OPEN:
            if self._plan[0] == plan["run_id"]:
                self._plan = ("", "", "", -1)
                self.open(None)
            return
        if self._plan[:3] == name and epoch < self._plan[3]:
            self.complain(f"plan of epoch {epoch} ignored: epoch {self._plan[3]} is in charge")
            return
        if self._plan[:3] != name:
            self.open(None)
            try:
                task = Task.of(SweepOutline.of(plan))
                self.problem = task.objection
                self.task = None if self.problem else task
            except ParameterError as error:
                self.problem = str(error)
        elif self.task is not None and len(plan["rounds"]):
            try:
                self.task = replace(self.task, outline=self.task.outline.grown(plan["rounds"]))
            except ParameterError as error:
                self.complain(f"plan ignored: {error}")
                return
        self._plan = (*name, epoch)
        self.settle(np.flatnonzero(plan["block_states"] != BlockState.OUTSTANDING).tolist())

    def take(self, name: str, data: cdr.Buffer) -> list[bytes]:
        """Take one message of a stream; return the verdicts to publish, in order.

        Parameters
        ----------
        name
            "BridgeForce" or "StickSlip".
        data
            The message as CDR bytes; it must not change later, as it may be kept.
        """
        self.counts.messages += 1
        self.counts.bytes += len(data)
        try:
            values = self._check(name, data)
            self.senders.add((name, values["incarnation"]))
            block = self._blocks.get(values["block"])
            if block is None:
                block = self._blocks[values["block"]] = self._new_block(values["block"])
            if values["chunk"] < block.next:
                return self._answer_again(name, values, block)
            self._hold(name, values, block)
            return self._classify_complete(values["block"], block)
        except (cdr.WireError, Refused) as error:
            self.complain(f"ignored: {error}")
            return []

    def complain(self, text: str) -> None:
        """Count a message that is ignored, and keep the reason."""
        self.counts.ignored += 1
        self.complaints.append(text)

    def _new_block(self, block: int) -> _Block:
        task = self.task
        assert task is not None
        cells = task.outline.block(block)
        common = {
            "run_id": task.outline.run_id,
            "sweep_id": task.outline.sweep_id,
            "block": block,
            "incarnation": self.incarnation,
            "classifier": task.thresholds.hash,
            "cells": cells,
        }
        return _Block(task.block_classifier(cells), Template("Verdicts", common))

    def _check(self, name: str, data: cdr.Buffer) -> dict[str, Any]:
        """Return the fields of a message of the sweep in progress.

        Raises
        ------
        WireError, Refused
            Where the message is damaged, or does not belong to this sweep.
        """
        values = cdr.unseal(name, data, check_intervals=False)  # they are checked when they are counted
        if self.task is None:
            reason = "no sweep is open"
        else:
            settled = "the block is settled" if values["block"] in self._settled else ""
            reason = self.task.outline.objection(name, values) or settled
        if reason:
            raise Refused(f"{name} of block {values['block']}, chunk {values['chunk']}: {reason}")
        return values

    def _compare(self, name: str, values: Mapping[str, Any], first: int) -> None:
        """Count a duplicate; all attempts of a block should send the same bytes."""
        self.counts.duplicates += 1
        if values["checksum"] != first:
            self.counts.nondeterministic += 1
            self.complaints.append(
                f"{name} of block {values['block']}, chunk {values['chunk']}, attempt {values['attempt']}: "
                f"checksum {values['checksum']:016x}, was {first:016x} before: not deterministic"
            )

    def _answer_again(self, name: str, values: Mapping[str, Any], block: _Block) -> list[bytes]:
        """Answer a chunk that is already classified, once for its two messages."""
        answer = block.answers[values["chunk"]]
        self._compare(name, values, answer.checksums[name])
        return [_message(block, answer, values["attempt"])] if name == SLIP else []

    def _hold(self, name: str, values: Mapping[str, Any], block: _Block) -> None:
        """Keep one message of a chunk until the other arrives, if no earlier chunk is missing on its topic."""
        waiting, chunk = block.waiting[name], values["chunk"]
        if chunk in waiting:
            self._compare(name, values, waiting[chunk].values["checksum"])
            if values["attempt"] not in waiting[chunk].attempts:
                waiting[chunk].attempts.append(values["attempt"])
            return
        if (chunk > block.next and chunk - 1 not in waiting) or chunk >= block.next + AHEAD:
            raise Refused(f"{name} of block {values['block']}, chunk {chunk}: chunk {block.next} comes first")
        waiting[chunk] = _Half(values, [values["attempt"]])

    def _classify_complete(self, number: int, block: _Block) -> list[bytes]:
        out: list[bytes] = []
        while block.classifier and block.next in block.waiting[FORCE] and block.next in block.waiting[SLIP]:
            force = block.waiting[FORCE][block.next].values
            slip, attempts = block.waiting[SLIP].pop(block.next)
            window = (len(force["cells"]), force["samples"])
            try:
                intervals = Intervals(*(slip[name] for name in Intervals._fields))
                verdicts = block.classifier.classify(force["data"].reshape(window), intervals)
            except ValueError as error:  # this message is wrong; another attempt may send a right one
                self.complain(f"StickSlip of block {number}, chunk {block.next} ignored: {error}")
                break
            checksums = {FORCE: force["checksum"], SLIP: slip["checksum"]}
            numbers = {
                "header.stamp": force["stamp"],
                "chunk": block.next,
                "chunk_checksum": cdr.chunk_checksum(number, block.next, *checksums.values()),
            }
            answer = _Answer(checksums, numbers, verdicts)
            del block.waiting[FORCE][block.next]
            block.answers.append(answer)
            self.counts.judged += 1
            out += [_message(block, answer, attempt) for attempt in attempts]
            if self.task and block.next == self.task.outline.chunks:
                block.classifier = None
        return out


def _message(block: _Block, answer: _Answer, attempt: int) -> bytes:
    return bytes(block.messages.write({**answer.numbers, "attempt": attempt}, answer.verdicts)[0])
