"""One run being recorded: what may enter the bag, what is answered, and when. No ROS: bytes in, receipts out.

A receipt is written into the same chunk of the file as what it confirms, before it is published: either both are in the
bag or neither is.
"""

from __future__ import annotations

import struct
from collections import Counter
from collections.abc import Mapping
from contextlib import ExitStack
from pathlib import Path
from typing import Any

from bow_sim import wire
from bow_sim.model import ParameterError

from .bag import FOLDER, BagError, BagMessage, BagWriter
from .expected import CLOSED, Expected
from .inventory import Answer, Inventory
from .recover import locked, repair
from .topics import STORED_ONCE, TOPICS, Topic

COMMIT_BYTES = 4 << 20
"""Bytes after which a chunk of the file is written."""

COMMIT_S = 0.02
"""Seconds after which what has come is written, however little it is."""


RUN_OF = {"inspect": "BridgeForce", "basin_map": "BasinMap", "blocks": "Block"}
"""Topics whose messages say of which run they are, and the names :mod:`bow_sim.wire` has for them."""


class AlreadyClosedError(BagError):
    """Nothing is to be done: the bag ends with this very plan."""


class Session:
    """The bag of one run, open for writing.

    Parameters
    ----------
    directory
        Run directory; made if need be, locked as long as the session lasts.
    plan, data
        The Plan that opens it, decoded and as bytes.
    names
        Key of `TOPICS` -> full name of the topic on the graph.
    incarnation
        Of the recorder.
    now
        Nanoseconds since 1970.

    Raises
    ------
    ParameterError
        Where the plan is not one that can be run.
    BagError
        Where the directory is another run's, is damaged, another recorder writes it (LockedError), or the plan closes
        what was closed before (AlreadyClosedError).
    OSError
        Where it cannot be written.
    """

    def __init__(
        self,
        directory: Path,
        plan: Mapping[str, Any],
        data: bytes,
        names: Mapping[str, str],
        incarnation: str,
        now: int,
    ) -> None:
        self.directory = directory
        self.expected = Expected.of(plan)
        self.inventory = Inventory()
        self.names = dict(names)
        self.incarnation = incarnation
        self.messages = self.bytes = self.ignored = 0
        self.complaints: Counter[str] = Counter()
        self.senders: set[tuple[str, str]] = set()
        """Topic and incarnation of whose messages were taken; clear it when you have looked."""
        self.last_plan: dict[str, Any] = {}
        self._answers: list[Answer] = []
        self._sequence = 0
        with ExitStack() as stack:
            directory.mkdir(parents=True, exist_ok=True)
            stack.enter_context(locked(directory))
            report, files = repair(directory / FOLDER, self._visit)
            if not report["ok"]:
                file = next(file for file in report["files"] if file["damage"])
                start, end, what = file["damage"][0].values()
                raise BagError(f"{directory / FOLDER / file['file']}: damaged, bytes {start} to {end}: {what}")
            if self.closed and plan["epoch"] <= self.last_plan["epoch"]:  # a finished run goes on in a new epoch only
                raise AlreadyClosedError(f"{directory / FOLDER} is closed")
            self.inventory.duplicates = 0
            self.report = report
            topics: dict[str, Topic] = {self.names[name]: topic for name, topic in TOPICS.items()}
            self.bag = BagWriter(directory / FOLDER, topics, files, self._sequence)
            stack.callback(self.bag.abandon)
            self.plan(plan, data, now)
            self._stack = stack.pop_all()

    def _visit(self, message: BagMessage) -> None:
        """Take a message that is in the bag already into the inventory."""
        self._sequence = message.sequence
        if message.topic in STORED_ONCE:
            head = wire.decode_head(STORED_ONCE[message.topic], message.data)
            self.inventory.take(message.topic, *(head[name] for name in ("block", "chunk", "attempt", "checksum")))
        elif message.topic == "plan":
            plan = wire.decode("Plan", message.data)
            if (plan["run_id"], plan["sweep_id"]) != (self.expected.run_id, self.expected.sweep_id):
                raise BagError(
                    f"{message.file.parent}: holds run {plan['run_id']}, sweep {plan['sweep_id']}; this is run "
                    f"{self.expected.run_id}, sweep {self.expected.sweep_id}: it needs a directory of its own"
                )
            self.last_plan = plan

    @property
    def closed(self) -> bool:
        """Whether the latest plan says that nothing more will come."""
        return bool(self.last_plan.get("state") == CLOSED)

    @property
    def full(self) -> bool:
        """Whether enough has come to write it at once."""
        return self.bag.pending >= COMMIT_BYTES

    # ---- what comes in

    def plan(self, plan: Mapping[str, Any], data: bytes, now: int) -> None:
        """Take in a plan of this run; a closing one is kept back, to be the last message of the bag."""
        try:
            self.expected = self.expected.grown(plan)
        except ParameterError as error:
            self.ignored += 1
            self.complaints[f"plan: {error}"] += 1
            return
        self.last_plan = dict(plan)
        if self.closed:
            self._closing = data
        else:
            self._add("plan", data, now)

    def take(self, topic: str, data: bytes, now: int) -> None:
        """Take in a message, by the key of its topic in `TOPICS`; `now` in nanoseconds since 1970."""
        try:
            if topic in STORED_ONCE:
                if not self._once(topic, data):
                    return
            elif topic in RUN_OF and not self._is_of_run(topic, data):
                return
        except wire.WireError as error:
            self.ignored += 1
            self.complaints[f"{topic}: {error}"] += 1
            return
        self._add(topic, data, now)

    def _add(self, topic: str, data: bytes, now: int) -> None:
        self.messages += 1
        self.bytes += len(data)
        self.bag.add(self.names[topic], data, now)

    def _once(self, topic: str, data: bytes) -> bool:
        """Check and answer a message that is stored once; return whether it is to be stored."""
        values = self.expected.check(STORED_ONCE[topic], data)
        self.senders.add((topic, values["incarnation"]))
        block, chunk, attempt, checksum = (values[name] for name in ("block", "chunk", "attempt", "checksum"))
        known = self.inventory.checksum(topic, block, chunk)
        if known not in (None, checksum):
            self.complaints[
                f"{topic}: block {block}, chunk {chunk}, attempt {attempt} has checksum "
                f"{checksum:016x}, stored is {known:016x}"
            ] += 1
        new, answer = self.inventory.take(topic, block, chunk, attempt, checksum)
        if answer is not None:
            self._answers.append(answer)
        return new

    def _is_of_run(self, topic: str, data: bytes) -> bool:
        """Return whether a message says something of this run; one without cells only shows that messages arrive."""
        name = RUN_OF[topic]
        values = wire.unseal(name, data) if wire.is_sealed(name) else wire.decode(name, data)
        if (values["run_id"], values["sweep_id"]) != (self.expected.run_id, self.expected.sweep_id):
            raise wire.WireError(f"run {values['run_id']!r}: this is run {self.expected.run_id}")
        return name != "Block" or len(values["cells"]) > 0

    # ---- what goes out

    def commit(self, now: int) -> bytes | None:
        """Write what has come to the file; return the receipt to publish, if any.

        Raises
        ------
        OSError
            Where the disk does not take it; the session is over then, the bag holds what was committed before.
        """
        message = None
        if self._answers:
            message = self._receipt(self._answers)
            self._answers = []
            self._add("receipts", message, now)
        self.bag.commit()
        return message

    def empty_receipt(self) -> bytes:
        """Return a receipt for nothing: it shows that receipts arrive, and is not recorded."""
        return self._receipt([])

    def _receipt(self, answers: list[Answer]) -> bytes:
        run = {"run_id": self.expected.run_id, "sweep_id": self.expected.sweep_id, "incarnation": self.incarnation}
        return wire.encode("Receipt", {**run, **{name: [getattr(a, name) for a in answers] for name in Answer._fields}})

    def close(self, now: int) -> bytes | None:
        """Commit, finish the file, give up the lock; return the last receipt.

        Raises
        ------
        OSError
            As :meth:`commit`.
        """
        try:
            message = self.commit(now)
            if self.closed:
                self._add("plan", self._closing, now)
            self.bag.finish()
        finally:
            self.abandon()
        return message

    def abandon(self) -> None:
        """Close the file as it is and give up the lock."""
        self._stack.close()


def log_name(data: bytes) -> str:
    """Return the logger's name of an rcl_interfaces/msg/Log, "" where there is none to read."""
    try:
        (length,) = struct.unpack_from("<I", data, 16)  # after encapsulation, stamp and level
        return bytes(data[20 : 19 + length]).decode()
    except (struct.error, UnicodeDecodeError):
        return ""
