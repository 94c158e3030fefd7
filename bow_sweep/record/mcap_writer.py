"""Writes one MCAP file, a chunk at a time: a committed chunk is complete in the file, with its index.

The writer of the mcap package copies each message four times and reads it twice for the two CRCs: 0.8 s of CPU for the
456 MB of a map. Here `os.writev` writes the bytes of a message as they came. Other records are built with mcap.
"""

from __future__ import annotations

import os
import struct
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path

from isal.isal_zlib import crc32, crc32_combine
from mcap.data_stream import RecordBuilder
from mcap.opcode import Opcode
from mcap.records import (
    AttachmentIndex,
    Channel,
    ChunkIndex,
    DataEnd,
    Footer,
    Header,
    McapRecord,
    MessageIndex,
    Metadata,
    MetadataIndex,
    Schema,
    Statistics,
    SummaryOffset,
)

from bow_sweep.record.reserve import Reserve

MAGIC = b"\x89MCAP0\r\n"
LIBRARY = "bow"
RECORD_HEAD = struct.Struct("<BQ")
"""Opcode and length of what follows: the head of every record."""
CHUNK_HEAD = struct.Struct("<BQQQQIIQ")
"""Opcode, length, first and last log time, size, CRC, length of the compression's name (0: none), size again.

The head of an uncompressed chunk record; see https://mcap.dev/spec.
"""
MESSAGE_HEAD = struct.Struct("<BQHIQQ")
"""Opcode, length, channel, sequence, log time, publish time."""
MESSAGE_FIXED = MESSAGE_HEAD.size - RECORD_HEAD.size
FOOTER_SIZE = RECORD_HEAD.size + 20

APPLICATION_OPCODES = 0x80
"""From here on MCAP leaves opcodes to applications; readers skip records that they do not know."""

COVERED = 0xB0
"""Opcode of a record that covers damaged bytes."""

PIECE = 1 << 18
"""Bytes that are written at a time, up to the next multiple of it in the file.

Linux keeps what is written at a time in blocks of memory of that size, 2 MB at most. Blocks of 2 MB are those that a
virtual machine has given back to its host, and getting them again took four times as long as writing into them. Blocks
of this size also fit into a message, so that they can be dropped from memory where only its contents are in them.
"""

HEAD = 512
"""Bytes that a check by index reads of a stream message: its identity and checksum are in the first hundred."""

BULK = 2 * PIECE
"""A message of so many bytes is large: some of its blocks of memory have nothing but its contents."""

_MAX_PARTS = 512  # os.writev takes 1024 at most


def pack(*records: McapRecord) -> bytes:
    """Return records as bytes."""
    builder = RecordBuilder()
    for record in records:
        record.write(builder)
    data: bytes = builder.end()
    return data


def index_of(entries: Mapping[int, Sequence[tuple[int, int]]], offset: int) -> tuple[bytes, dict[int, int]]:
    """Return the message index that follows a chunk, and the offset in the file of each channel's part.

    Parameters
    ----------
    entries
        Channel -> (log time, offset within the chunk) of its messages.
    offset
        Of the index in the file.
    """
    offsets, parts = {}, []
    for channel, records in entries.items():
        offsets[channel] = offset
        parts.append(pack(MessageIndex(channel, list(records))))
        offset += len(parts[-1])
    return b"".join(parts), offsets


