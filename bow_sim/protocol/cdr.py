"""The messages of the graph as CDR bytes and back, with NumPy and without ROS.

ROS 2 carries messages as CDR (OMG DDS-XTypes 1.3, section 7.4, plain XCDR1, little endian): four bytes of
encapsulation, then every primitive, aligned to its own size counted from there. A sequence is its length as uint32,
then its elements; the length of a string includes its final zero; a short text is an array of bytes, filled with zeros;
a stamp is seconds and nanoseconds, here one number of nanoseconds. All messages of ``bow_msgs`` are flat if nested ones
are written field by field, so a table describes each (:mod:`bow_sim.protocol.messages`); tests/sim/protocol/test_cdr.py
compares the bytes with rclpy's serialisation.

A message with a `checksum` is sealed: XXH3-64 over all bytes after that field, seeded with its place in the sweep.
The field is eight bytes wide and so ends on a multiple of eight: the bytes after it do not depend on its position.
Bytes skipped for alignment are zero here (Fast CDR does not set them), so that equal values give equal bytes.
"""

from __future__ import annotations

import struct
from collections.abc import Mapping
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np
import xxhash

from bow_sim.protocol.cdr_readers import READERS
from bow_sim.protocol.intervals import intervals_objection, lengths_objection
from bow_sim.protocol.messages import ADDED, FIELDS, LETTERS, SHORT_TEXT, TIME, UNSTAMPED, is_sealed
from bow_sim.protocol.verdict_fields import VERDICT_FIELDS

__all__ = [
    "ENCAPSULATION",
    "FIELDS",
    "SHORT_TEXT",
    "SLACK",
    "TIME",
    "Buffer",
    "Identity",
    "WireError",
    "chunk_checksum",
    "decode",
    "decode_head",
    "encode",
    "hello",
    "hello_from",
    "identity",
    "is_sealed",
    "place_seed",
    "unseal",
]

Buffer = bytes | bytearray | memoryview

ENCAPSULATION = b"\x00\x01\x00\x00"
"""Plain CDR, little endian, no options."""

SLACK = 32
"""Bytes that may follow a message that ROS has serialised: it reserves space for the alignment of empty arrays."""


class WireError(ValueError):
    """Bytes that are not the message they should be; the text names the field and its place."""


class Identity(NamedTuple):
    """The chunk that a sealed message belongs to, and the attempt that sent it."""

    run_id: str
    sweep_id: str
    block: int
    chunk: int
    attempt: int


def place_seed(block: int, chunk: int) -> int:
    """Return the seed of a checksum: the place of a chunk in its sweep, so that exchanged chunks are noticed."""
    return (block << 32) | chunk


def chunk_checksum(block: int, chunk: int, bridge_force: int, stick_slip: int) -> int:
    """Return the checksum of a chunk from those of its two stream messages; receipts and verdicts carry it."""
    return xxhash.xxh3_64_intdigest(struct.pack("<QQ", bridge_force, stick_slip), seed=place_seed(block, chunk))


class Field(NamedTuple):
    """How a field is encoded, as far as the message definition determines it."""

    name: str
    kind: str
    """"string", "string[]", "text", "time", "array" or "scalar"."""
    form: struct.Struct
    """Encoding of a scalar, of an item of an array, of the length of a string, of a short text, or of a stamp."""
    dtype: np.dtype[Any]
    most: int
    """Maximum number of items of an array."""

    @classmethod
    def of(cls, name: str, declared: str) -> Field:
        item, _, bound = declared.partition("[")
        if item == "string":
            return cls(name, declared, _LENGTH, np.dtype("S"), 0)
        if declared == SHORT_TEXT:
            return cls(name, "text", _TEXT, np.dtype("S16"), 0)
        if declared == TIME:
            return cls(name, "time", _STAMP, np.dtype("i8"), 0)
        most = int(bound.strip("<=]") or 2**32 - 1)
        form = struct.Struct("<" + LETTERS[item])
        return cls(name, "array" if bound else "scalar", form, np.dtype(item).newbyteorder("<"), most)


_LENGTH = struct.Struct("<I")
_TEXT = struct.Struct("16s")
_STAMP = struct.Struct("<iI")
LAYOUT = {message: [Field.of(*field) for field in fields.items()] for message, fields in FIELDS.items()}


