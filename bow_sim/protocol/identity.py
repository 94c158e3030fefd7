"""New identities for runs and nodes."""

from __future__ import annotations

import secrets


def random_id() -> str:
    """Return a new identity for a run or an incarnation: 16 hexadecimal digits, the first a letter.

    It is also the name of the run's namespace, and ROS names must not begin with a digit.
    """
    return secrets.choice("abcdef") + secrets.token_hex(8)[1:]
