"""One run being recorded: which messages enter the bag, and which receipts answer them. No ROS: bytes in, receipts out.

A receipt is written into the same chunk of the file as the messages that it confirms, before it is published: either
both are in the bag or neither is. When a whole block is in the file, the file is synced to the disk, and another
receipt confirms that.
"""

from __future__ import annotations

import os
import struct
from collections import Counter
from collections.abc import Iterable, Mapping
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import numpy as np

from bow_sim.atomic_files import sync_directory
from bow_sim.physics.errors import ParameterError
from bow_sim.protocol import cdr
from bow_sim.protocol.measured import is_measured
from bow_sim.protocol.messages import STREAMS
from bow_sim.protocol.states import PlanState, ReceiptKind
from bow_sim.protocol.sweep_outline import SweepOutline
from bow_sweep.record.bag import BagError, BagWriter, bag_folder
from bow_sweep.record.bag_contents import RunIdentity
from bow_sweep.record.deduplication import Answer, StoredMessages
from bow_sweep.record.disk import DiskSync
from bow_sweep.record.inspection import Inspection
from bow_sweep.record.metadata import FileInfo
from bow_sweep.record.notes import custom_data, how, note
from bow_sweep.record.recover import repair
from bow_sweep.record.schema import type_hash
from bow_sweep.record.topics import NAMESPACE, STORED_ONCE, TOPICS, Topic, full_names
from bow_sweep.run.lock import locked, recorder_of

COMMIT_BYTES = 4 << 20
"""A chunk of the file is written when it has this many bytes."""

COMMIT_S = 0.02
"""Messages are written after this many seconds, however few they are."""

RUN_OF = {"inspect": "InspectedCell", "basin_map": "BasinMap", "blocks": "Block"}
"""Topic -> message type, as :mod:`bow_sim.protocol.cdr` names it, of other messages that state their run."""


class AlreadyClosedError(BagError):
    """The bag ends with this very plan: there is nothing to record."""


