"""The contents of a bag, found by reading every byte of it once, and everything that is wrong with them.

Memory grows with the number of messages and not with their size: of waveforms only the places in the file are kept.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from mcap.records import Metadata

from bow_sim.physics.errors import ParameterError
from bow_sim.protocol import cdr
from bow_sim.protocol.messages import STREAMS
from bow_sim.protocol.states import ReceiptKind
from bow_sim.protocol.sweep_outline import SweepOutline
from bow_sim.protocol.verdict_fields import VERDICT_FIELDS
from bow_sweep.record.bag import METADATA, BagError, BagMessage, bag_files, label
from bow_sweep.record.mcap_reader import Scan
from bow_sweep.record.mcap_records import Message
from bow_sweep.record.metadata import FileInfo, MetadataError, differences, parse
from bow_sweep.record.notes import Range, noted_in, outside, too_new, version_in
from bow_sweep.record.old_messages import OLD_TYPES, complete
from bow_sweep.record.topics import STORED_ONCE, TOPICS, short_name

Progress = Callable[[float, float], None]
"""Called with (done, total), in bytes."""

MAX_PROBLEMS = 200
"""Number of problems that are kept; others are only counted."""

Key = tuple[int, int]
"""(block, chunk)."""


class Place(NamedTuple):
    """Place of a stream message in a file."""

    file: Path
    offset: int
    length: int
    checksum: int
    lacking: bytes = b""
    """What the message lacks at its start, in a bag of an older version; see :mod:`bow_sweep.record.old_messages`."""


class Verdict(NamedTuple):
    """The fields that are kept of a Verdicts message."""

    checksum: int
    chunk_checksum: int
    layers: dict[str, np.ndarray]


class RunIdentity(NamedTuple):
    """A run and its sweep, 16 hexadecimal digits each."""

    run_id: str
    sweep_id: str


class Gap(NamedTuple):
    """Messages that are missing, and the file that comes after them."""

    missing: Range
    file: str


class Survey:
    """The contents of a bag, and its problems: dicts with `what`, and as much of the place as is known.

    Parameters
    ----------
    directory
        Of the bag.
    expected
        Outline of the run, where it is known from other files.
    last
        Number of the message before the first; None where the first may have any number.

    Attributes
    ----------
    expected
        Outline of the run, from its plans so far; None before the first.
    identity
        Run and sweep of the first plan, even where another one is expected.
    plan
        The latest plan.
    epoch
        The largest epoch of all plans.
    places
        Topic ("bridge_force", "stick_slip") -> chunk -> the message stored for it.
    verdicts
        Chunk -> the verdict stored for it.
    receipts
        (kind, block, chunk) -> checksums in receipts.
    attempts
        Block -> the latest attempt in any message.
    files
        The files that were read, in order.
    problems, problem_count
        The first `MAX_PROBLEMS` problems, and how many there are.
    messages
        Number of messages.
    first, last
        Numbers of the first and the last message.
    gaps, noted
        Messages that are missing between others, and those that a file lists as missing.
    version
        Latest version of the files, see :data:`bow_sim.protocol.messages.FORMAT`.
    """

    def __init__(self, directory: Path, expected: SweepOutline | None = None, last: int | None = 0) -> None:
        self.directory = directory
        self.expected = expected
        self.identity: RunIdentity | None = None
        self.plan: dict[str, Any] = {}
        self.epoch = 0
        self.places: dict[str, dict[Key, Place]] = {"bridge_force": {}, "stick_slip": {}}
        self.verdicts: dict[Key, Verdict] = {}
        self.receipts: dict[tuple[int, int, int], set[int]] = {}
        self.attempts: dict[int, int] = {}
        self.files: list[FileInfo] = []
        self.problems: list[dict[str, Any]] = []
        self.problem_count = 0
        self.messages = 0
        self.first: int | None = None
        self.last = last
        self.gaps: list[Gap] = []
        self.noted: list[Range] = []
        self.version = 1

    def problem(self, what: str, **where: Any) -> None:
        """Add a problem."""
        self.problem_count += 1
        if len(self.problems) < MAX_PROBLEMS:
            run = {"run": self.expected.run_id} if self.expected else {}
            self.problems.append({"what": what, **run, **where})

    def read(self, progress: Progress | None = None, share: float = 1.0) -> Survey:
        """Read all files, and return this object; `share` is the share of this in the work that `progress` reports."""
        paths = bag_files(self.directory)
        total = sum(path.stat().st_size for path in paths)
        before = 0
        for path in paths:
            scan = Scan(path)
            try:
                for message in self.read_file(scan):
                    if progress is not None and self.messages % 64 == 0:
                        progress((before + max(message.offset, 0)) * share, total)
            except OSError as error:
                self.problem(f"cannot be read: {error}", file=path.name)
            before += scan.size
            for damage in scan.damage[:MAX_PROBLEMS]:
                what = f"damage: {damage.what}; `bow recover` tells what can be kept"
                self.problem(what, file=path.name, bytes=[damage.start, damage.end])
            if not scan.finished and not scan.damage:
                self.problem(
                    f"cut off: complete up to byte {scan.good_end} of {scan.size}; `bow recover` repairs it",
                    file=path.name,
                )
        self._check_numbers()
        self._check_metadata()
        return self

    def read_file(self, scan: Scan) -> Iterator[Message]:
        """Take in a file, and yield its messages one by one. The caller has to report the damage found by `scan`."""
        for message in scan.messages():
            self._take(label(scan.contents, message, scan.path))
            yield message
        self._take_notes(scan.notes, scan.path)
        self._check_types(scan)
        self.files.append(FileInfo.of(scan.path.name, scan.contents))

    def _take_notes(self, notes: Iterable[Metadata], path: Path) -> None:
        version = version_in(notes)
        if why := too_new(version):
            self.problem(why, file=path.name)
        self.version = max(self.version, version)
        self.noted += noted_in(notes)

    def merge(self, other: Survey) -> None:
        """Take in the survey of the files after these."""
        self.expected, self.plan = other.expected, other.plan or self.plan
        self.identity = self.identity or other.identity
        self.epoch = max(self.epoch, other.epoch)
        for topic, places in other.places.items():
            self.places[topic].update(places)
        self.verdicts |= other.verdicts
        for key, checksums in other.receipts.items():
            self.receipts.setdefault(key, set()).update(checksums)
        for block, attempt in other.attempts.items():
            self.attempts[block] = max(attempt, self.attempts.get(block, 0))
        if other.first is not None:
            if other.first != (self.last or 0) + 1:
                self.gaps.append(Gap(Range((self.last or 0) + 1, other.first - 1), other.files[0].name))
            self.last = other.last
        self.gaps += other.gaps
        self.noted += other.noted
        self.version = max(self.version, other.version)
        self.files += other.files
        self.messages += other.messages

    def missing(self) -> list[Range]:
        """Return the numbers of the messages that are missing, unless a file lists them as missing."""
        return outside([gap.missing for gap in self.gaps], self.noted)

    def _check_numbers(self) -> None:
        for missing, file in self.gaps:
            if outside([missing], self.noted):
                what = f"message {missing.last + 1} comes after message {missing.first - 1}: some are missing or moved"
                self.problem(what, file=file)

    def lacks(self, block: int) -> str:
        """Return why a block is not complete: every chunk classified, receipted and, where it is to be, stored.

        "" where it is.
        """
        assert self.expected is not None
        for chunk in range(self.expected.chunks):
            key = (block, chunk)
            if lacking := self.lacking(key):
                return f"chunk {chunk}: no {' and no '.join(lacking)}"
            whole, verdict = self.chunk_checksum(key), self.verdicts[key]
            if whole is not None and verdict.chunk_checksum != whole:
                return f"chunk {chunk}: its verdicts are on other streams"
            for kind, checksum in ((ReceiptKind.STREAMS, whole), (ReceiptKind.VERDICTS, verdict.checksum)):
                if checksum is not None and checksum not in self.receipts.get((kind, *key), ()):
                    return f"chunk {chunk}: no receipt"
        return ""

    def lacking(self, key: Key) -> list[str]:
        """Return the topics of which a chunk has no message in the bag, but should have one."""
        assert self.expected is not None
        stored: dict[str, Any] = {**self.places, "verdicts": self.verdicts}
        recorded = key[1] in self.expected.recorded_chunks
        return [topic for topic, there in stored.items() if key not in there and (recorded or topic not in STREAMS)]

    def _check_types(self, scan: Scan) -> None:
        for channel in scan.contents.channels.values():
            name = short_name(channel.topic)
            schema = scan.contents.schemas.get(channel.schema_id)
            if name and (schema is None or schema.name not in (TOPICS[name].type, OLD_TYPES.get(name))):
                given = schema.name if schema else "no type"
                self.problem(f"{channel.topic} has {given}, should have {TOPICS[name].type}", file=scan.path.name)

    def _check_metadata(self) -> None:
        path = self.directory / METADATA
        try:
            problems = differences(parse(path.read_bytes()), self.files)
        except OSError as error:
            problems = [f"cannot be read: {error.strerror}"]
        except MetadataError as error:
            problems = [str(error)]
        for what in problems[:MAX_PROBLEMS]:
            self.problem(f"{what}; `bow recover` writes it anew", file=METADATA)

    def _take(self, message: BagMessage) -> None:
        self.messages += 1
        number = message.sequence
        if self.first is None:
            self.first = number
        if self.last is not None and number <= self.last:
            what = f"message {number} comes after message {self.last}: some are missing or moved"
            self.problem(what, file=message.file.name)
        elif self.last is not None and number > self.last + 1:
            self.gaps.append(Gap(Range(self.last + 1, number - 1), message.file.name))
        self.last = number
        try:
            if message.topic == "plan":
                self._take_plan(cdr.decode("Plan", message.data))
            elif message.topic in STORED_ONCE:
                self._take_sealed(message)
            elif message.topic == "receipts":
                self._take_receipts(cdr.decode("Receipt", message.data))
            elif message.topic == "basin_map":
                self._check_run(cdr.decode("BasinMap", message.data))
            elif message.topic == "inspect":
                self._check_run(self._opened(message.type, message))
        except (cdr.WireError, ParameterError) as error:
            self.problem(str(error), topic=message.topic, message=message.sequence, file=message.file.name)

    def _opened(self, name: str, message: BagMessage) -> dict[str, Any]:
        """Return the fields of a stream message."""
        return cdr.unseal(name, message.data)

    def _take_plan(self, plan: dict[str, Any]) -> None:
        self.identity = self.identity or RunIdentity(plan["run_id"], plan["sweep_id"])
        if self.expected is None:
            self.expected = SweepOutline.of(plan)
        self._check_run(plan)
        self.expected = self.expected.followed(plan)
        self.plan = plan
        self.epoch = max(self.epoch, plan["epoch"])

    def _check_run(self, values: dict[str, Any]) -> None:
        if self.expected is None:
            raise cdr.WireError("comes before the first plan")
        if (values["run_id"], values["sweep_id"]) != (self.expected.run_id, self.expected.sweep_id):
            raise cdr.WireError(f"is of run {values['run_id']!r}, sweep {values['sweep_id']!r}")

    def _take_sealed(self, message: BagMessage) -> None:
        if self.expected is None:
            raise cdr.WireError("comes before the first plan")
        values = self._checked(message)
        key = (values["block"], values["chunk"])
        self.attempts[key[0]] = max(values["attempt"], self.attempts.get(key[0], 0))
        stored: dict[Key, Any] = self.verdicts if message.topic == "verdicts" else self.places[message.topic]
        if key in stored:
            self.problem("stored twice", topic=message.topic, block=key[0], chunk=key[1])
        elif message.topic == "verdicts":
            layers = {name: values[name].copy() for name in VERDICT_FIELDS}
            stored[key] = Verdict(values["checksum"], values["chunk_checksum"], layers)
        else:
            stored[key] = Place(message.file, message.offset, message.length, values["checksum"], message.lacking)

    def _checked(self, message: BagMessage) -> dict[str, Any]:
        """Return the fields of a stream message or verdict that belongs to the run and is consistent."""
        assert self.expected is not None
        return self.expected.unseal(STORED_ONCE[message.topic], message.data)

    def _take_receipts(self, values: dict[str, Any]) -> None:
        self._check_run(values)
        columns = [values[name].tolist() for name in ("kind", "block", "chunk", "attempt", "checksum")]
        if len({len(column) for column in columns}) != 1:
            raise cdr.WireError(f"arrays of {', '.join(str(len(column)) for column in columns)} values")
        for kind, block, chunk, attempt, checksum in zip(*columns, strict=True):
            self.receipts.setdefault((kind, block, chunk), set()).add(checksum)
            self.attempts[block] = max(attempt, self.attempts.get(block, 0))

    def chunk_checksum(self, key: Key) -> int | None:
        """Return the checksum of a chunk whose two stream messages are stored; None otherwise."""
        force, slip = (self.places[topic].get(key) for topic in ("bridge_force", "stick_slip"))
        return cdr.chunk_checksum(*key, force.checksum, slip.checksum) if force and slip else None

    def layers(self, keys: Iterable[Key] | None = None) -> dict[str, np.ndarray]:
        """Return the recorded verdicts as arrays; see :func:`bow_sweep.record.replay.load_verdicts`."""
        assert self.expected is not None
        out = empty_layers(self.expected)
        for key in self.verdicts if keys is None else keys:
            put(out, self.expected, key, self.verdicts[key].layers)
        return out


def empty_layers(expected: SweepOutline) -> dict[str, np.ndarray]:
    """Return arrays (tests, cells) for the verdicts of a run, without any."""
    shape = (expected.chunks, expected.cells)
    out = {name: field.array(shape) for name, field in VERDICT_FIELDS.items()}
    return {**out, "tested": np.zeros(shape, bool)}


def put(layers: dict[str, np.ndarray], expected: SweepOutline, key: Key, values: dict[str, np.ndarray]) -> None:
    """Put one verdict into arrays of :func:`empty_layers`."""
    cells = expected.block(key[0])
    for name in VERDICT_FIELDS:
        layers[name][key[1], cells] = values[name]
    layers["tested"][key[1], cells] = True


class Chunks:
    """Reads stored messages again, by their places; keeps the files open."""

    def __init__(self) -> None:
        self._open: dict[Path, int] = {}

    def __enter__(self) -> Chunks:
        return self

    def __exit__(self, *_: object) -> None:
        for descriptor in self._open.values():
            os.close(descriptor)

    def read(self, place: Place) -> cdr.Buffer:
        """Return a message as one of today.

        Raises
        ------
        BagError
            Where it is in a compressed chunk, or the file ends before it.
        """
        if place.offset < 0:
            raise BagError(f"{place.file}: is compressed; bow writes bags that are not, and replays only those")
        if place.file not in self._open:
            self._open[place.file] = os.open(place.file, os.O_RDONLY | os.O_CLOEXEC)
        data = os.pread(self._open[place.file], place.length, place.offset)
        if len(data) != place.length:
            raise BagError(f"{place.file}: ends before byte {place.offset + place.length}")
        return complete(data, place.lacking)