class Writer:
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

    def field(self, field: Field, value: Any) -> None:
        if field.kind == "scalar":
            self.raw(field.form.pack(value), field.form.size)
        elif field.kind == "array":
            array = np.ascontiguousarray(value, dtype=field.dtype).reshape(-1)
            if array.size > field.most:
                raise WireError(f"{field.name}: {array.size} values, should be {field.most} at most")
            self.raw(_LENGTH.pack(array.size), 4)
            if array.size:
                self.raw(array.view(np.uint8).data, array.itemsize)
        elif field.kind == "string":
            self.string(value)
        elif field.kind == "text":
            self.raw(_short(field.name, value), 1)
        elif field.kind == "time":
            self.raw(field.form.pack(*divmod(int(value), 10**9)), 4)
        else:
            self.raw(_texts(tuple(value)), 4)

    def string(self, value: str) -> None:
        text = value.encode() + b"\0"
        self.raw(_LENGTH.pack(len(text)), 4)
        self.raw(text, 1)


@lru_cache(16)
def _texts(texts: tuple[str, ...]) -> bytes:
    """Return a sequence of texts as bytes: the settings of a run are in each of its plans and blocks."""
    writer = Writer()
    writer.raw(_LENGTH.pack(len(texts)), 4)
    for text in texts:
        writer.string(text)
    return b"".join(writer.parts)


def _short(field: str, text: str) -> bytes:
    """Return a short text as bytes; raise WireError if it is too long, or not ASCII."""
    data = text.encode()
    if len(data) > _TEXT.size or not text.isascii() or data.endswith(b"\0"):
        raise WireError(f"{field} = {text!r}: should be {_TEXT.size} ASCII characters at most")
    return data.ljust(_TEXT.size, b"\0")


def encode(name: str, values: Mapping[str, Any]) -> bytes:
    """Return message `name` as CDR bytes; the checksum of a sealed message is computed here.

    Parameters
    ----------
    name
        Key of `FIELDS`.
    values
        Field -> value; arrays of any shape are written flat, in C order. A checksum in it is not used; a stamp and a
        frame_id may be left out.

    Raises
    ------
    WireError
        If a value is too long for its field.
    """
    head, tail = Writer(), Writer()
    writer, seals = head, is_sealed(name)
    for field in LAYOUT[name]:
        if seals and field.name == "checksum":
            writer = tail
        else:
            writer.field(field, values[field.name] if field.name in values else UNSTAMPED[field.name])
    if seals:
        digest = xxhash.xxh3_64(seed=place_seed(int(values["block"]), int(values["chunk"])))
        for part in tail.parts:
            digest.update(part)
        head.raw(struct.pack("<Q", digest.intdigest()), 8)
    return b"".join([ENCAPSULATION, *head.parts, *tail.parts])


def decode(name: str, data: Buffer) -> dict[str, Any]:
    """Return the fields of message `name` from CDR bytes.

    Arrays are flat, read-only views of `data` and may be unaligned: copy them before a compiled kernel sees them.

    Raises
    ------
    WireError
        If the bytes end too early, are too many, or are not plain little-endian CDR.
    """
    return _decode(name, data)[0]


def decode_head(name: str, data: Buffer) -> dict[str, Any]:
    """Return the fields of sealed message `name` up to its checksum; the rest is not read.

    Raises
    ------
    WireError
        If the bytes end too early, or are not plain little-endian CDR.
    """
    return _decode(name, data, whole=False)[0]


def _decode(name: str, data: Buffer, whole: bool = True) -> tuple[dict[str, Any], int]:
    """Return the fields of a message, or those up to its checksum, and the first byte that the checksum covers."""
    if whole and name in READERS:
        try:
            found = READERS[name](data)
        except (ValueError, struct.error):
            found = None
        if found is not None:
            return found
    return _follow(name, data, whole)


def _follow(name: str, data: Buffer, whole: bool = True) -> tuple[dict[str, Any], int]:
    """Return what :func:`_decode` returns, field by field.

    No memory is allocated for a length that the message states but does not have.
    """
    view = memoryview(data)
    if view[:2] != ENCAPSULATION[:2]:
        raise WireError(f"{name}: starts with {bytes(view[:4]).hex()}, not with plain little-endian CDR (0001)")
    body = view[len(ENCAPSULATION) :]
    size = len(body)
    values: dict[str, Any] = {}
    at = covered = 0
    for field, kind, form, dtype, most in LAYOUT[name]:
        count, item = 1, form.size
        try:
            if kind == "scalar":
                at += -at % item
                (values[field],) = form.unpack_from(body, at)
                at += item
            elif kind == "array":
                if at == size and field in ADDED.get(name, ()):
                    values[field] = VERDICT_FIELDS[field].array((len(values["cells"]),))
                    continue
                at += -at % 4
                (count,) = _LENGTH.unpack_from(body, at)
                at += 4
                if count > most:
                    raise WireError(f"{name}.{field}: {count} values, should be {most} at most")
                if count:
                    at += -at % item
                if at + count * item > size:
                    raise struct.error
                values[field] = np.frombuffer(body, dtype, count, at)
                at += count * item
            elif kind == "string":
                try:
                    values[field], at = _string(name, field, body, at)
                except (struct.error, WireError):
                    if field not in ADDED.get(name, ()) or size - at > SLACK:
                        raise
                    values[field] = ""
            elif kind == "text":
                (short,) = form.unpack_from(body, at)
                if not short.isascii():
                    raise WireError(f"{name}.{field}: {short!r} is not ASCII")
                values[field] = short.rstrip(b"\0").decode()
                at += item
            elif kind == "time":
                at += -at % 4
                seconds, nanoseconds = form.unpack_from(body, at)
                values[field] = seconds * 10**9 + nanoseconds
                at += item
            else:
                at += -at % 4
                (count,) = _LENGTH.unpack_from(body, at)
                at += 4
                texts = values[field] = []
                for _ in range(count):
                    text, at = _string(name, field, body, at)
                    texts.append(text)
        except struct.error:
            start, end = at + len(ENCAPSULATION), at + len(ENCAPSULATION) + count * item
            raise WireError(f"{name}.{field}: wants bytes {start} to {end}, the message has {len(view)}") from None
        if field == "checksum" and is_sealed(name):
            covered = at + len(ENCAPSULATION)
            if not whole:
                return values, covered
    if size - at > (0 if is_sealed(name) else SLACK):
        raise WireError(f"{name}: {size - at} bytes too many after byte {at + len(ENCAPSULATION)}")
    return values, covered


