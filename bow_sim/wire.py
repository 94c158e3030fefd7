"""The messages of the graph as CDR bytes and back, with NumPy and without ROS.

ROS 2 carries messages as CDR (OMG DDS-XTypes 1.3, section 7.4, plain XCDR1, little endian): four bytes of
encapsulation, then every primitive aligned to its own size counted from there; a sequence is its length as uint32,
then its elements; a string counts its closing zero. All messages of ``bow_msgs`` are flat once nested ones are written
out field by field, so a table of fields describes each. ``tests/sim/test_wire.py`` holds the tables against the .msg
files and the bytes against rclpy's own serialisation.

A message with a `checksum` is sealed: XXH3-64 over all bytes after that field, seeded with its place in the sweep.
The field is eight bytes wide and so ends on a multiple of eight: what follows has the same bytes wherever it stands.
Bytes skipped for alignment are zero here (Fast CDR leaves them as they were), so that equal values give equal bytes.
"""

from __future__ import annotations

import struct
from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np
import xxhash

Buffer = bytes | bytearray | memoryview

ENCAPSULATION = b"\x00\x01\x00\x00"
"""Plain CDR, little endian, no options."""

_IDENTITY = {
    "run_id": "string",
    "sweep_id": "string",
    "block": "uint32",
    "chunk": "uint32",
    "attempt": "uint32",
    "incarnation": "string",
    "checksum": "uint64",
}

FIELDS: dict[str, dict[str, str]] = {
    "BridgeForce": {
        **_IDENTITY,
        "cells": "uint32[]",
        "first_sample": "uint32",
        "samples": "uint32",
        "data": "float32[]",
    },
    "StickSlip": {
        **_IDENTITY,
        "cells": "uint32[]",
        "first_sample": "uint32",
        "samples": "uint32",
        "slipping": "uint8[]",
        "offsets": "uint32[]",
        "onset": "uint32[]",
        "duration": "uint32[]",
        "slip": "float64[]",
    },
    "Verdicts": {
        **_IDENTITY,
        "chunk_checksum": "uint64",
        "classifier": "string",
        "cells": "uint32[]",
        "correlation": "float32[]",
        "period": "float32[]",
        "slips": "uint16[]",
        "corners": "uint16[]",
        "regime": "uint8[]",
        "confidence": "float32[]",
    },
    "Receipt": {
        "run_id": "string",
        "sweep_id": "string",
        "incarnation": "string",
        "kind": "uint8[]",
        "block": "uint32[]",
        "chunk": "uint32[]",
        "attempt": "uint32[]",
        "checksum": "uint64[]",
    },
    "Plan": {
        "run_id": "string",
        "sweep_id": "string",
        "epoch": "uint32",
        "state": "uint8",
        "spec.preset": "string",
        "spec.settings": "string[]",
        "fingerprint": "string",
        "classifier": "string",
        "block_states": "uint8[]",
        "rounds": "uint8[]",
    },
    "BasinMap": {
        "run_id": "string",
        "sweep_id": "string",
        "x_name": "string",
        "y_name": "string",
        "x": "float64[]",
        "y": "float64[]",
        "transient_periods": "float32[]",
        "regime": "uint8[]",
        "tests": "uint16[]",
        "correlation": "float32[]",
        "slips": "uint16[]",
        "corners": "uint16[]",
        "regime_names": "string[]",
        "cells_done": "uint32",
        "cells_quarantined": "uint32",
        "cells_outstanding": "uint32",
    },
}
"""Message -> its fields in order, nested messages written out with a dot."""

SLACK = 32
"""Bytes that may follow a message that ROS has serialised: it reserves room for aligning arrays that are empty."""

INTERVAL_FIELDS = ("slipping", "offsets", "onset", "duration", "slip")
"""What StickSlip says of a chunk beyond where it is."""

RECEIPT_STREAMS, RECEIPT_VERDICTS = 0, 1
"""Receipt.kind: both stream messages of a chunk; the verdicts on a chunk."""


def is_sealed(name: str) -> bool:
    """Return whether a message carries its own checksum; then it was written here, to the last byte."""
    return FIELDS[name].get("checksum") == "uint64"


class WireError(ValueError):
    """Bytes that are not the message they should be; says which field and where."""


class Identity(NamedTuple):
    """What a sealed message is about, and which try it comes from."""

    run_id: str
    sweep_id: str
    block: int
    chunk: int
    attempt: int


