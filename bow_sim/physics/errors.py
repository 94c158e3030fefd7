"""The error of a parameter that cannot be."""

from __future__ import annotations


class ParameterError(ValueError):
    """A parameter that cannot be: the message names its path, its value and what would be right."""
