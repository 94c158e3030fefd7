"""Bags as bow wrote them before version 3: other names of topics, and messages without stamps and headers."""

from __future__ import annotations

from pathlib import Path

from mcap.records import Channel, Metadata, Schema

from bow_sim.protocol.messages import FRAME
from bow_sweep.record.bag import bag_files, write_metadata
from bow_sweep.record.mcap_reader import Scan
from bow_sweep.record.mcap_writer import McapWriter
from bow_sweep.record.metadata import FileInfo
from bow_sweep.record.topics import NAMESPACE

ADDED = {
    b"builtin_interfaces/Time stamp": 8,
    b"std_msgs/Header header": 8 + 4 + len(FRAME) + 1,
}
"""First line of a definition today -> bytes that messages did not have then."""


def _old(schema: Schema) -> tuple[Schema, int]:
    """Return a type as it was, and how many bytes its messages had fewer."""
    own = schema.data.split(b"=" * 80)[0]
    lines = own.splitlines(keepends=True)
    for first, size in ADDED.items():
        left = [line for line in lines if not line.startswith(first)]
        if schema.name.startswith("bow_msgs/") and len(left) < len(lines):
            return Schema(id=schema.id, name=schema.name, encoding=schema.encoding, data=b"".join(left)), size
    return schema, 0


def make_old(run: Path, namespace: str) -> None:
    """Write the bag of a run again as version 2, as a recorder in a namespace did; a torn file stays torn."""
    bag, infos = run / "bag", []
    for path in bag_files(bag):
        scan = Scan(path)
        found = list(scan.messages())
        olds = {schema.id: _old(schema) for schema in scan.contents.schemas.values()}
        channels = []
        for channel in scan.contents.channels.values():
            topic = channel.topic.replace(f"{NAMESPACE}/", f"{namespace}/")
            changed = olds[channel.schema_id][1] > 0
            hashed = {"topic_type_hash": "RIHS01_" + "0" * 64} if changed else {}
            details = {**channel.metadata, **hashed}
            channels.append(Channel(channel.id, topic, channel.message_encoding, details, channel.schema_id))
        notes = [note for note in scan.notes if note.name != "bow.record"]
        path.unlink()
        writer = McapWriter(
            path, [old for old, _ in olds.values()], channels, [Metadata("bow.record", {"version": "2"}), *notes]
        )
        for message in found:
            fewer = olds[scan.contents.channels[message.channel].schema_id][1]
            data = bytes(message.data[:4]) + bytes(message.data[4 + fewer :])
            writer.add(message.channel, message.sequence, message.log_time, message.publish_time, data)
            writer.commit()
        infos.append(FileInfo.of(path.name, writer.contents))
        writer.finish() if scan.finished else writer.abandon()
    (bag / "metadata.yaml").unlink()
    write_metadata(bag, infos)
