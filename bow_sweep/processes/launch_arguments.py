"""Reads the arguments of the launch files; shared, because each file is loaded alone.

`ros2 launch` may run in a Python that lacks our requirements, so this module and the packages that contain it import
the standard library only. Every function raises RuntimeError for a wrong argument: its name, its value, and what would
be right; `ros2 launch` prints that.
"""

from __future__ import annotations

import os
import re
from pathlib import Path

RANGE = "ROS_AUTOMATIC_DISCOVERY_RANGE"
"""Environment variable of ROS: how far nodes look for each other."""

RANGES = ("LOCALHOST", "SUBNET", "SYSTEM_DEFAULT")

DEFAULT_RANGE = "LOCALHOST"

SWITCH = ("true", "false", "True", "False")
"""What an argument takes that switches something; people write Python's words too."""

LEVELS = ("debug", "info", "warn", "error", "fatal")
"""Levels of the nodes' logs, from all lines to nearly none."""


def discovery_range(text: str) -> str:
    """Return the value for `RANGE`."""
    if text.upper() not in RANGES:
        why = ": with it no node finds another" if text.upper() == "OFF" else ""
        where = f"discovery_range:={text} ({RANGE} is its default)"
        raise RuntimeError(f"{where}{why}; LOCALHOST, for this machine alone, or SUBNET is needed")
    return text.upper()


def namespace(text: str) -> str:
    """Return a ROS namespace."""
    if not re.fullmatch("/?([A-Za-z_][A-Za-z0-9_]*/)*[A-Za-z_][A-Za-z0-9_]*/?", text):
        raise RuntimeError(f"namespace:={text}: letters, digits and _ are needed, parted by /, as in bow or lab/bow")
    return text


def readable_file(name: str, text: str) -> str:
    """Return the absolute path of a file that can be read."""
    path = _absolute(text)
    try:
        with open(path, "rb"):
            return path
    except OSError as error:
        raise RuntimeError(f"{name}:={text}: cannot be read: {error.strerror}; a file is needed") from None


def writable_directory(name: str, text: str) -> str:
    """Return the absolute path of a directory; create it if it is missing."""
    path = _absolute(text)
    try:
        Path(path).mkdir(parents=True, exist_ok=True)
        if not os.access(path, os.W_OK | os.X_OK):
            raise PermissionError(0, "it is not writable for you")
    except OSError as error:
        why = f"cannot be made or written: {error.strerror}"
        raise RuntimeError(f"{name}:={text}: {why}; a directory of yours is needed") from None
    return path


def run_directory(name: str, text: str) -> str:
    """Return the absolute path of a run that can be resumed."""
    path = _absolute(text)
    if not os.path.isdir(path):  # noqa: PTH112  # as above
        raise RuntimeError(f"{name}:={text}: is no directory; that of an unfinished run is needed")
    if not any(os.path.exists(os.path.join(path, part)) for part in ("ledger.jsonl", "bag")):  # noqa: PTH110, PTH118
        raise RuntimeError(f"{name}:={text}: has neither ledger.jsonl nor bag/; the directory of a run is needed")
    return path


def log_level(text: str) -> str:
    """Return the level of the nodes' logs."""
    if text.lower() not in LEVELS:
        raise RuntimeError(f"log_level:={text}: one of {', '.join(LEVELS)} is needed")
    return text.lower()


def is_on(name: str, text: str) -> bool:
    """Return whether a switch is on."""
    return bool(switch(name, text))


def _absolute(text: str) -> str:
    return os.path.abspath(os.path.expanduser(text))  # noqa: PTH100, PTH111  # Path.expanduser raises for "~nobody"


def switch(name: str, text: str) -> dict[str, bool]:
    """Return {name: True} for true; {} for false, which leaves the parameter as the file of parameters has it."""
    if text.lower() not in ("true", "false"):
        raise RuntimeError(f"{name}:={text}: true or false is needed")
    return {name: True} if text.lower() == "true" else {}


def count(name: str, text: str, most: int) -> int:
    """Return a whole number from 1 to `most`."""
    number = int(text) if re.fullmatch("[0-9]{1,9}", text) else 0
    if not 1 <= number <= most:
        raise RuntimeError(f"{name}:={text}: a whole number from 1 on, to {most}, is needed")
    return number


def rate(text: str) -> str:
    """Return the speed of a replay: a number above 0, as text."""
    try:
        if 0 < float(text) < 1e6:
            return text
    except ValueError:
        pass
    raise RuntimeError(f"rate:={text}: a number above 0 is needed, 1.0 for the speed of the recording")
