"""Repairs bags: what is whole is kept, what is not is set aside beside the bag, index and footer are written anew.

A torn file is cut after its last complete chunk and given its end, in place: no room for a copy of it is needed, and
dying here leaves just another torn file. In a file of ours that is damaged further in, one record covers the bad bytes,
so that what is good before and after them stays where it is. A file that cannot be mended so, or that holds again what
other files hold (a copy, an older version), is set aside whole: its blocks are computed again, with the same bytes.

Of bags that others wrote only torn files are repaired; what is whole is not touched.
"""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

from isal.isal_zlib import crc32
from mcap.records import Header

from bow_sweep.record.aside import copy_aside, set_aside
from bow_sweep.record.bag import FOLDER, METADATA, bag_of, write_metadata
from bow_sweep.record.inspection import ASIDE, KEEP, MEND, REFUSE, Identity, Inspection, Part, inspect
from bow_sweep.record.mcap_reader import Scan
from bow_sweep.record.mcap_writer import COVER, COVERED, LIBRARY, MAGIC, pack, write_all
from bow_sweep.record.metadata import MetadataError, differences, others_part, parse
from bow_sweep.run.ledger_file import read_leniently
from bow_sweep.run.lock import locked

ROUNDS = 4
"""Damage found one behind the other, looked at again after each repair, before a file is set aside whole."""


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


def mend_file(scan: Scan) -> tuple[bool, list[Path]]:
    """Mend a file read to its end by `scan`; return whether it is whole now, and what was set aside."""
    aside: list[Path] = []
    for _ in range(ROUNDS):
        if scan.whole:
            break
        parts = _taken_out(scan)
        aside += [copy_aside(scan.path, start, end) for start, end, _ in parts if end > start]
        if scan.damage:
            _overwrite(scan, parts)
        else:
            repair_file(scan)
        scan = Scan(scan.path).run()
    return scan.whole, aside


def _taken_out(scan: Scan) -> list[tuple[int, int, bytes]]:
    """Return which bytes go, and what takes their place where that is known; what is cut off comes last."""
    cut = min([scan.size, *(d.start for d in scan.damage if d.end >= scan.size and not d.right)])
    if not scan.finished or any(damage.kind == "end" for damage in scan.damage):
        cut = min(cut, scan.good_end)
    parts = [(d.start, d.end, d.right) for d in scan.damage if d.end <= cut]
    return [*parts, (cut, scan.size, b"")]


def _overwrite(scan: Scan, parts: list[tuple[int, int, bytes]]) -> None:
    """Put the right bytes in the place of bad ones, or cover them by a record that readers skip; cut off the last.

    Where bytes of the data are changed, the end of the file goes too: it is written anew.
    """
    descriptor = os.open(scan.path, os.O_RDWR | os.O_CLOEXEC)
    try:
        for start, end, right in parts[:-1]:
            os.pwrite(descriptor, right or COVER.pack(COVERED, end - start - COVER.size), start)
        os.ftruncate(descriptor, scan.good_end if parts[1:] and scan.finished else parts[-1][0])
        os.fsync(descriptor)
    finally:
        os.close(descriptor)


def repair(
    directory: Path, identity: Identity | None = None, dry_run: bool = False, resuming: bool = False
) -> tuple[dict[str, Any], Inspection]:
    """Repair the files of a bag; see :func:`recover`.

    Parameters
    ----------
    directory
        Of the bag itself; may be empty or missing.
    identity
        Run and sweep that it belongs to, where that is known: then no file of others stays in it.
    dry_run
        Say what would be done, change nothing.
    resuming
        Set aside also what others wrote where the run cannot go on with it.

    Returns
    -------
    report
        As of :func:`recover`.
    inspection
        What is in the bag now.

    Raises
    ------
    BagError
        Where it is the bag of another run, or of several.
    """
    reports: dict[str, dict[str, Any]] = {}
    for _ in range(ROUNDS):
        found = inspect(directory, identity, resuming)
        failed = [part for part in found.parts if not _carry_out(part, reports, dry_run)]
        if not failed:
            break
    rewritten, aside = _settle_metadata(directory, found, dry_run)
    order = sorted(reports)
    report = {
        "ok": not any(part.action == REFUSE for part in found.parts),
        "bag": str(directory),
        "files": [reports[name] for name in order],
        "metadata_rewritten": rewritten,
        "metadata_aside": str(aside) if aside else None,
        "missing": [list(range_) for range_ in found.survey.missing()],
        "dry_run": dry_run,
    }
    return report, found


