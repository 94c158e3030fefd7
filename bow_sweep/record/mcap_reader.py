"""One pass over an MCAP file, whole or cut off, that checks everything in it that has a checksum.

Nothing is skipped in silence: bytes that are not what they should be are a :class:`Damage`, and reading goes on at the
next chunk whose CRC holds. A file that just ends too early is *torn*: that is what a killed writer leaves. Of our own
files it is known what may be in them and where; of others' whatever MCAP allows is taken.
"""

from __future__ import annotations

import os
import struct
from collections.abc import Generator, Iterator
from io import BytesIO
from pathlib import Path

from isal.isal_zlib import crc32
from mcap.data_stream import ReadDataStream
from mcap.opcode import Opcode
from mcap.records import (
    Attachment,
    AttachmentIndex,
    Channel,
    Chunk,
    ChunkIndex,
    DataEnd,
    Footer,
    Header,
    MessageIndex,
    Metadata,
    MetadataIndex,
    Schema,
    Statistics,
)

from bow_sweep.record.mcap_records import PARSE_ERRORS, Damage, Message, find_chunk, unpack_chunk, unpack_message
from bow_sweep.record.mcap_writer import COVERED, FOOTER_SIZE, LIBRARY, MAGIC, MESSAGE_HEAD, Contents, index_of

OUR_START = (Opcode.SCHEMA, Opcode.CHANNEL, Opcode.METADATA)
"""What our files have before their first chunk, after the header."""

Entries = dict[int, list[tuple[int, int]]]
"""Channel -> (log time, offset in the chunk) of its messages."""


