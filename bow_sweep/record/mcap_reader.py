"""Reads an MCAP file, complete or cut off, in one pass that checks everything in it that has a checksum.

Damaged bytes are never skipped silently: they are listed as :class:`Damage`, and reading continues at the next chunk
whose CRC is right. A file that only ends too early is *torn*: a killed writer leaves such files. In our own files every
record is checked for its place; in files of other writers everything is accepted that MCAP allows.
"""

from __future__ import annotations

import os
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
from bow_sweep.record.mcap_writer import (
    APPLICATION_OPCODES,
    COVERED,
    FOOTER_SIZE,
    LIBRARY,
    MAGIC,
    MESSAGE_HEAD,
    RECORD_HEAD,
    Contents,
    index_of,
)

OUR_START = (Opcode.SCHEMA, Opcode.CHANNEL, Opcode.METADATA)
"""Records of our files between the header and the first chunk."""

DATA_END_SIZE = RECORD_HEAD.size + 4

Entries = dict[int, list[tuple[int, int]]]
"""Channel -> (log time, offset in the chunk) of its messages, as MessageIndex of the mcap package takes them."""


class Scan:
    """Reads the chunks of a file in order, then its end. The attributes are valid when :meth:`messages` is exhausted.

    Attributes
    ----------
    contents
        The contents of a summary of the undamaged part.
    notes
        The metadata records.
    damage
        Damaged parts, in the order of the file.
    finished
        The file has a complete end: data end, summary, footer, magic.
    good_end
        End of the last complete record; a torn file is kept up to here.
    missing_index
        The message index that belongs at `good_end`, where the file was cut within it.
    data_crc
        CRC-32 of the bytes up to `good_end`, then of `missing_index`.
    library
        Name of the writer, from the header.
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
        """Read the file for its attributes; return this object."""
        for _ in self.messages():
            pass
        return self

    @property
    def whole(self) -> bool:
        """Whether the file is complete and undamaged."""
        return self.finished and not self.damage

    @property
    def ours(self) -> bool:
        """Whether the file was written by bow, as its header states."""
        return self.library == LIBRARY

    def _read(self, start: int, end: int) -> bytes:
        parts = []
        while start < end:
            parts.append(os.pread(self._fd, end - start, start))
            if not parts[-1]:
                raise OSError(f"{self.path}: ends at byte {start}, should go on to {end}: it shrank while it was read")
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
                if at + RECORD_HEAD.size <= self.size:
                    opcode, length = RECORD_HEAD.unpack(self._read(at, at + RECORD_HEAD.size))
                    end = at + RECORD_HEAD.size + length
                if at + RECORD_HEAD.size > self.size or end > self.size:
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
                elif opcode == Opcode.MESSAGE and not self.ours:  # a file without chunks has neither CRC nor index
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
        """Take in a record that is neither chunk nor message; `at` is its offset, -1 inside a chunk."""
        stream = ReadDataStream(BytesIO(data[RECORD_HEAD.size :]))
        contents = self.contents
        if self.ours and opcode != COVERED and (at < 0 or contents.chunks or opcode not in OUR_START):
            raise ValueError(f"a record with opcode {opcode:#04x}, where files of bow have none")
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
        elif opcode < APPLICATION_OPCODES:
            raise ValueError(f"no record of a data section has opcode {opcode:#04x}")

    def _single(self, message: Message) -> Message:
        self.contents.note_time(message.log_time, message.log_time, first=not self.contents.messages)
        self.contents.counts[message.channel] += 1
        return message

    def _chunk(self, at: int, record: bytes) -> Generator[Message, None, int]:
        """Yield the messages of the chunk at `at`; return where its index ends."""
        chunk, payload, records = unpack_chunk(record, self.ours)
        head = len(record) - len(chunk.data)
        entries: Entries = {}
        found = []
        for opcode, start, stop in records:
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
        """Check the message index after a chunk; return its end."""
        at, found, offsets = start, {}, {}
        while at + RECORD_HEAD.size <= self.size:
            opcode, length = RECORD_HEAD.unpack(self._read(at, at + RECORD_HEAD.size))
            start_of_data, end = at + RECORD_HEAD.size, at + RECORD_HEAD.size + length
            if opcode != Opcode.MESSAGE_INDEX or end > self.size:
                break
            try:
                index = MessageIndex.read(ReadDataStream(BytesIO(self._read(start_of_data, end))))
            except PARSE_ERRORS:
                break
            offsets[index.channel_id] = at
            found[index.channel_id] = sorted(index.records)
            at = end
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
        """Note damage at `at`; return the offset of the next undamaged chunk.

        Without one, the file is torn if a record reaches past its end (`torn`) and no magic stands there.
        """
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
        """Check the bytes after the data section, which ends at `at`."""
        data = self._read(at, self.size)
        expected = self.contents.ending(at, self.data_crc)
        ours = self.ours and not self.damage
        whole = len(expected) if ours and data.startswith(expected) else _length_of_ending(data)
        if whole and whole < len(data):
            what = "bytes that do not belong to the file, after its end"
            self.damage.append(Damage(at + whole, self.size, what, "tail"))
            data = data[:whole]
        if not data.endswith(MAGIC) or len(data) < DATA_END_SIZE + FOOTER_SIZE + len(MAGIC):
            if ours and not expected.startswith(data):
                what = "the end of the file is not the one of its data"
                self.damage.append(Damage(at, self.size, what, "end"))
            return
        self.finished = True
        data_end = ReadDataStream(BytesIO(data[RECORD_HEAD.size : DATA_END_SIZE]))
        data_crc = DataEnd.read(data_end).data_section_crc
        if data_crc != self.data_crc and (data_crc or ours):
            what = f"the data section has CRC {self.data_crc:08x}, should have {data_crc:08x}"
            if ours and data[DATA_END_SIZE:] == expected[DATA_END_SIZE:]:  # only the CRC is wrong
                self.damage.append(Damage(at, self.size, what, "end"))
            elif all(damage.kind == "tail" for damage in self.damage):  # otherwise other damage is the reason
                self.damage.append(Damage(0, at, what, "data"))
        elif ours and data != expected:
            differs = next((i for i, pair in enumerate(zip(data, expected, strict=False)) if pair[0] != pair[1]), -1)
            byte = at + (differs if differs >= 0 else min(len(data), len(expected)))
            self.damage.append(Damage(byte, byte + 1, "the summary is not the one of the data before it", "end"))
        elif not ours:
            self._foreign_summary(at, data)

    def _foreign_summary(self, at: int, data: bytes) -> None:
        footer_at = len(data) - FOOTER_SIZE - len(MAGIC)
        footer = Footer.read(ReadDataStream(BytesIO(data[footer_at + RECORD_HEAD.size :])))
        position = footer.summary_start - at if footer.summary_start else footer_at
        crc = crc32(data[max(position, 0) : footer_at + FOOTER_SIZE - 4])  # without the CRC itself
        if position < DATA_END_SIZE or (footer.summary_crc and crc != footer.summary_crc):
            what = f"the summary has CRC {crc:08x}, the footer has {footer.summary_crc:08x}"
            self.damage.append(Damage(at, self.size, what, "end"))
            return
        while position + RECORD_HEAD.size <= footer_at:
            opcode, length = RECORD_HEAD.unpack_from(data, position)
            if opcode == Opcode.STATISTICS:
                count = Statistics.read(ReadDataStream(BytesIO(data[position + RECORD_HEAD.size :]))).message_count
                if count != self.contents.messages:
                    what = f"the file has {self.contents.messages} messages, its summary has {count}"
                    self.damage.append(Damage(at, self.size, what, "end"))
            position += RECORD_HEAD.size + length


def _length_of_ending(data: bytes) -> int:
    """Return the number of bytes from the data end to the magic at the start of `data`; 0 where one is missing."""
    position = 0
    while position + RECORD_HEAD.size <= len(data):
        opcode, length = RECORD_HEAD.unpack_from(data, position)
        position += RECORD_HEAD.size + length
        if opcode == Opcode.FOOTER:
            end = position + len(MAGIC)
            return end if length == FOOTER_SIZE - RECORD_HEAD.size and data[position:end] == MAGIC else 0
    return 0