class Contents:
    """The contents of a file's summary; updated with every chunk that is written or read.

    Attributes
    ----------
    schemas, channels
        By their numbers.
    chunks, attachments, metadata
        Index records.
    counts
        Channel number -> messages.
    start, end
        First and last log time, nanoseconds since 1970; 0 where there is no message.
    """

    def __init__(self) -> None:
        self.schemas: dict[int, Schema] = {}
        self.channels: dict[int, Channel] = {}
        self.chunks: list[ChunkIndex] = []
        self.counts: dict[int, int] = {}
        self.attachments: list[AttachmentIndex] = []
        self.metadata: list[MetadataIndex] = []
        self.start = self.end = 0

    @property
    def messages(self) -> int:
        """Number of messages."""
        return sum(self.counts.values())

    def note_time(self, start: int, end: int, first: bool) -> None:
        """Extend the span of log times; start it with the `first` chunk or message."""
        self.start = start if first else min(self.start, start)
        self.end = end if first else max(self.end, end)

    def statistics(self) -> Statistics:
        """Return the statistics record."""
        return Statistics(
            attachment_count=len(self.attachments),
            channel_count=len(self.channels),
            channel_message_counts=dict(self.counts),
            chunk_count=len(self.chunks),
            message_count=self.messages,
            message_end_time=self.end,
            message_start_time=self.start,
            metadata_count=len(self.metadata),
            schema_count=len(self.schemas),
        )

    def ending(self, offset: int, data_crc: int) -> bytes:
        """Return the bytes after the data section, which ends at `offset`: its CRC, the summary, the footer."""
        data_end = pack(DataEnd(data_crc))
        summary_start = offset + len(data_end)
        groups: list[tuple[Opcode, list[McapRecord]]] = [
            (Opcode.SCHEMA, list(self.schemas.values())),
            (Opcode.CHANNEL, list(self.channels.values())),
            (Opcode.STATISTICS, [self.statistics()]),
            (Opcode.CHUNK_INDEX, list(self.chunks)),
            (Opcode.ATTACHMENT_INDEX, list(self.attachments)),
            (Opcode.METADATA_INDEX, list(self.metadata)),
        ]
        summary, offsets = b"", []
        for opcode, records in groups:
            group = pack(*records)
            if group:
                offsets.append(SummaryOffset(opcode, summary_start + len(summary), len(group)))
            summary += group
        offsets_start = summary_start + len(summary)
        summary += pack(*offsets)
        fixed = struct.pack("<BQQQ", Opcode.FOOTER, 20, summary_start, offsets_start)
        crc = crc32(fixed, crc32(summary))
        return data_end + summary + pack(Footer(summary_start, offsets_start, crc)) + MAGIC


