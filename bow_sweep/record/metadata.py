"""metadata.yaml of a bag, version 9, as rosbag2 of ROS 2 Jazzy writes it.

Its entries depend on the files alone, so that they can be derived again and compared. They are compared by meaning:
other tools use another order and format, and people add entries, which are kept.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import yaml
from mcap.records import Channel, Schema

from bow_sweep.record.mcap_writer import Contents
from bow_sweep.record.schema import definition, qos_lines, type_hash
from bow_sweep.record.topics import Topic

VERSION = 9
DISTRO = "jazzy"
ROOT = "rosbag2_bagfile_information"

NESTED_QOS = 9
"""From this version on QoS profiles are YAML; before, they are a string that contains YAML."""

HASHED = 9
"""From this version on every topic has the hash of its type."""

_LOADER = getattr(yaml, "CSafeLoader", yaml.SafeLoader)


class TopicInfo(NamedTuple):
    """The entry of a topic in metadata.yaml."""

    type: str
    qos: str
    hash: str


@dataclass(frozen=True)
class FileInfo:
    """The entry of a file in metadata.yaml: log times in nanoseconds since 1970, messages by full topic name."""

    name: str
    start: int
    end: int
    counts: Mapping[str, int]
    topics: Mapping[str, TopicInfo]

    @classmethod
    def of(cls, name: str, contents: Contents) -> FileInfo:
        """Return the entry of a file that was written or read."""
        topics: dict[str, TopicInfo] = {}
        counts: dict[str, int] = {}
        for channel in contents.channels.values():
            schema = contents.schemas.get(channel.schema_id)
            details = channel.metadata
            topics[channel.topic] = TopicInfo(
                schema.name if schema else "",
                details.get("offered_qos_profiles", ""),
                details.get("topic_type_hash", ""),
            )
            counts[channel.topic] = counts.get(channel.topic, 0) + contents.counts.get(channel.id, 0)
        return cls(name, contents.start, contents.end, counts, topics)

    @property
    def messages(self) -> int:
        """Number of messages."""
        return sum(self.counts.values())


class Definitions(NamedTuple):
    """The records that describe the topics of a file."""

    schemas: list[Schema]
    channels: list[Channel]


def definitions(topics: Mapping[str, Topic]) -> Definitions:
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
    return Definitions(list(schemas.values()), channels)


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


def render(files: Sequence[FileInfo], others: Mapping[str, Any] | None = None) -> str:
    """Return the text of metadata.yaml for the files of a bag, in order, with the entries of `others`."""
    filled = [file for file in files if file.messages]
    start = min((file.start for file in filled), default=0)
    end = max((file.end for file in filled), default=0)
    topics: dict[str, TopicInfo] = {}
    for file in files:
        for name, info in file.topics.items():
            topics.setdefault(name, info)
    lines = [
        f"{ROOT}:",
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
    if others:
        lines += [f"  {line}" for line in yaml.safe_dump(dict(others), sort_keys=False).splitlines()]
    if "custom_data" not in (others or {}):
        lines.append("  custom_data: ~")
    lines.append(f"  ros_distro: {DISTRO}")
    return "\n".join(lines) + "\n"


OURS = (
    *("version", "storage_identifier", "duration", "starting_time", "message_count", "topics_with_message_count"),
    *("compression_format", "compression_mode", "relative_file_paths", "files", "ros_distro"),
)
"""Entries that are written here; all others, as `custom_data`, are kept."""


class MetadataError(ValueError):
    """A text is not a metadata.yaml; the message states why."""


def parse(text: bytes) -> dict[str, Any]:
    """Return the entries of metadata.yaml.

    Raises
    ------
    MetadataError
        Where it is not YAML, or not the information on a bag.
    """
    try:
        content = yaml.load(text.decode(), _LOADER)  # a safe loader
    except (yaml.YAMLError, ValueError, RecursionError) as error:
        raise MetadataError(f"is no YAML: {' '.join(str(error).split())[:200]}") from None
    info = content.get(ROOT) if isinstance(content, dict) else None
    if not isinstance(info, dict):
        raise MetadataError(f"holds no {ROOT}" if text.strip(b"\0 \r\n\t") else "is empty")
    return info


def others_part(info: Mapping[str, Any]) -> dict[str, Any]:
    """Return the entries of metadata.yaml that others have added, which are kept."""
    return {name: value for name, value in info.items() if name not in OURS and value is not None}


def with_custom_data(others: Mapping[str, Any], ours: Mapping[str, str]) -> dict[str, Any]:
    """Return the entries that others have added, with `ours` in `custom_data`, where rosbag2 keeps what users add."""
    given = others.get("custom_data")
    data = {**(given if isinstance(given, dict) else {}), **ours}
    return {**others, "custom_data": data} if data else dict(others)


def differences(info: Mapping[str, Any], files: Sequence[FileInfo]) -> list[str]:
    """Return the differences between metadata.yaml and the files of the bag, as texts for people."""
    try:
        given, right = _meaning(info), _meaning(parse(render(files).encode()))
    except (AttributeError, KeyError, TypeError, ValueError, yaml.YAMLError) as error:
        return [f"makes no sense: {error!r}"]
    if given.get("compression_mode"):
        mode, kind = given["compression_mode"], info.get("compression_format")
        return [f"states that the bag is compressed ({kind}, by {mode}); its files are not"]
    out = []
    for name in [*right, *(name for name in given if name not in right)]:
        value, should = given.get(name), right.get(name)
        if value == should or (value is None and (name in _OPTIONAL or name.startswith(_HASH))):
            continue
        empty = name.startswith("topic ") and None in (value, should) and (value or should or (0,))[-1] == 0
        if not empty:  # other tools omit topics without messages
            out.append(f"{name} is {value!r}, the files make it {should!r}")
    return out


_HASH = "type_description_hash"
_OPTIONAL = ("files", "duration", "starting_time", "compression_mode")
"""Entries that old versions do not have, or only of some bags."""


def _meaning(info: Mapping[str, Any]) -> dict[str, Any]:
    """Return the entries of metadata.yaml in one flat form for all versions and orders.

    Raises
    ------
    AttributeError, KeyError, TypeError, ValueError
        Where entries are missing or wrong.
    """
    version = info["version"]
    if type(version) is not int or version < 1:
        raise ValueError(f"version {version!r}")
    if version >= HASHED:  # these always have both entries, empty or not
        info["compression_format"], info["compression_mode"]
    out: dict[str, Any] = {
        "storage_identifier": info["storage_identifier"],
        "message_count": info["message_count"],
        "relative_file_paths": sorted(info["relative_file_paths"] or []),
        "compression_mode": str(info.get("compression_mode") or "").replace("NONE", "") or None,
    }
    if info["message_count"]:
        out["duration"] = info["duration"]["nanoseconds"]
        out["starting_time"] = info["starting_time"]["nanoseconds_since_epoch"]
    for topic in info["topics_with_message_count"] or []:
        details = topic["topic_metadata"]
        qos = details.get("offered_qos_profiles") or []
        if bool(qos) and isinstance(qos, str) == (version >= NESTED_QOS):
            raise ValueError(f"QoS of {details['name']} as {type(qos).__name__} in version {version}")
        qos = yaml.load(qos, _LOADER) if isinstance(qos, str) else qos
        out[f"topic {details['name']}"] = (
            details["type"],
            details["serialization_format"],
            [_plain(profile) for profile in qos],
            topic["message_count"],
        )
        if _HASH in details or version >= HASHED:
            out[f"{_HASH} of {details['name']}"] = details.get(_HASH) or ""
    files = [_file(file) for file in info.get("files") or []]
    out["files"] = sorted(files) or None
    return out


def _file(file: Mapping[str, Any]) -> tuple[Any, ...]:
    count = file["message_count"]
    span = (file["starting_time"]["nanoseconds_since_epoch"], file["duration"]["nanoseconds"]) if count else ()
    return (file["path"], count, *span)


_NAMES = {
    "history": {1: "keep_last", 2: "keep_all"},
    "reliability": {1: "reliable", 2: "best_effort"},
    "durability": {1: "transient_local", 2: "volatile"},
    "liveliness": {1: "automatic", 3: "manual_by_topic"},
}
"""Old versions have numbers in place of these names."""

_INFINITE = ((9223372036, 854775807), (2147483647, 4294967295), (0, 0))
"""(seconds, nanoseconds) that tools write for an infinite duration."""


def _plain(profile: Mapping[str, Any]) -> dict[str, Any]:
    """Return a QoS profile with the names of the current version."""
    out = {}
    for name, value in profile.items():
        if isinstance(value, dict):
            span = (value.get("sec"), value.get("nsec"))
            out[name] = "infinite" if span in _INFINITE else dict(value)
        else:
            out[name] = _NAMES.get(name, {}).get(value, value)
    return out
