"""The run of a measured string: a sweep of one cell, of which only the end says how long it is.

Its plan has the preset `MEASURED`. Period, bow position and sample rate are those at which the string is judged; the
other parameters of the string say nothing. ``Plan.fingerprint`` says in words what was measured.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

MEASURED = "measured"
"""Preset of the plan."""


def is_measured(plan: Mapping[str, Any]) -> bool:
    """Return whether a decoded Plan is of a measured string."""
    return bool(plan["spec.preset"] == MEASURED)