def _place(block: int, chunk: int) -> int:
    """Return the seed of a checksum: the place of a chunk in its sweep, so that swapped chunks do not agree."""
    return (block << 32) | chunk


def chunk_checksum(block: int, chunk: int, bridge_force: int, stick_slip: int) -> int:
    """Return the checksum of a chunk from those of its two stream messages: what receipts and verdicts agree on."""
    return xxhash.xxh3_64_intdigest(struct.pack("<QQ", bridge_force, stick_slip), seed=_place(block, chunk))


class _Writer:
    """Collects aligned pieces; the large arrays are joined once, at the end, and copied once."""

    def __init__(self) -> None:
        self.parts: list[bytes | memoryview] = []
        self.size = 0

    def raw(self, data: bytes | memoryview, align: int) -> None:
        gap = -self.size % align
        if gap:
            self.parts.append(bytes(gap))
        self.parts.append(data)
        self.size += gap + len(data)

    def field(self, kind: str, value: Any) -> None:
        if kind == "string":
            text = value.encode() + b"\0"
            self.raw(struct.pack("<I", len(text)), 4)
            self.raw(text, 1)
        elif kind == "string[]":
            self.raw(struct.pack("<I", len(value)), 4)
            for item in value:
                self.field("string", item)
        elif kind.endswith("[]"):
            array = np.ascontiguousarray(value, dtype=np.dtype(kind[:-2]).newbyteorder("<")).reshape(-1)
            self.raw(struct.pack("<I", array.size), 4)
            if array.size:
                self.raw(array.view(np.uint8).data, array.itemsize)
        else:
            scalar = np.dtype(kind).newbyteorder("<").type(value)
            self.raw(scalar.tobytes(), scalar.itemsize)


def encode(name: str, values: Mapping[str, Any]) -> bytes:
    """Return message `name` as CDR bytes; a sealed message gets its checksum here, whatever `values` says of it.

    Parameters
    ----------
    name
        Key of `FIELDS`.
    values
        Field -> value; arrays in any shape, written flat in C order.
    """
    head, tail = _Writer(), _Writer()
    writer = head
    for field, kind in FIELDS[name].items():
        if field == "checksum" and kind == "uint64":
            writer = tail
        else:
            writer.field(kind, values[field])
    if writer is tail:
        digest = xxhash.xxh3_64(seed=_place(int(values["block"]), int(values["chunk"])))
        for part in tail.parts:
            digest.update(part)
        head.raw(struct.pack("<Q", digest.intdigest()), 8)
    return b"".join([ENCAPSULATION, *head.parts, *tail.parts])


_LETTERS = {"uint8": "B", "uint16": "H", "uint32": "I", "uint64": "Q", "float32": "f", "float64": "d"}
_SCALARS = {kind: struct.Struct("<" + letter) for kind, letter in _LETTERS.items()}
_ITEMS = {f"{kind}[]": np.dtype(kind).newbyteorder("<") for kind in _LETTERS}


class _Reader:
    def __init__(self, name: str, data: Buffer) -> None:
        self.name, self.data, self.at = name, memoryview(data), len(ENCAPSULATION)
        if bytes(self.data[:2]) != ENCAPSULATION[:2]:
            raise WireError(
                f"{name}: starts with {bytes(self.data[:4]).hex()}, not with plain little-endian CDR (0001)"
            )

    def take(self, field: str, count: int, size: int) -> int:
        """Return where `count` items of `size` bytes begin; nothing is allocated on the word of the sender."""
        start = self.at + (-(self.at - len(ENCAPSULATION)) % size if count else 0)
        end = start + count * size
        if end > len(self.data):
            raise WireError(f"{self.name}.{field}: wants bytes {start} to {end}, the message has {len(self.data)}")
        self.at = end
        return start

    def scalar(self, field: str, kind: str) -> Any:
        form = _SCALARS[kind]
        return form.unpack_from(self.data, self.take(field, 1, form.size))[0]

    def field(self, field: str, kind: str) -> Any:
        if kind == "string":
            length = self.scalar(field, "uint32")
            start = self.take(field, length, 1)
            text = bytes(self.data[start : start + length])
            if not text.endswith(b"\0"):
                raise WireError(f"{self.name}.{field}: the string at byte {start} does not end with a zero")
            try:
                return text[:-1].decode()
            except UnicodeDecodeError as error:
                raise WireError(f"{self.name}.{field}: the string at byte {start} is not UTF-8: {error}") from None
        if kind == "string[]":
            return [self.field(field, "string") for _ in range(self.scalar(field, "uint32"))]
        if kind.endswith("[]"):
            dtype = _ITEMS[kind]
            count = self.scalar(field, "uint32")
            return np.frombuffer(self.data, dtype, count, self.take(field, count, dtype.itemsize))
        return self.scalar(field, kind)