class Scan:
    """Reads a file's chunks in order, then its end. Exhaust :meth:`messages` before trusting the attributes.

    Attributes
    ----------
    contents
        What a summary of the good part would say.
    notes
        The metadata records.
    damage
        What does not hold.
    finished
        The file has all of an end: data end, summary, footer, magic.
    good_end
        Where the last complete record ends: what is kept of a torn file.
    missing_index
        The message index that should stand at `good_end`, where the file was cut within it.
    data_crc
        CRC-32 of the bytes up to `good_end`, then of `missing_index`.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self.size = 0
        self.contents = Contents()
        self.notes: list[Metadata] = []
        self.damage: list[Damage] = []
        self.finished = False
        self.good_end = 0
        self.missing_index = b""
        self.data_crc = 0
        self.library = ""

    def messages(self) -> Iterator[Message]:
        """Yield every message of every good chunk, in the order of the file."""
        self._fd = os.open(self.path, os.O_RDONLY | os.O_CLOEXEC)
        try:
            self.size = os.fstat(self._fd).st_size
            yield from self._walk()
        finally:
            os.close(self._fd)

    def run(self) -> Scan:
        """Read everything for the attributes alone."""
        for _ in self.messages():
            pass
        return self

    @property
    def whole(self) -> bool:
        """Whether everything is there and holds."""
        return self.finished and not self.damage

    @property
    def ours(self) -> bool:
        """Whether the file says that it was written here."""
        return self.library == LIBRARY

    def _read(self, start: int, end: int) -> bytes:
        parts = []
        while start < end:
            parts.append(os.pread(self._fd, end - start, start))
            if not parts[-1]:
                raise OSError(f"{self.path}: ends at byte {start}, was to go on to {end}: it shrank while it was read")
            start += len(parts[-1])
        return parts[0] if len(parts) == 1 else b"".join(parts)

    def _walk(self) -> Iterator[Message]:
        at = min(len(MAGIC), self.size)
        head = self._read(0, at)
        if not MAGIC.startswith(head):
            self.damage.append(Damage(0, at, f"the file starts with {head.hex()}, an MCAP file with {MAGIC.hex()}"))
        if at < len(MAGIC):
            return
        self._accept(at, head)
        while at < self.size:
            what = ""
            end = self.size
            try:
                if at + 9 <= self.size:
                    opcode, length = struct.unpack("<BQ", self._read(at, at + 9))
                    end = at + 9 + length
                if at + 9 > self.size or end > self.size:
                    at = self._resume(at, "the record reaches past the end of the file", torn=True)
                    continue
                if opcode == Opcode.DATA_END:
                    after = find_chunk(self._fd, end, self.ours)
                    if after is None:
                        self._ending(at)
                        return
                    raise ValueError("the data section ends here, and chunks come after it")
                data = self._read(at, end)
                if opcode == Opcode.CHUNK:
                    end = yield from self._chunk(at, data)
                elif opcode == Opcode.MESSAGE and not self.ours:  # a file without chunks: no CRC, no index
                    yield self._single(unpack_message(data, 0, len(data), at + MESSAGE_HEAD.size))
                    self._accept(end, data)
                else:
                    self._record(opcode, data, at)
                    self._accept(end, data)
            except PARSE_ERRORS as error:
                what = str(error) if isinstance(error, ValueError) else f"the record makes no sense: {error!r}"
            at = self._resume(at, what) if what else end

    def _accept(self, end: int, data: bytes) -> None:
        self.good_end = end
        self.data_crc = crc32(data, self.data_crc)

    def _record(self, opcode: int, data: bytes, at: int) -> None:
        """Take in a record that is neither chunk nor message; `at` is -1 inside a chunk."""
        stream = ReadDataStream(BytesIO(data[9:]))
        contents = self.contents
        if self.ours and opcode != COVERED and (at < 0 or contents.chunks or opcode not in OUR_START):
            raise ValueError(f"a record with opcode {opcode:#04x}, where our files have none")
        if opcode == Opcode.HEADER:
            self.library = Header.read(stream).library
        elif opcode == Opcode.SCHEMA:
            schema = Schema.read(stream)
            contents.schemas[schema.id] = schema
        elif opcode == Opcode.CHANNEL:
            channel = Channel.read(stream)
            contents.channels[channel.id] = channel
            contents.counts.setdefault(channel.id, 0)
        elif opcode == Opcode.ATTACHMENT:
            a = Attachment.read(stream)
            place = (at, len(data), a.log_time, a.create_time, len(a.data))
            contents.attachments.append(AttachmentIndex(*place, a.name, a.media_type))
        elif opcode == Opcode.METADATA:
            self.notes.append(Metadata.read(stream))
            contents.metadata.append(MetadataIndex(at, len(data), self.notes[-1].name))
        elif opcode < 0x80:  # from there on they are anybody's
            raise ValueError(f"no record of a data section has opcode {opcode:#04x}")

    def _single(self, message: Message) -> Message:
        self.contents.note_time(message.log_time, message.log_time, first=not self.contents.messages)
        self.contents.counts[message.channel] += 1
        return message

    def _chunk(self, at: int, record: bytes) -> Generator[Message, None, int]:
        """Yield the messages of the chunk at `at`; return where its index ends."""
        chunk, payload, inner = unpack_chunk(record, self.ours)
        head = len(record) - len(chunk.data)
        entries: Entries = {}
        found = []
        for opcode, start, stop in inner:
            if opcode != Opcode.MESSAGE:
                self._record(opcode, bytes(payload[start:stop]), -1)
                continue
            offset = -1 if chunk.compression else at + head + start + MESSAGE_HEAD.size
            message = unpack_message(payload, start, stop, offset)
            if message.channel not in self.contents.channels:
                raise ValueError(f"a message of channel {message.channel}, which no record before it describes")
            entries.setdefault(message.channel, []).append((message.log_time, start))
            found.append(message)
        times = [message.log_time for message in found]
        if self.ours and (min(times, default=0), max(times, default=0)) != (
            chunk.message_start_time,
            chunk.message_end_time,
        ):
            raise ValueError("the chunk's first and last time are not those of its messages")
        self._note(at, len(record), chunk, entries)
        self.data_crc = crc32(record, self.data_crc)
        self.good_end = at + len(record)
        after = self._index(self.good_end, entries)
        yield from found
        return after

    def _note(self, at: int, length: int, chunk: Chunk, entries: Entries) -> None:
        contents = self.contents
        index, offsets = index_of(entries, at + length)
        if entries:
            contents.note_time(chunk.message_start_time, chunk.message_end_time, first=not contents.messages)
        for channel, records in entries.items():
            contents.counts[channel] += len(records)
        contents.chunks.append(
            ChunkIndex(
                chunk_length=length,
                chunk_start_offset=at,
                compression=chunk.compression,
                compressed_size=len(chunk.data),
                message_end_time=chunk.message_end_time,
                message_index_length=len(index),
                message_index_offsets=offsets,
                message_start_time=chunk.message_start_time,
                uncompressed_size=chunk.uncompressed_size,
            )
        )

    def _index(self, start: int, entries: Entries) -> int:
        """Check the message index after a chunk; return where it ends."""
        at, found, offsets = start, {}, {}
        while at + 9 <= self.size:
            opcode, length = struct.unpack("<BQ", self._read(at, at + 9))
            if opcode != Opcode.MESSAGE_INDEX or at + 9 + length > self.size:
                break
            try:
                index = MessageIndex.read(ReadDataStream(BytesIO(self._read(at + 9, at + 9 + length))))
            except PARSE_ERRORS:
                break
            offsets[index.channel_id] = at
            found[index.channel_id] = sorted(index.records)
            at += 9 + length
        expected = {channel: sorted(records) for channel, records in entries.items()}
        if found == expected or (not found and self.library != LIBRARY):
            self._accept(at, self._read(start, at))
            self.contents.chunks[-1].message_index_offsets = offsets
            self.contents.chunks[-1].message_index_length = at - start
            return at
        right, _ = index_of(entries, start)
        if start + len(right) > self.size:
            self.missing_index = right
            self.data_crc = crc32(right, self.data_crc)
            return self.size
        what = "the message index is not that of the chunk before it"
        self.damage.append(Damage(start, start + len(right), what, "index", right))
        self._accept(start + len(right), right)
        return start + len(right)

    def _resume(self, at: int, what: str, torn: bool = False) -> int:
        """Return where a good chunk begins after bad bytes; a file without one that just stops is torn."""
        after = find_chunk(self._fd, at + 1, self.ours)
        if after is None:
            ends = self._read(max(at, self.size - len(MAGIC)), self.size) == MAGIC
            if torn and not ends:
                return self.size
            self.damage.append(Damage(at, self.size, what, "bytes" if ends else "end"))
            return self.size
        self.damage.append(Damage(at, after, what))
        return after

    def _ending(self, at: int) -> None:
        """Check what follows the data section, which ends at `at`."""
        data = self._read(at, self.size)
        expected = self.contents.ending(at, self.data_crc)
        ours = self.ours and not self.damage
        whole = len(expected) if ours and data.startswith(expected) else _length_of_ending(data)
        if whole and whole < len(data):
            what = "bytes that do not belong to the file, after its end"
            self.damage.append(Damage(at + whole, self.size, what, "tail"))
            data = data[:whole]
        if not data.endswith(MAGIC) or len(data) < 13 + FOOTER_SIZE + len(MAGIC):
            if ours and not expected.startswith(data):
                what = "the end of the file is not the one of its data"
                self.damage.append(Damage(at, self.size, what, "end"))
            return
        self.finished = True
        data_crc = DataEnd.read(ReadDataStream(BytesIO(data[9:13]))).data_section_crc
        if data_crc != self.data_crc and (data_crc or ours):
            what = f"the data section has CRC {self.data_crc:08x}, should have {data_crc:08x}"
            if ours and data[13:] == expected[13:]:  # all is right but the CRC
                self.damage.append(Damage(at, self.size, what, "end"))
            elif all(damage.kind == "tail" for damage in self.damage):  # else it is known why
                self.damage.append(Damage(0, at, what, "data"))
        elif ours and data != expected:
            differs = next((i for i, pair in enumerate(zip(data, expected, strict=False)) if pair[0] != pair[1]), -1)
            byte = at + (differs if differs >= 0 else min(len(data), len(expected)))
            self.damage.append(Damage(byte, byte + 1, "the summary is not the one of the data before it", "end"))
        elif not ours:
            self._foreign_summary(at, data)

    def _foreign_summary(self, at: int, data: bytes) -> None:
        footer_at = len(data) - FOOTER_SIZE - len(MAGIC)
        footer = Footer.read(ReadDataStream(BytesIO(data[footer_at + 9 :])))
        position = footer.summary_start - at if footer.summary_start else footer_at
        crc = crc32(data[max(position, 0) : footer_at + 25])
        if position < 13 or (footer.summary_crc and crc != footer.summary_crc):
            what = f"the summary has CRC {crc:08x}, the footer says {footer.summary_crc:08x}"
            self.damage.append(Damage(at, self.size, what, "end"))
            return
        while position + 9 <= footer_at:
            opcode, length = struct.unpack_from("<BQ", data, position)
            if opcode == Opcode.STATISTICS:
                said = Statistics.read(ReadDataStream(BytesIO(data[position + 9 :]))).message_count
                if said != self.contents.messages:
                    what = f"the file has {self.contents.messages} messages, its summary says {said}"
                    self.damage.append(Damage(at, self.size, what, "end"))
            position += 9 + length


def _length_of_ending(data: bytes) -> int:
    """Return how many bytes data end, summary, footer and magic have at the start of `data`; 0 where one is missing."""
    position = 0
    while position + 9 <= len(data):
        opcode, length = struct.unpack_from("<BQ", data, position)
        position += 9 + length
        if opcode == Opcode.FOOTER:
            end = position + len(MAGIC)
            return end if length == FOOTER_SIZE - 9 and data[position:end] == MAGIC else 0
    return 0
