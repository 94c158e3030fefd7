"""Options of Numba that several modules share. Does not import Numba."""

from __future__ import annotations

from typing import Any

LEAN: dict[str, Any] = {"nogil": True, "error_model": "numpy", "_nrt": False}
"""For functions that are called for every cell: reference counts would take a fifth of the time."""
