"""Interface definitions in the form of a bag: the .msg text with all nested types, the type hash, and QoS as YAML.

They are read from the ament share directories (``share/<package>/msg/<Type>.msg`` and ``.json``), which both a ROS
installation and the wheels have.
"""

from __future__ import annotations

import importlib.util
import json
import os
import re
import sys
from functools import lru_cache
from pathlib import Path

from bow_sweep.record.topics import Qos

_PRIMITIVES = re.compile("bool|byte|char|float(32|64)|u?int(8|16|32|64)|w?string")
_TYPE_NAME = re.compile(r"([a-z][a-z0-9_]*)/(?:msg/)?([A-Z][A-Za-z0-9]*)")
_SEPARATOR = "=" * 80
_FOREVER = {"sec": 9223372036, "nsec": 854775807}


class SchemaError(LookupError):
    """The definition of a message type is not installed; the message names the folders that were searched."""


def share_file(package: str, name: str) -> Path:
    """Return a file of a package's share directory.

    Raises
    ------
    SchemaError
        Where no installation prefix has it.
    """
    prefixes = [Path(entry) for entry in os.environ.get("AMENT_PREFIX_PATH", "").split(os.pathsep) if entry]
    prefixes.append(Path(sys.prefix))
    spec = importlib.util.find_spec(package)  # finds, does not import: <prefix>/lib/pythonX.Y/site-packages/<package>
    if spec is not None and spec.origin is not None and len(Path(spec.origin).parents) > 4:
        prefixes.append(Path(spec.origin).parents[4])
    for prefix in prefixes:
        path = prefix / "share" / package / name
        if path.is_file():
            return path
    raise SchemaError(f"{name} of package {package!r}: not in share/{package} of {', '.join(map(str, prefixes))}")


def _split(type_name: str) -> tuple[str, str]:
    match = _TYPE_NAME.fullmatch(type_name)
    if match is None:
        raise SchemaError(f"message type {type_name!r}: should be of the form package/msg/Type")
    return match[1], match[2]


def _nested(package: str, text: str) -> list[str]:
    """Return the types of the fields in a .msg text that are messages themselves, in order, as package/Type."""
    found = []
    for line in text.splitlines():
        field = line.partition("#")[0].split()
        if len(field) < 2:
            continue
        name = re.split(r"[\[<]", field[0])[0]
        if _PRIMITIVES.fullmatch(name):
            continue
        found.append("/".join(_split(name if "/" in name else f"{package}/{name}")))
    return found


@lru_cache
def definition(type_name: str) -> str:
    """Return the ros2msg schema of ``package/msg/Type``: its .msg file, then those of all nested types.

    Raises
    ------
    SchemaError
        Where a file is not installed.
    """
    package, name = _split(type_name)
    text = share_file(package, f"msg/{name}.msg").read_text()
    parts, pending, seen = [text], _nested(package, text), {f"{package}/{name}"}
    while pending:
        nested = pending.pop(0)
        if nested in seen:
            continue
        seen.add(nested)
        package, name = _split(nested)
        text = share_file(package, f"msg/{name}.msg").read_text()
        parts.append(f"{_SEPARATOR}\nMSG: {nested}\n{text}")
        pending += _nested(package, text)
    return "\n".join(part.rstrip("\n") for part in parts) + "\n"


@lru_cache
def type_hash(type_name: str) -> str:
    """Return the RIHS01 hash of ``package/msg/Type``, by which ROS compares the types of two nodes.

    Raises
    ------
    SchemaError
        Where the description is not installed or lacks the hash.
    """
    package, name = _split(type_name)
    path = share_file(package, f"msg/{name}.json")
    for entry in json.loads(path.read_text())["type_hashes"]:
        if entry["type_name"] == f"{package}/msg/{name}":
            return str(entry["hash_string"])
    raise SchemaError(f"{path}: has no hash of {package}/msg/{name}")


def qos_lines(qos: Qos) -> list[str]:
    """Return a QoS profile as lines of a YAML list item, as rosbag2 of Jazzy writes it."""

    def duration(name: str) -> list[str]:
        return [f"  {name}:"] + [f"    {unit}: {value}" for unit, value in _FOREVER.items()]

    return [
        f"- history: {qos.history}",
        f"  depth: {qos.depth}",
        f"  reliability: {qos.reliability}",
        f"  durability: {qos.durability}",
        *duration("deadline"),
        *duration("lifespan"),
        "  liveliness: automatic",
        *duration("liveliness_lease_duration"),
        "  avoid_ros_namespace_conventions: false",
    ]
