"""metadata.yaml of a bag, version 9, as rosbag2 of ROS 2 Jazzy writes it.

The text is a function of the files alone, so that a checker can write it again and compare every byte.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

from mcap.records import Channel, Schema

from .mcapfile import Contents
from .schema import definition, qos_lines, type_hash
from .topics import Topic

VERSION = 9
DISTRO = "jazzy"


class TopicInfo(NamedTuple):
    """What metadata.yaml says of a topic."""

    type: str
    qos: str
    hash: str


@dataclass(frozen=True)
class FileInfo:
    """What metadata.yaml says of a file: log times in nanoseconds since 1970, messages by full topic name."""

    name: str
    start: int
    end: int
    counts: Mapping[str, int]
    topics: Mapping[str, TopicInfo]

    @classmethod
    def of(cls, name: str, contents: Contents) -> FileInfo:
        """Return it for a file written or read."""
        topics: dict[str, TopicInfo] = {}
        counts: dict[str, int] = {}
        for channel in contents.channels.values():
            schema = contents.schemas.get(channel.schema_id)
            said = channel.metadata
            topics[channel.topic] = TopicInfo(
                schema.name if schema else "", said.get("offered_qos_profiles", ""), said.get("topic_type_hash", "")
            )
            counts[channel.topic] = counts.get(channel.topic, 0) + contents.counts.get(channel.id, 0)
        return cls(name, contents.start, contents.end, counts, topics)

    @property
    def messages(self) -> int:
        """Messages in all."""
        return sum(self.counts.values())


def records(topics: Mapping[str, Topic]) -> tuple[list[Schema], list[Channel]]:
    """Return the schemas and channels of a file that will hold `topics`, by their full names.

    Raises
    ------
    SchemaError
        Where a type is not installed.
    """
    schemas: dict[str, Schema] = {}
    channels = []
    for number, (name, topic) in enumerate(topics.items(), 1):
        if topic.type not in schemas:
            text = definition(topic.type).encode()
            schemas[topic.type] = Schema(id=len(schemas) + 1, name=topic.type, encoding="ros2msg", data=text)
        channels.append(
            Channel(
                id=number,
                topic=name,
                message_encoding="cdr",
                schema_id=schemas[topic.type].id,
                metadata={
                    "offered_qos_profiles": "\n".join(qos_lines(topic.qos)) + "\n",
                    "topic_type_hash": type_hash(topic.type),
                },
            )
        )
    return list(schemas.values()), channels


def _topic_lines(name: str, info: TopicInfo, count: int) -> list[str]:
    qos = info.qos.splitlines()
    return [
        "    - topic_metadata:",
        f"        name: {name}",
        f"        type: {info.type}",
        "        serialization_format: cdr",
        "        offered_qos_profiles:" + ("" if qos else " []"),
        *(f"          {line}" for line in qos),
        f"        type_description_hash: {info.hash}",
        f"      message_count: {count}",
    ]


def render(files: Sequence[FileInfo]) -> str:
    """Return the text of metadata.yaml for the files of a bag, in order."""
    filled = [file for file in files if file.messages]
    start = min((file.start for file in filled), default=0)
    end = max((file.end for file in filled), default=0)
    topics: dict[str, TopicInfo] = {}
    for file in files:
        for name, info in file.topics.items():
            topics.setdefault(name, info)
    lines = [
        "rosbag2_bagfile_information:",
        f"  version: {VERSION}",
        "  storage_identifier: mcap",
        "  duration:",
        f"    nanoseconds: {end - start}",
        "  starting_time:",
        f"    nanoseconds_since_epoch: {start}",
        f"  message_count: {sum(file.messages for file in files)}",
        "  topics_with_message_count:" + ("" if topics else " []"),
    ]
    for name, info in topics.items():
        lines += _topic_lines(name, info, sum(file.counts.get(name, 0) for file in files))
    lines += ['  compression_format: ""', '  compression_mode: ""', "  relative_file_paths:"]
    lines += [f"    - {file.name}" for file in files]
    lines.append("  files:")
    for file in files:
        lines += [
            f"    - path: {file.name}",
            "      starting_time:",
            f"        nanoseconds_since_epoch: {file.start}",
            "      duration:",
            f"        nanoseconds: {file.end - file.start}",
            f"      message_count: {file.messages}",
        ]
    lines += ["  custom_data: ~", f"  ros_distro: {DISTRO}"]
    return "\n".join(lines) + "\n"