def _carry_out(part: Part, reports: dict[str, dict[str, Any]], dry_run: bool) -> bool:
    """Do with a file what is to be done; return whether its contents are what was found."""
    scan, name = part.scan, part.path.name
    whole = True
    aside: list[Path] = []
    if part.action == MEND and not dry_run:
        whole, aside = mend_file(scan)
    if (part.action == ASIDE or not whole) and not dry_run:
        aside.append(set_aside(part.path))
    before = reports.get(name, {})
    reports[name] = {
        "file": name,
        "was": before.get("was", part.was),
        "did": ASIDE if not whole else before.get("did", KEEP) if part.action == KEEP else part.action,
        "why": part.why or before.get("why", ""),
        "messages": scan.contents.messages if part.action in (KEEP, MEND, REFUSE) and whole else 0,
        "dropped_bytes": before.get("dropped_bytes", part.dropped_bytes),
        "damage": before.get(
            "damage", [{"start": d.start, "end": d.end, "what": d.what} for d in scan.damage if part.was != "torn"]
        ),
        "aside": [*before.get("aside", []), *map(str, aside)],
    }
    return whole


def _settle_metadata(directory: Path, found: Inspection, dry_run: bool) -> tuple[bool, Path | None]:
    """Write metadata.yaml anew where it does not say what the files do; return whether, and what was set aside."""
    path, infos = directory / METADATA, found.survey.files
    if any(part.action == REFUSE for part in found.parts) or not (infos or path.exists()):
        return False, None
    aside: Path | None = None
    others: dict[str, Any] = {}
    try:
        info = parse(path.read_bytes())
        untouched = all(part.action == KEEP and not part.scan.ours for part in found.parts)
        if infos and (untouched or not differences(info, infos)):
            return False, None
        others = others_part(info)
    except FileNotFoundError:
        pass
    except MetadataError:
        if not dry_run:
            aside = set_aside(path)
    if not dry_run and infos:
        write_metadata(directory, infos, others)
    elif not dry_run and path.exists():
        aside = set_aside(path)  # of files that are all gone
    return bool(infos), aside


def recover(run_directory: Path, dry_run: bool = False, lock: bool = True) -> dict[str, Any]:
    """Repair the bag of a run directory, or a bag directory; what is whole stays as it is.

    Returns
    -------
    dict
        For JSON. ``ok``: nothing is left that is damaged. ``files``: for each, what it ``was`` (whole, torn, damaged,
        misplaced: a copy or an older version), what was done, ``did`` (keep, mend, set aside, refuse: damaged, and not
        ours), ``why``, ``messages`` that stay in it, ``dropped_bytes`` after its last complete chunk, ``damage``: byte
        ranges that are not what was written, and ``aside``: the files that hold what was taken out. ``missing``:
        numbers of messages that are gone, [first, last].

    Raises
    ------
    BagError
        Where there is no bag, or it is of several runs.
    LockError
        Where a recorder is writing it, or the run directory cannot be locked.
    """
    directory = bag_of(run_directory)
    run = directory.parent if directory.name == FOLDER else directory
    if dry_run:
        return repair(directory, identity_of(run), True)[0]
    with locked(run, "recorder", lock):
        return repair(directory, identity_of(run))[0]


def identity_of(run_directory: Path) -> Identity | None:
    """Return run and sweep as the ledger beside a bag has them; None where none tells."""
    reading = read_leniently(run_directory)
    return (reading.entries[0]["run_id"], reading.entries[0]["sweep_id"]) if reading.planned else None
