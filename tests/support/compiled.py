"""Where Numba stores the code that it compiles in a test."""

from __future__ import annotations

from pathlib import Path

import numba
import pytest


def keep_code_in(directory: Path | None, monkeypatch: pytest.MonkeyPatch) -> None:
    """Set NUMBA_CACHE_DIR for a test; None: no directory of the user's.

    The setting must be in the environment too: Numba's compiler reads all its settings from there again whenever a
    variable NUMBA_... is not what it was at the last compilation, and an earlier test may have changed one.
    """
    text = "" if directory is None else str(directory)
    monkeypatch.setattr(numba.config, "CACHE_DIR", text)
    monkeypatch.setenv("NUMBA_CACHE_DIR", text)