def decode(name: str, data: Buffer) -> dict[str, Any]:
    """Return the fields of message `name` from CDR bytes.

    Arrays are flat, read-only views of `data` and may be unaligned: copy them before a compiled kernel sees them.

    Raises
    ------
    WireError
        Where the bytes end early, go on too long, or are not plain little-endian CDR.
    """
    return _decode(name, data)[0]


def _decode(name: str, data: Buffer) -> tuple[dict[str, Any], int]:
    """Return the fields of a message, and where what its checksum covers begins."""
    reader = _Reader(name, data)
    values, covered = {}, 0
    for field, kind in FIELDS[name].items():
        values[field] = reader.field(field, kind)
        if field == "checksum":
            covered = reader.at
    if len(reader.data) - reader.at > (0 if is_sealed(name) else SLACK):
        raise WireError(f"{name}: {len(reader.data) - reader.at} bytes too many after byte {reader.at}")
    return values, covered


def peek(name: str, data: Buffer) -> Identity:
    """Return the identity of a sealed message without reading what follows.

    Raises
    ------
    WireError
        Where the bytes end too early.
    """
    reader = _Reader(name, data)
    return Identity(*(reader.field(field, FIELDS[name][field]) for field in Identity._fields))


def identity(values: Mapping[str, Any]) -> Identity:
    """Return the identity of a decoded sealed message."""
    return Identity(*(values[field] for field in Identity._fields))


def unseal(name: str, data: Buffer) -> dict[str, Any]:
    """Return the fields of sealed message `name` after checking its checksum and the lengths of its arrays.

    Raises
    ------
    WireError
        Where the checksum does not hold, or arrays do not fit each other.
    """
    values, covered = _decode(name, data)
    expected = xxhash.xxh3_64_intdigest(memoryview(data)[covered:], seed=_place(values["block"], values["chunk"]))
    if values["checksum"] != expected:
        raise WireError(f"{name}: checksum {values['checksum']:016x} does not hold, the bytes give {expected:016x}")
    cells = len(values["cells"])
    lengths: dict[str, int] = {}
    if name == "BridgeForce":
        lengths = {"data": cells * values["samples"]}
    elif name == "StickSlip":
        _check_intervals(values)
        lengths = {"slipping": cells, "offsets": cells + 1}
    elif name == "Verdicts":
        lengths = dict.fromkeys(("correlation", "period", "slips", "corners", "regime", "confidence"), cells)
    for field, length in lengths.items():
        if len(values[field]) != length:
            raise WireError(f"{name}.{field}: {len(values[field])} values for {cells} cells, should be {length}")
    return values


def _check_intervals(values: Mapping[str, Any]) -> None:
    """Raise where the slip intervals of a chunk do not lie in order, apart and within the chunk."""
    offsets = values["offsets"].astype(np.int64)
    onset, duration = values["onset"].astype(np.int64), values["duration"].astype(np.int64)
    count = len(onset)
    if len(duration) != count or len(values["slip"]) != count:
        raise WireError(
            f"StickSlip: {count} onsets, {len(duration)} durations, {len(values['slip'])} slips; should be equal"
        )
    if not len(offsets) or offsets[0] != 0 or offsets[-1] != count or (np.diff(offsets) < 0).any():
        raise WireError(f"StickSlip.offsets: should rise from 0 to {count}, the number of intervals")
    if (duration < 1).any() or (onset + duration > values["samples"]).any():
        raise WireError(f"StickSlip: an interval is empty or reaches past the chunk's {values['samples']} samples")
    same_cell = np.repeat(np.arange(len(offsets) - 1), np.diff(offsets))
    if count and (np.diff(onset)[np.diff(same_cell) == 0] <= duration[:-1][np.diff(same_cell) == 0]).any():
        raise WireError("StickSlip: the intervals of a cell should come in order, at least one sample apart")