def _string(name: str, field: str, body: memoryview, at: int) -> tuple[str, int]:
    """Return a string of a message and where it ends."""
    at += -at % 4
    (length,) = _LENGTH.unpack_from(body, at)
    at += 4
    text = bytes(body[at : at + length])
    if len(text) < length:
        raise struct.error
    if text[-1:] != b"\0":
        raise WireError(f"{name}.{field}: the string at byte {at + len(ENCAPSULATION)} does not end with a zero")
    try:
        return text[:-1].decode(), at + length
    except UnicodeDecodeError as error:
        raise WireError(f"{name}.{field}: the string at byte {at + len(ENCAPSULATION)} is not UTF-8: {error}") from None


HELLO_BYTES = 400
"""Longer messages are not hellos, and need not be decoded to know it."""

_EMPTY = {"uint8": 0, "uint32": 0, "uint64": 0, "string": "", SHORT_TEXT: "", TIME: 0}


def hello(name: str, incarnation: str) -> bytes:
    """Return message `name` ("BridgeForce", "StickSlip", "Verdicts") without cells.

    It only shows that messages of the node of an `incarnation` arrive.
    """
    values: dict[str, Any] = {field: _EMPTY.get(kind, ()) for field, kind in FIELDS[name].items()}
    return encode(name, {**values, "incarnation": incarnation, "offsets": (0,)})


def hello_from(name: str, data: Buffer) -> str:
    """Return the incarnation of the node that sent a hello; "" if the message is not a hello."""
    if len(data) > HELLO_BYTES:
        return ""
    try:
        values = unseal(name, data)
    except WireError:
        return ""
    return "" if len(values["cells"]) else str(values["incarnation"])


def identity(values: Mapping[str, Any]) -> Identity:
    """Return the identity of a decoded sealed message."""
    return Identity(*(values[field] for field in Identity._fields))


def unseal(name: str, data: Buffer, check_intervals: bool = True) -> dict[str, Any]:
    """Return the fields of sealed message `name` after checking its checksum and the lengths of its arrays.

    Parameters
    ----------
    check_intervals
        Whether the slip intervals of a StickSlip are checked, too.

    Raises
    ------
    WireError
        If the checksum is wrong, the lengths of arrays do not fit each other, or intervals that are checked cannot be.
    """
    values, covered = _decode(name, data)
    expected = xxhash.xxh3_64_intdigest(memoryview(data)[covered:], seed=place_seed(values["block"], values["chunk"]))
    if values["checksum"] != expected:
        raise WireError(f"{name}: checksum {values['checksum']:016x} does not hold, the bytes give {expected:016x}")
    cells = 1 if name == "InspectedCell" else len(values["cells"])
    lengths: dict[str, int] = {}
    if name == "InspectedCell":
        lengths = {"bridge_force": len(values["periods"])}
    elif name == "BridgeForce":
        lengths = {"data": cells * values["samples"]}
    elif name == "StickSlip":
        reason = intervals_objection(values) if check_intervals else lengths_objection(values)
        if reason:
            raise WireError(f"StickSlip{reason}")
        lengths = {"slipping": cells, "offsets": cells + 1}
    elif name == "Verdicts":
        lengths = dict.fromkeys(VERDICT_FIELDS, cells)
    for field, length in lengths.items():
        if len(values[field]) != length:
            raise WireError(f"{name}.{field}: {len(values[field])} values for {cells} cells, should be {length}")
    return values
