"""The contents of a bag according to its index: fast, for the end of every sweep.

Plans, verdicts and receipts are read completely, stream messages only up to their identity and checksum. Wrong bytes
within a waveform are not found: :class:`bow_sweep.record.bag_contents.Survey` reads everything.
"""

from __future__ import annotations

import os
from collections.abc import Iterator
from io import BytesIO
from typing import Any

from mcap.data_stream import ReadDataStream
from mcap.opcode import Opcode
from mcap.records import Channel, ChunkIndex, Footer, MessageIndex, Metadata, MetadataIndex, Schema, Statistics
from mcap.stream_reader import StreamReader

from bow_sim.protocol import cdr
from bow_sweep.record.bag import BagMessage, label
from bow_sweep.record.bag_contents import Survey
from bow_sweep.record.mcap_reader import Scan
from bow_sweep.record.mcap_records import PARSE_ERRORS, Message
from bow_sweep.record.mcap_writer import (
    CHUNK_HEAD,
    FOOTER_SIZE,
    HEAD,
    MAGIC,
    MESSAGE_FIXED,
    MESSAGE_HEAD,
    RECORD_HEAD,
    Contents,
)
from bow_sweep.record.metadata import FileInfo
from bow_sweep.record.topics import STORED_ONCE, short_name

READ_WHOLE = ("plan", "verdicts", "receipts")
"""Topics whose messages are read completely."""


class IndexSurvey(Survey):
    """Finds the messages of complete, uncompressed files by their index."""

    def read_file(self, scan: Scan) -> Iterator[Message]:
        """Take in the messages in the index of a file, and yield them one by one."""
        scan.finished = True  # an incomplete file is reported as a problem, not as torn
        descriptor = os.open(scan.path, os.O_RDONLY | os.O_CLOEXEC)
        try:
            scan.size = os.fstat(descriptor).st_size
            scan.contents, notes = _summary(descriptor, scan.size)
            for message in _messages(descriptor, scan.contents):
                self._take(label(scan.contents, message, scan.path))
                yield message
            self._take_notes(notes, scan.path)
        except PARSE_ERRORS as error:
            self.problem(f"its index cannot be used: {error}", file=scan.path.name)
        finally:
            os.close(descriptor)
        self._check_types(scan)
        self.files.append(FileInfo.of(scan.path.name, scan.contents))

    def _opened(self, name: str, message: BagMessage) -> dict[str, Any]:
        return cdr.decode_head(name, message.data)

    def _take(self, message: BagMessage) -> None:
        if message.topic == "basin_map":
            message = message._replace(topic="")  # only its number is checked
        super()._take(message)

    def _checked(self, message: BagMessage) -> dict[str, Any]:
        if message.topic == "verdicts":
            return super()._checked(message)
        assert self.expected is not None
        values = cdr.decode_head(STORED_ONCE[message.topic], message.data)
        if reason := self.expected.identity_objection(values):
            raise cdr.WireError(reason)
        return values


def _summary(descriptor: int, size: int) -> tuple[Contents, list[Metadata]]:
    """Return the contents of a file's summary, and its metadata records."""
    end = os.pread(descriptor, FOOTER_SIZE + len(MAGIC), size - FOOTER_SIZE - len(MAGIC))
    if not end.endswith(MAGIC) or end[0] != Opcode.FOOTER:
        raise ValueError("it does not end with a footer")
    start = Footer.read(ReadDataStream(BytesIO(end[RECORD_HEAD.size :]))).summary_start
    if not 0 < start <= size:
        raise ValueError("it has no summary")
    contents = Contents()
    for record in StreamReader(BytesIO(os.pread(descriptor, size - start, start)), skip_magic=True).records:
        match record:
            case Schema():
                contents.schemas[record.id] = record
            case Channel():
                contents.channels[record.id] = record
            case ChunkIndex():
                contents.chunks.append(record)
            case MetadataIndex():
                contents.metadata.append(record)
            case Statistics():
                contents.counts = {**dict.fromkeys(contents.channels, 0), **record.channel_message_counts}
                contents.start, contents.end = record.message_start_time, record.message_end_time
    notes = [_metadata(os.pread(descriptor, index.length, index.offset)) for index in contents.metadata]
    return contents, notes


def _metadata(record: bytes) -> Metadata:
    return Metadata.read(ReadDataStream(BytesIO(record[RECORD_HEAD.size :])))


def _messages(descriptor: int, contents: Contents) -> Iterator[Message]:
    """Yield the messages of a file in order, their data cut after `HEAD` bytes unless they are read completely."""
    for chunk in contents.chunks:
        if chunk.compression:
            raise ValueError("its chunks are compressed")
        base = chunk.chunk_start_offset + CHUNK_HEAD.size
        index = os.pread(descriptor, chunk.message_index_length, chunk.chunk_start_offset + chunk.chunk_length)
        places = sorted((offset, channel) for channel, offset in _entries(index))
        for offset, channel in places:
            whole = short_name(contents.channels[channel].topic) in READ_WHOLE
            data = os.pread(descriptor, HEAD, base + offset)
            _, length, its, sequence, log_time, publish_time = MESSAGE_HEAD.unpack_from(data)
            if its != channel:
                raise ValueError(f"the index has channel {channel} at byte {base + offset}, there is {its}")
            size = length - MESSAGE_FIXED
            start = base + offset + MESSAGE_HEAD.size
            if whole and size > HEAD - MESSAGE_HEAD.size:
                data = data[: MESSAGE_HEAD.size] + os.pread(descriptor, size, start)
            view = memoryview(data)[MESSAGE_HEAD.size : MESSAGE_HEAD.size + size]
            yield Message(channel, sequence, log_time, publish_time, view, start, size - len(view))


def _entries(index: bytes) -> Iterator[tuple[int, int]]:
    """Yield (channel, offset in the chunk) of the messages in the index after a chunk."""
    at = 0
    while at + RECORD_HEAD.size <= len(index):
        opcode, length = RECORD_HEAD.unpack_from(index, at)
        if opcode != Opcode.MESSAGE_INDEX:
            raise ValueError("after a chunk there is no message index")
        end = at + RECORD_HEAD.size + length
        part = MessageIndex.read(ReadDataStream(BytesIO(index[at + RECORD_HEAD.size : end])))
        yield from ((part.channel_id, offset) for _, offset in part.records)
        at = end
