"""The options of the dashboard, checked before any process starts. A sweep runs without a dashboard if it must."""

from __future__ import annotations

import importlib.util
import os
import re
import socket
from collections.abc import Mapping
from dataclasses import dataclass

LOOPBACK = "127.0.0.1"
"""The only address at which our processes listen."""

MOST_PORT = 65535

NOTE = "; note: "
"""Separates the notes for the user in `Health.detail` of a dashboard."""

NO_DISPLAY = "there is no display here"
"""Text where DISPLAY and WAYLAND_DISPLAY are empty."""

NO_RERUN = "rerun is not installed, so there is no dashboard; what would be right: pip install 'rerun-sdk>=0.39,<0.42'"


class WantedError(ValueError):
    """Options that a dashboard cannot serve; the text says what would be right."""


@dataclass(frozen=True)
class Wanted:
    """The dashboard of a sweep.

    Attributes
    ----------
    dashboard
        Whether there is one.
    window
        Whether a viewer is opened here.
    port
        Of 127.0.0.1, where viewers are served; 0 = they are not.
    notes
        Lines for the user before the sweep starts.
    """

    dashboard: bool
    window: bool = False
    port: int = 0
    notes: tuple[str, ...] = ()


def wanted(view: bool, port: str, without: bool, environment: Mapping[str, str] = os.environ) -> Wanted:
    """Check the options ``--view``, ``--port`` and ``--no-dashboard``.

    Raises
    ------
    WantedError
        Where they contradict each other, or the port cannot be used.
    """
    number = port_number(port)
    if without:
        if view or number:
            asked = "--view" if view else f"--port {number}"
            raise WantedError(f"{asked} needs the dashboard that --no-dashboard leaves out; give one of them")
        return Wanted(False)
    if number and (problem := port_problem(number)):
        raise WantedError(f"--port {number}: {problem}")
    if not _is_installed("rerun"):
        return Wanted(False, notes=(NO_RERUN,))
    if view and not has_display(environment):
        unseen = f"--view: {NO_DISPLAY} (DISPLAY and WAYLAND_DISPLAY are empty); the map is served instead"
        return Wanted(True, port=number or free_port(), notes=(unseen,))
    return Wanted(True, window=view, port=number)


def _is_installed(package: str) -> bool:
    try:
        return importlib.util.find_spec(package) is not None
    except ValueError:  # sys.modules has an object of this name that is not a package
        return False


def port_number(text: str) -> int:
    """Return a port as a number; 0 = no port.

    Raises
    ------
    WantedError
        Where the text is not a port.
    """
    if not re.fullmatch("[0-9]{1,5}", text) or int(text) > MOST_PORT:
        raise WantedError(f"--port {text}: should be a whole number from 1 to {MOST_PORT}, or 0 for none")
    return int(text)


def port_problem(port: int) -> str:
    """Return why a port of 127.0.0.1 cannot be used, or ""."""
    with socket.socket() as trial:
        trial.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)  # a port in TIME_WAIT can be used
        try:
            trial.bind((LOOPBACK, port))
        except PermissionError:
            return "is kept for privileged users; should be 1024 or more"
        except OSError as error:
            return f"cannot be used on {LOOPBACK} ({error.strerror}); should be a free one"
    return ""


def free_port() -> int:
    """Return a free port of 127.0.0.1."""
    with socket.socket() as trial:
        trial.bind((LOOPBACK, 0))
        return int(trial.getsockname()[1])


def has_display(environment: Mapping[str, str] = os.environ) -> bool:
    """Return whether there is a display for the window of a viewer."""
    return bool(environment.get("DISPLAY") or environment.get("WAYLAND_DISPLAY"))
