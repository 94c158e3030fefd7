"""The error for a wrong parameter."""

from __future__ import annotations


class ParameterError(ValueError):
    """A parameter is wrong: the message names its path and its value, and states what would be right."""
