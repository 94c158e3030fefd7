"""Keeps what is taken out of a bag, in a folder beside it: whole files, and ranges of bytes. Nothing is deleted."""

from __future__ import annotations

import os
import shutil
from pathlib import Path

from bow_sim.atomic_files import sync_directory
from bow_sweep.record.bag import station_of_bag

PIECE = 1 << 22
"""Bytes copied at a time."""


def folder_of(directory: Path) -> Path:
    """Return the folder for what is taken out of a bag: beside it, so that no reader of the bag finds it.

    For the bag of a station, ``bag/NAME``, it is ``bag_aside/NAME``.
    """
    directory = directory.absolute()
    if station_of_bag(directory):
        return folder_of(directory.parent) / directory.name
    return directory.with_name(f"{directory.name}_aside")


def free_name(path: Path) -> Path:
    """Return `path`; where it exists, the same with a number before its suffix."""
    number, free = 0, path
    while os.path.lexists(free):
        number += 1
        free = path.with_name(f"{path.stem}.{number}{path.suffix}")
    return free


def _place(path: Path, name: str) -> Path:
    folder = folder_of(path.parent)
    folder.mkdir(parents=True, exist_ok=True)
    return free_name(folder / name)


def set_aside(path: Path) -> Path:
    """Move a file out of a bag; return its new path."""
    to = _place(path, path.name)
    shutil.move(path, to)
    sync_directory(to.parent)
    sync_directory(path.parent)
    return to


def copy_aside(path: Path, start: int, end: int) -> Path:
    """Copy bytes of a file that will be overwritten or cut off into a file, synced to the disk; return its path."""
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
