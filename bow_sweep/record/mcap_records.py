"""Records of an MCAP file taken apart: chunks and what is in them, with every length checked before it is believed."""

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

from bow_sweep.record.mcap_writer import CHUNK_HEAD, MESSAGE_FIXED, MESSAGE_HEAD

MAX_CHUNK = 1 << 28
"""Bytes of a chunk unpacked at most: a compressed chunk may claim anything."""

PARSE_ERRORS = (struct.error, McapError, UnicodeDecodeError, KeyError, ValueError, MemoryError)
"""What bytes that are not what they should be raise, here and in mcap's readers."""

_CHUNK_START = re.compile(rb"\x06.{5}\x00\x00\x00", re.DOTALL)


class Damage(NamedTuple):
    """Bytes of a file that are not what was written."""

    start: int
    end: int
    what: str
    kind: str = "bytes"
    """"bytes": in the data; "index": of a chunk, which tells what is right; "end": from the end of the data on;
    "tail": after a whole end; "data": somewhere in the data, not known where."""
    right: bytes = b""
    """What should stand there, where that is known."""


class Message(NamedTuple):
    """A message of a file; `data` is a view that lives as long as it is held."""

    channel: int
    sequence: int
    log_time: int
    publish_time: int
    data: memoryview
    offset: int
    """Of `data` in the file; -1 in a compressed chunk."""


def unpack_message(record: bytes | memoryview, start: int, end: int, offset: int) -> Message:
    """Return the message whose record is at `start` to `end`; `offset` is where its data are in the file."""
    _, _, channel, sequence, log_time, publish_time = MESSAGE_HEAD.unpack_from(record, start)
    data = memoryview(record)[start + MESSAGE_HEAD.size : end]
    return Message(channel, sequence, log_time, publish_time, data, offset)


def unpack_chunk(record: bytes, sealed: bool = False) -> tuple[Chunk, memoryview, list[tuple[int, int, int]]]:
    """Return a chunk record, its unpacked payload, and (opcode, start, end) of the records in there.

    A CRC of zero means that there is none, as MCAP says; in a file that is `sealed` every chunk has one.

    Raises
    ------
    ValueError
        Where a length or the CRC does not hold; other `PARSE_ERRORS` where bytes make no sense.
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
        except Exception as error:  # zstd and lz4 raise their own
            raise ValueError(f"a chunk that cannot be unpacked: {error}") from None
    actual = crc32(payload) if crc or sealed else 0
    if actual != crc:
        raise ValueError(f"the chunk has CRC {actual:08x}, should have {crc:08x}")
    inner, position = [], 0
    while position < len(payload):
        opcode, length = struct.unpack_from("<BQ", payload, position)
        end = position + 9 + length
        if end > len(payload) or (opcode == Opcode.MESSAGE and length < MESSAGE_FIXED):
            raise ValueError(f"a record of {length} bytes at byte {position} of a chunk of {len(payload)}")
        inner.append((opcode, position, end))
        position = end
    return chunk, payload, inner


def find_chunk(fd: int, at: int, sealed: bool = False) -> int | None:
    """Return where the first chunk at or after `at` begins whose lengths and CRC hold, if any.

    Without a CRC the records in it have to make sense: nothing but schemas, channels and messages of its time.
    """
    with mmap.mmap(fd, 0, prot=mmap.PROT_READ) as view:
        for match in _CHUNK_START.finditer(view, at):
            start = match.start()
            if start + CHUNK_HEAD.size > len(view):
                return None
            _, length, first, last, size, crc, name_length, packed = CHUNK_HEAD.unpack_from(view, start)
            plain = name_length == 0 and size == packed == length - CHUNK_HEAD.size + 9
            if not (plain or name_length in (3, 4)) or first > last or length > len(view) - start - 9:
                continue
            try:
                _, payload, inner = unpack_chunk(view[start : start + 9 + length], sealed)
                if not crc and not _plausible(payload, inner, first, last):
                    continue
            except PARSE_ERRORS:
                continue
            return start
    return None


def _plausible(payload: memoryview, inner: list[tuple[int, int, int]], first: int, last: int) -> bool:
    """Whether records are what a chunk with these first and last log times may hold."""
    opcodes = {opcode for opcode, _, _ in inner}
    times = (
        unpack_message(payload, start, end, -1).log_time for opcode, start, end in inner if opcode == Opcode.MESSAGE
    )
    return (
        Opcode.MESSAGE in opcodes
        and opcodes <= {Opcode.SCHEMA, Opcode.CHANNEL, Opcode.MESSAGE}
        and all(first <= time <= last for time in times)
    )
