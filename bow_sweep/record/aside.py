"""What is taken out of a bag is set aside in a folder beside it, under a name that tells what it was; never deleted."""

from __future__ import annotations

import os
import shutil
from pathlib import Path

from bow_sim.atomic_files import sync_directory

PIECE = 1 << 22
"""Bytes copied at a time."""


def folder_of(directory: Path) -> Path:
    """Return where what is taken out of a bag goes: beside it, so that readers of the bag never see it."""
    directory = directory.absolute()
    return directory.with_name(f"{directory.name}_aside")


def free_name(path: Path) -> Path:
    """Return `path`, or where it exists the same with a number before its ending."""
    number, free = 0, path
    while os.path.lexists(free):
        number += 1
        free = path.with_name(f"{path.stem}.{number}{path.suffix}")
    return free


def _place(path: Path, name: str) -> Path:
    folder = folder_of(path.parent)
    folder.mkdir(exist_ok=True)
    return free_name(folder / name)


def set_aside(path: Path) -> Path:
    """Move a file out of a bag; return where it is now."""
    to = _place(path, path.name)
    shutil.move(path, to)
    sync_directory(to.parent)
    sync_directory(path.parent)
    return to


def copy_aside(path: Path, start: int, end: int) -> Path:
    """Copy bytes of a file of a bag, which are about to be overwritten or cut off; return where they are, on disk."""
    to = _place(path, f"{path.name}.bytes-{start}-{end}")
    with open(path, "rb") as source, open(to, "xb") as file:
        source.seek(start)
        while start < end:
            piece = source.read(min(PIECE, end - start))
            if not piece:
                break
            file.write(piece)
            start += len(piece)
        file.flush()
        os.fsync(file.fileno())
    sync_directory(to.parent)
    return to
