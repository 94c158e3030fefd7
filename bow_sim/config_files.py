"""Finds the files of config/, in a source tree and in an installation."""

from __future__ import annotations

from pathlib import Path


def find_config(name: str) -> Path | None:
    """Return a file or folder of config/, or None where there is none of this name.

    It is searched for in every folder above this module: as ``config/NAME`` in the source tree, as
    ``share/bow/config/NAME`` below the prefix of an installation.
    """
    for above in Path(__file__).resolve().parents:
        for path in (above / "config" / name, above / "share" / "bow" / "config" / name):
            if path.exists():
                return path
    return None
