"""Repairs bags whose writer was killed: complete chunks are kept, index and footer are written anew.

A torn file is cut after its last complete chunk and given its end, in place: no room for a copy is needed, and dying
here leaves just another torn file. A damaged file, one with wrong bytes before its end, is reported and left alone.
"""

from __future__ import annotations

import fcntl
import os
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from isal.isal_zlib import crc32
from mcap.records import Header

from .bag import FOLDER, METADATA, BagError, BagMessage, bag_files, bag_of, label, write_metadata
from .mcapfile import LIBRARY, MAGIC, pack, write_all
from .metadata import FileInfo, render
from .scan import Scan

Visit = Callable[[BagMessage], None]


class LockedError(BagError):
    """A bag that a recorder is writing."""


@contextmanager
def locked(run_directory: Path) -> Iterator[None]:
    """Hold the recorder's lock on a run directory.

    Raises
    ------
    LockedError
        Where a live recorder holds it.
    """
    path = run_directory / ".recorder.lock"
    descriptor = os.open(path, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o644)
    try:
        try:
            fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            raise LockedError(f"{run_directory}: a recorder is at work on it ({path.name} is locked)") from None
        yield
    finally:
        os.close(descriptor)


def repair_file(scan: Scan) -> None:
    """Give a torn file, read to its end by `scan`, the end that it lacks."""
    descriptor = os.open(scan.path, os.O_RDWR | os.O_CLOEXEC)
    try:
        os.ftruncate(descriptor, scan.good_end)
        os.lseek(descriptor, scan.good_end, os.SEEK_SET)
        start = b"" if scan.good_end >= len(MAGIC) else MAGIC[scan.good_end :]
        if not scan.library:
            start += pack(Header("ros2", LIBRARY))
        data_crc = crc32(start, scan.data_crc)
        start += scan.missing_index
        write_all(descriptor, [start, scan.contents.ending(scan.good_end + len(start), data_crc)])
        os.fsync(descriptor)
    finally:
        os.close(descriptor)


def repair(directory: Path, visit: Visit | None = None) -> tuple[dict[str, Any], list[FileInfo]]:
    """Repair the files of a bag; see :func:`recover`.

    Parameters
    ----------
    directory
        Of the bag itself; may be empty or missing.
    visit
        Called with every message that is there, in order.

    Returns
    -------
    report
        As of :func:`recover`.
    files
        What metadata.yaml says of each file.
    """
    reports, infos = [], []
    for path in bag_files(directory):
        scan = Scan(path)
        for message in scan.messages():
            if visit is not None:
                visit(label(scan.contents.channels[message.channel].topic, message, path))
        torn = not scan.finished and not scan.damage
        if torn:
            repair_file(scan)
        infos.append(FileInfo.of(path.name, scan.contents))
        reports.append(
            {
                "file": path.name,
                "was": "damaged" if scan.damage else "torn" if torn else "whole",
                "messages": scan.contents.messages,
                "dropped_bytes": scan.size - scan.good_end if torn else 0,
                "damage": [damage._asdict() for damage in scan.damage],
            }
        )
    ok = all(report["was"] != "damaged" for report in reports)
    rewritten = False
    if ok and infos:
        path = directory / METADATA
        rewritten = not path.is_file() or path.read_text(errors="replace") != render(infos)
        if rewritten:
            write_metadata(directory, infos)
    report = {"ok": ok, "bag": str(directory), "files": reports, "metadata_rewritten": rewritten}
    return report, infos


def recover(run_directory: Path) -> dict[str, Any]:
    """Repair the bag of a run directory, or a bag directory; what is whole stays as it is.

    Returns
    -------
    dict
        For JSON. ``ok``: nothing is damaged; ``files``: for each, what it ``was`` (whole, torn: now repaired, damaged:
        not touched), ``messages`` in it, ``dropped_bytes`` after the last complete chunk, and ``damage``: byte ranges
        that are not what was written.

    Raises
    ------
    BagError
        Where there is no bag, or a recorder is writing it.
    """
    directory = bag_of(run_directory)
    run = directory.parent if directory.name == FOLDER else directory
    with locked(run):
        return repair(directory)[0]
