"""New names for runs and nodes."""

from __future__ import annotations

import secrets


def random_id() -> str:
    """Return a new identity for a run or an incarnation: 16 hexadecimal digits, the first a letter.

    A run's namespace is named by it, and ROS names do not begin with a digit.
    """
    return secrets.choice("abcdef") + secrets.token_hex(8)[1:]
