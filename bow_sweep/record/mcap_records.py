"""Parses records of an MCAP file: chunks and their messages. Every length is checked before it is used."""

from __future__ import annotations

import mmap
import re
import struct
from typing import NamedTuple

from isal.isal_zlib import crc32
from mcap.exceptions import McapError
from mcap.opcode import Opcode
from mcap.records import Chunk
from mcap.stream_reader import get_chunk_data_stream

from bow_sweep.record.mcap_writer import CHUNK_HEAD, MESSAGE_FIXED, MESSAGE_HEAD, RECORD_HEAD

MAX_CHUNK = 1 << 28
"""Largest chunk that is unpacked, in bytes: the head of a damaged chunk may state any size."""

PARSE_ERRORS = (struct.error, McapError, UnicodeDecodeError, KeyError, ValueError, MemoryError)
"""Exceptions that damaged bytes raise, here and in the readers of the mcap package."""

_CHUNK_START = re.compile(rb"\x06.{5}\x00\x00\x00", re.DOTALL)
"""Opcode of a chunk, and a length whose upper three bytes are zero."""


class Damage(NamedTuple):
    """Bytes of a file that differ from what was written."""

    start: int
    end: int
    what: str
    kind: str = "bytes"
    """"bytes": in the data; "index": in the index of a chunk, which can be derived again; "end": from the end of the
    data on; "tail": after a complete end; "data": somewhere in the data."""
    right: bytes = b""
    """The right bytes, where they can be derived."""


class Message(NamedTuple):
    """A message of a file; `data` is a view of the chunk, which it keeps in memory."""

    channel: int
    sequence: int
    log_time: int
    publish_time: int
    data: memoryview
    offset: int
    """Of `data` in the file; -1 in a compressed chunk."""
    unread: int = 0
    """Number of bytes at the end of the message that are not in `data`."""


class InnerRecord(NamedTuple):
    """A record in a chunk: its opcode, and its first byte and the byte after its last in the payload."""

    opcode: int
    start: int
    end: int


class Unpacked(NamedTuple):
    """A chunk, its uncompressed payload, and the records in the payload."""

    chunk: Chunk
    payload: memoryview
    records: list[InnerRecord]


def unpack_message(record: bytes | memoryview, start: int, end: int, offset: int) -> Message:
    """Return the message whose record is at `start` to `end`; `offset` is that of its data in the file."""
    _, _, channel, sequence, log_time, publish_time = MESSAGE_HEAD.unpack_from(record, start)
    data = memoryview(record)[start + MESSAGE_HEAD.size : end]
    return Message(channel, sequence, log_time, publish_time, data, offset)


def unpack_chunk(record: bytes, sealed: bool = False) -> Unpacked:
    """Unpack a chunk record, and check its CRC.

    Parameters
    ----------
    record
        With opcode and length.
    sealed
        A CRC of zero is a value like any other. MCAP allows it to mean that there is no CRC.

    Raises
    ------
    ValueError
        Where a length or the CRC is wrong; other `PARSE_ERRORS` for bytes that cannot be parsed.
    """
    _, length, first, last, size, crc, name_length = struct.unpack_from("<BQQQQII", record)
    at = CHUNK_HEAD.size - 8 + name_length
    compression = bytes(record[at - name_length : at]).decode()
    (packed,) = struct.unpack_from("<Q", record, at)
    data = memoryview(record)[at + 8 :]
    if packed != len(data) or (not compression and packed != size) or size > MAX_CHUNK:
        raise ValueError(f"a chunk of {size} bytes, {packed} packed, in {len(data)} bytes")
    chunk = Chunk(
        compression=compression,
        data=data,  # type: ignore[arg-type]  # a view will do
        message_end_time=last,
        message_start_time=first,
        uncompressed_crc=crc,
        uncompressed_size=size,
    )
    payload = data
    if compression:
        try:
            stream, unpacked = get_chunk_data_stream(chunk)
            payload = memoryview(stream.read(unpacked))
        except Exception as error:  # zstd and lz4 raise exceptions of their own
            raise ValueError(f"a chunk that cannot be unpacked: {error}") from None
    actual = crc32(payload) if crc or sealed else 0
    if actual != crc:
        raise ValueError(f"the chunk has CRC {actual:08x}, should have {crc:08x}")
    records, position = [], 0
    while position < len(payload):
        opcode, length = RECORD_HEAD.unpack_from(payload, position)
        end = position + RECORD_HEAD.size + length
        if end > len(payload) or (opcode == Opcode.MESSAGE and length < MESSAGE_FIXED):
            raise ValueError(f"a record of {length} bytes at byte {position} of a chunk of {len(payload)}")
        records.append(InnerRecord(opcode, position, end))
        position = end
    return Unpacked(chunk, payload, records)


def find_chunk(fd: int, at: int, sealed: bool = False) -> int | None:
    """Return the offset of the first chunk at or after `at` whose lengths and CRC are right; None where there is none.

    Where a chunk has no CRC, its records are checked instead: schemas, channels, and messages of its time only.
    """
    with mmap.mmap(fd, 0, prot=mmap.PROT_READ) as view:
        for match in _CHUNK_START.finditer(view, at):
            start = match.start()
            if start + CHUNK_HEAD.size > len(view):
                return None
            _, length, first, last, size, crc, name_length, packed = CHUNK_HEAD.unpack_from(view, start)
            end = start + RECORD_HEAD.size + length
            plain = name_length == 0 and size == packed == length - CHUNK_HEAD.size + RECORD_HEAD.size
            if not (plain or name_length in (3, 4)) or first > last or end > len(view):  # 3, 4: lz4, zstd
                continue
            try:
                unpacked = unpack_chunk(view[start:end], sealed)
                if not crc and not _plausible(unpacked, first, last):
                    continue
            except PARSE_ERRORS:
                continue
            return start
    return None


def _plausible(unpacked: Unpacked, first: int, last: int) -> bool:
    """Return whether a chunk with these first and last log times may hold these records."""
    opcodes = {record.opcode for record in unpacked.records}
    times = (
        unpack_message(unpacked.payload, record.start, record.end, -1).log_time
        for record in unpacked.records
        if record.opcode == Opcode.MESSAGE
    )
    return (
        Opcode.MESSAGE in opcodes
        and opcodes <= {Opcode.SCHEMA, Opcode.CHANNEL, Opcode.MESSAGE}
        and all(first <= time <= last for time in times)
    )