class McapWriter:
    """Writes a new MCAP file. After an `OSError` the file ends with the last commit.

    Parameters
    ----------
    path
        The file to create; must not exist.
    schemas, channels
        All that will be used; written at the start.
    notes
        Metadata records, written after them.
    """

    def __init__(
        self, path: Path, schemas: Iterable[Schema], channels: Iterable[Channel], notes: Iterable[Metadata] = ()
    ) -> None:
        self.path = path
        self.contents = Contents()
        self.contents.schemas = {schema.id: schema for schema in schemas}
        self.contents.channels = {channel.id: channel for channel in channels}
        self.contents.counts = dict.fromkeys(self.contents.channels, 0)
        self._fd = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_CLOEXEC, 0o644)
        self._reserve = Reserve(self._fd)
        self._offset = 0
        self._crc = 0
        self._bulk: list[tuple[int, int]] = []
        self._reset()
        start = MAGIC + pack(Header("ros2", LIBRARY), *self.contents.schemas.values(), *self.contents.channels.values())
        for note in notes:
            record = pack(note)
            self.contents.metadata.append(MetadataIndex(offset=len(start), length=len(record), name=note.name))
            start += record
        try:
            self._append([start])
        except OSError:
            self.abandon()
            path.unlink()
            raise
        self._crc = crc32(start)

    def _reset(self) -> None:
        self._parts: list[bytes | memoryview] = []
        self._entries: dict[int, list[tuple[int, int]]] = {}
        self._chunk_crc = 0
        self._start = self._end = 0
        self.pending = 0
        """Bytes added and not yet committed."""

    def add(self, channel: int, sequence: int, log_time: int, publish_time: int, data: bytes | memoryview) -> None:
        """Add a message to the chunk in progress; times in nanoseconds since 1970."""
        head = MESSAGE_HEAD.pack(
            Opcode.MESSAGE, MESSAGE_FIXED + len(data), channel, sequence & 0xFFFFFFFF, log_time, publish_time
        )
        if not self._parts:
            self._start = self._end = log_time
        self._start, self._end = min(self._start, log_time), max(self._end, log_time)
        self._entries.setdefault(channel, []).append((log_time, self.pending))
        self._parts += (head, data)
        self._chunk_crc = crc32(data, crc32(head, self._chunk_crc))
        self.pending += len(head) + len(data)

    def commit(self) -> None:
        """Write the chunk in progress and its index to the file.

        Raises
        ------
        OSError
            Where it cannot be written; the file is truncated to the commit before, and the messages stay pending.
        """
        if not self._parts:
            return
        size = self.pending
        length = CHUNK_HEAD.size - RECORD_HEAD.size + size
        head = CHUNK_HEAD.pack(Opcode.CHUNK, length, self._start, self._end, size, self._chunk_crc, 0, size)
        index_start = self._offset + len(head) + size
        index, offsets = index_of(self._entries, index_start)
        chunk = ChunkIndex(
            chunk_length=len(head) + size,
            chunk_start_offset=self._offset,
            compression="",
            compressed_size=size,
            message_end_time=self._end,
            message_index_length=len(index),
            message_index_offsets=offsets,
            message_start_time=self._start,
            uncompressed_size=size,
        )
        offset = self._offset
        self._append([head, *self._parts, index])
        self._note_bulk(offset + len(head))
        # The CRC of the messages is known: that of the file is joined from it, without reading them again.
        self._crc = crc32(index, crc32_combine(crc32(head, self._crc), self._chunk_crc, size))
        contents = self.contents
        contents.note_time(self._start, self._end, first=not contents.chunks)
        contents.chunks.append(chunk)
        for channel, entries in self._entries.items():
            contents.counts[channel] += len(entries)
        self._reset()

    def _note_bulk(self, offset: int) -> None:
        """Note where the large messages are of the chunk whose messages begin at `offset`."""
        for part in self._parts:
            if len(part) >= BULK:
                self._bulk.append((offset + HEAD, offset + len(part)))
            offset += len(part)

    def take_bulk(self) -> list[tuple[int, int]]:
        """Return (first, end) in the file of the large messages committed since the last call, without their heads."""
        bulk, self._bulk = self._bulk, []
        return bulk

    def finish(self) -> None:
        """Commit, write summary and footer, sync the file to the disk, close it.

        Raises
        ------
        OSError
            Where it cannot be written; the file then ends with the last commit, and is closed.
        """
        try:
            self.commit()
            self._append([self.contents.ending(self._offset, self._crc)])
            os.fsync(self._fd)
        finally:
            self.abandon()

    def fileno(self) -> int:
        """Return the file descriptor, for syncs; it is closed at the end."""
        return self._fd

    def abandon(self) -> None:
        """Close the file without writing what is pending, nor the summary."""
        if self._fd >= 0:
            self._reserve.release(self._offset)
            os.close(self._fd)
            self._fd = -1

    def _append(self, parts: list[bytes | memoryview]) -> None:
        total = sum(map(len, parts))
        self._reserve.prepare(self._offset, total)
        try:
            write_all(self._fd, parts, self._offset)
        except OSError:
            os.ftruncate(self._fd, self._offset)
            os.lseek(self._fd, self._offset, os.SEEK_SET)
            raise
        self._offset += total


def write_all(fd: int, parts: Iterable[bytes | memoryview], offset: int) -> None:
    """Write all parts at `offset`, where the file ends, in pieces that end at multiples of `PIECE`."""
    left = [memoryview(part) for part in parts if len(part)]
    at = 0  # of what is left
    while at < len(left):
        piece, room = [], PIECE - offset % PIECE
        for part in left[at : at + _MAX_PARTS]:
            piece.append(part[:room])
            room -= len(piece[-1])
            if not room:
                break
        written = os.writev(fd, piece)  # perhaps less than asked for
        offset += written
        while at < len(left) and written >= len(left[at]):
            written -= len(left[at])
            at += 1
        if written:
            left[at] = left[at][written:]