class Session:
    """The bag of one run, open for writing.

    Parameters
    ----------
    directory
        Run directory; created if it is missing, and locked as long as the session lasts.
    plan, data
        The Plan that opens it, decoded and as bytes.
    incarnation
        Of the recorder.
    now
        Nanoseconds since 1970.
    sync
        Confirm a block only when it is on the disk; otherwise, when it is in the file.
    lock
        Lock the directory; not possible on file systems without locks.
    station
        Whose bag it is, see :mod:`bow_sim.protocol.stations`.

    Attributes
    ----------
    names
        Key of `TOPICS` -> full name of the topic in the bag.
    stored
        The stream messages and verdicts in the bag.
    messages, bytes
        Recorded in this session.
    passed
        Stream messages that came in this session and are not to be recorded, see :mod:`bow_sim.protocol.recording`.
    ignored
        Number of messages that are not of this run or cannot be decoded.
    complaints
        What is wrong with ignored or contradicting messages -> how often that came.
    senders
        (topic, incarnation) of the messages taken; the caller clears it.
    report
        Of the repair of the bag, see :func:`bow_sweep.record.recover.recover`.

    Raises
    ------
    ParameterError
        Where the plan cannot be run.
    BagError
        Where the bag is of another run, or the plan closes what was closed before (AlreadyClosedError).
    LockError
        Where another recorder writes it (LockedError), or the directory cannot be locked.
    OSError
        Where it cannot be written.
    """

    def __init__(
        self,
        directory: Path,
        plan: Mapping[str, Any],
        data: bytes,
        incarnation: str,
        now: int,
        *,
        sync: bool = True,
        lock: bool = True,
        station: str = "",
    ) -> None:
        self.directory = directory
        self.folder = folder = bag_folder(directory, station)
        self.expected = SweepOutline.of(plan)
        self.stored = StoredMessages()
        self.incarnation = incarnation
        self.messages = self.bytes = self.ignored = self.passed = 0
        self.complaints: Counter[str] = Counter()
        self.senders: set[tuple[str, str]] = set()
        self.last_plan: dict[str, Any] = {}
        self._answers: list[Answer] = []
        self._whole: dict[int, int] = {}  # block -> attempt that completed it, since the last commit
        self._on_disk: dict[int, int] = {}  # block -> attempt that completed it
        self._disk: DiskSync | None = None
        with ExitStack() as stack:
            directory.mkdir(parents=True, exist_ok=True)
            sync_directory(directory.parent)
            stack.enter_context(locked(directory, recorder_of(station), lock))
            identity = RunIdentity(self.expected.run_id, self.expected.sweep_id)
            self.report, found = repair(folder, identity, resuming=True)
            self.last_plan = found.survey.plan
            if self.closed and plan["epoch"] <= self.last_plan["epoch"]:  # only a new epoch reopens a finished run
                raise AlreadyClosedError(f"{folder} is closed")
            self._restore(found, sync)
            self.names = _names(found.survey.files, self.expected.run_id)
            topics: dict[str, Topic] = {self.names[name]: topic for name, topic in TOPICS.items()}
            notes = [how(*identity), *([note(found.missing, _why(self.report))] if found.missing else [])]
            files, last = found.survey.files, found.survey.last or 0
            self.bag = BagWriter(folder, topics, files, last, notes, custom_data(*identity))
            stack.callback(self.bag.abandon)
            if sync:
                self._disk = DiskSync(self.bag.fileno())
                stack.callback(self._disk.close)
            self.plan(plan, data, now)
            self._stack = stack.pop_all()

    def _restore(self, found: Inspection, sync: bool) -> None:
        """Take in the messages that are in the bag already, after a sync; answer for complete blocks."""
        survey = found.survey
        for file in survey.files if sync else ():
            with open(self.folder / file.name, "rb") as stream:
                os.fdatasync(stream.fileno())
        for topic, places in survey.places.items():
            due = self.expected.recorded_chunks
            self.stored.restore(topic, {key: place.checksum for key, place in places.items() if key[1] in due})
        self.stored.restore("verdicts", {key: verdict.checksum for key, verdict in survey.verdicts.items()})
        self._on_disk = {block: attempt for block, attempt in survey.attempts.items() if self._is_whole(block)}
        unanswered = [block for block in self._on_disk if (ReceiptKind.BLOCK, block, 0) not in survey.receipts]
        self._answer_blocks({block: self._on_disk[block] for block in sorted(unanswered)})

    def _is_whole(self, block: int) -> bool:
        streams = len(STREAMS) * len(self.expected.recorded_chunks)
        return self.stored.count(block) == streams + self.expected.chunks

    def _answer_blocks(self, attempts: Mapping[int, int]) -> None:
        """Confirm in the next receipt that blocks are on the disk."""
        self._answers += [Answer(ReceiptKind.BLOCK, block, 0, attempt, 0) for block, attempt in attempts.items()]

    @property
    def closed(self) -> bool:
        """Whether the latest plan states that no more messages will come."""
        return bool(self.last_plan.get("state") == PlanState.CLOSED)

    @property
    def full(self) -> bool:
        """Whether so much is pending that it should be committed at once."""
        return self.bag.pending >= COMMIT_BYTES

    # ---- messages in

    def plan(self, plan: Mapping[str, Any], data: bytes, now: int) -> None:
        """Take in a plan of this run. A closing one is kept until the end: it is the last message of the bag."""
        try:
            self.expected = self.expected.followed(plan)
        except ParameterError as error:
            self.ignored += 1
            self.complaints[f"plan: {error}"] += 1
            return
        self.last_plan = dict(plan)
        if is_measured(plan) and self._is_whole(0):  # only now it is known how long it is
            self._whole.setdefault(0, 1)
        if self.closed:
            self._closing = data
        else:
            self._add("plan", data, now)

    def take(self, topic: str, data: bytes, now: int) -> None:
        """Take in a message, by the key of its topic in `TOPICS`; `now` in nanoseconds since 1970."""
        try:
            if topic in STORED_ONCE:
                if self._passes(topic, data) or not self._once(topic, data):
                    return
            elif topic in RUN_OF and not self._is_of_run(topic, data):
                return
        except cdr.WireError as error:
            self.ignored += 1
            self.complaints[f"{topic}: {error}"] += 1
            return
        self._add(topic, data, now)

    def _passes(self, topic: str, data: bytes) -> bool:
        """Return whether a message is one of a stream that is not to be recorded: its verdicts answer it."""
        if topic not in STREAMS or len(self.expected.recorded_chunks) == self.expected.chunks:
            return False
        values = cdr.decode_head(STORED_ONCE[topic], data)
        if reason := self.expected.identity_objection(values):
            raise cdr.WireError(reason)
        if values["chunk"] in self.expected.recorded_chunks:
            return False
        self.senders.add((topic, values["incarnation"]))
        self.passed += 1
        return True

    def _add(self, topic: str, data: bytes, now: int) -> None:
        self.messages += 1
        self.bytes += len(data)
        self.bag.add(self.names[topic], data, now)

    def _once(self, topic: str, data: bytes) -> bool:
        """Check and answer a message that is stored once; return whether it has to be stored."""
        values = self.expected.unseal(STORED_ONCE[topic], data)
        self.senders.add((topic, values["incarnation"]))
        block, chunk, attempt, checksum = (values[name] for name in ("block", "chunk", "attempt", "checksum"))
        known = self.stored.checksum(topic, block, chunk)
        if known not in (None, checksum):
            self.complaints[
                f"{topic}: block {block}, chunk {chunk}, attempt {attempt} has checksum "
                f"{checksum:016x}, stored is {known:016x}"
            ] += 1
        new, answer = self.stored.take(topic, block, chunk, attempt, checksum)
        if answer is not None:
            self._answers.append(answer)
            if block in self._on_disk and chunk == self.expected.chunks - 1:
                self._answer_blocks({block: attempt})
        if new and self._is_whole(block):
            self._whole[block] = attempt
        return new

    def _is_of_run(self, topic: str, data: bytes) -> bool:
        """Return whether a message of this run has contents; one without cells only shows that messages arrive."""
        name = RUN_OF[topic]
        values = cdr.unseal(name, data) if cdr.is_sealed(name) else cdr.decode(name, data)
        if (values["run_id"], values["sweep_id"]) != (self.expected.run_id, self.expected.sweep_id):
            raise cdr.WireError(f"run {values['run_id']!r}: this is run {self.expected.run_id}")
        return name != "Block" or len(values["cells"]) > 0

    # ---- receipts out

    def commit(self, now: int) -> bytes | None:
        """Write the pending messages to the file; return the receipt to publish, if any.

        Raises
        ------
        OSError
            Where they cannot be written. The session is over then; the bag holds all commits before.
        """
        message = None
        whole, self._whole = self._whole, {}
        on_disk = whole if self._disk is None else self._disk.done()
        self._on_disk.update(on_disk)
        self._answer_blocks(on_disk)
        if self._answers:
            message = self._receipt(self._answers)
            self._answers = []
            self._add("receipts", message, now)
        self.bag.commit()
        if self._disk is not None:
            self._disk.wrote(self.bag.take_bulk())
            if whole:
                self._disk.ask(whole)
        return message

    def repeat_receipts(self) -> None:
        """Confirm again the blocks on the disk that are outstanding in the plan: a receipt may have been lost."""
        outstanding = np.flatnonzero(np.asarray(self.last_plan["block_states"]) == 0).tolist()
        self._answer_blocks({block: self._on_disk[block] for block in outstanding if block in self._on_disk})

    def empty_receipt(self) -> bytes:
        """Return a receipt without entries: it only shows that receipts arrive, and is not recorded."""
        return self._receipt([])

    def _receipt(self, answers: list[Answer]) -> bytes:
        run = {"run_id": self.expected.run_id, "sweep_id": self.expected.sweep_id, "incarnation": self.incarnation}
        return cdr.encode("Receipt", {**run, **{name: [getattr(a, name) for a in answers] for name in Answer._fields}})

    def close(self, now: int) -> bytes | None:
        """Commit, finish the file, release the lock; return the last receipt.

        Raises
        ------
        OSError
            As :meth:`commit`.
        """
        try:
            if self._disk is not None:
                self._whole = {**self._disk.close(), **self._whole}
                self._disk = None
                if self._whole:
                    self.bag.commit()
                    os.fdatasync(self.bag.fileno())
            message = self.commit(now)
            if self.closed:
                self._add("plan", self._closing, now)
            self.bag.finish()
        finally:
            self.abandon()
        return message

    def abandon(self) -> None:
        """Close the file without finishing it, and release the lock."""
        self._stack.close()


def _names(files: Iterable[FileInfo], run_id: str) -> dict[str, str]:
    """Return the full names of the topics of the next file.

    A topic has one type in a bag. Where an older file has one of these names for a type of other fields, as a recorder
    of before version 3 gave it in the namespace /bow, all names of the next file have the run in them.
    """
    names = full_names()
    taken = {name: info.hash for file in files for name, info in file.topics.items()}
    clash = any(taken.get(names[key]) not in (None, "", type_hash(topic.type)) for key, topic in TOPICS.items())
    return full_names(f"{NAMESPACE}/{run_id}") if clash else names


def _why(report: Mapping[str, Any]) -> str:
    """Return the reason why messages are missing, for the record that lists them."""
    parts = [f"{file['file']}: {file['did']} ({file['why'] or file['was']})" for file in report["files"]]
    return "; ".join(part for part in parts if ": keep" not in part) or "a file was taken out, or exchanged"


def log_name(data: bytes) -> str:
    """Return the logger's name of an rcl_interfaces/msg/Log; "" where it cannot be read."""
    try:
        (length,) = struct.unpack_from("<I", data, 16)  # after encapsulation, stamp and level
        return bytes(data[20 : 19 + length]).decode()
    except (struct.error, UnicodeDecodeError):
        return ""
