"""Repairs bags: complete data are kept, the rest is set aside beside the bag, index and footer are written anew.

A torn file is cut after its last complete chunk, and gets its end in place. That needs no room for a copy, and leaves
just another torn file where the process is killed meanwhile. In a file of ours with damage further in, one record
covers the damaged bytes, so that the data before and after them keep their places. A file that cannot be mended so, or
that stores again what other files store (a copy, an older version), is set aside: its blocks are computed again, with
the same bytes.

Of bags by other writers only torn files are repaired; complete ones are not touched.
"""

from __future__ import annotations

import os
from contextlib import ExitStack
from pathlib import Path
from typing import Any, NamedTuple

from isal.isal_zlib import crc32
from mcap.records import Header

from bow_sweep.record.aside import copy_aside, set_aside
from bow_sweep.record.bag import METADATA, bag_of, bags_in, run_of_bag, write_metadata
from bow_sweep.record.bag_contents import RunIdentity
from bow_sweep.record.inspection import ASIDE, KEEP, MEND, REFUSE, Inspection, Part, inspect
from bow_sweep.record.mcap_reader import Scan
from bow_sweep.record.mcap_writer import COVERED, LIBRARY, MAGIC, RECORD_HEAD, pack, write_all
from bow_sweep.record.metadata import MetadataError, differences, others_part, parse, with_custom_data
from bow_sweep.record.notes import custom_data
from bow_sweep.run.ledger_file import read_leniently
from bow_sweep.run.lock import locked, recorder_of

NAMES_ITS_RUN = 3
"""From this version of the record on, metadata.yaml names the run."""

ROUNDS = 4
"""A file is read again after each repair; where damage is left after so many, it is set aside."""


class _Piece(NamedTuple):
    """Bytes of a file that are taken out, and those that replace them; empty where they are unknown."""

    start: int
    end: int
    right: bytes = b""


class _Metadata(NamedTuple):
    """Whether metadata.yaml was written anew, and the file that was set aside, if any."""

    rewritten: bool
    aside: Path | None = None


def finish_file(scan: Scan) -> None:
    """Cut a torn file, read by `scan`, after its last complete record, and write its end."""
    descriptor = os.open(scan.path, os.O_RDWR | os.O_CLOEXEC)
    try:
        os.ftruncate(descriptor, scan.good_end)
        end = os.lseek(descriptor, scan.good_end, os.SEEK_SET)
        start = b"" if scan.good_end >= len(MAGIC) else MAGIC[scan.good_end :]
        if not scan.library:
            start += pack(Header("ros2", LIBRARY))
        data_crc = crc32(start, scan.data_crc)
        start += scan.missing_index
        write_all(descriptor, [start, scan.contents.ending(end + len(start), data_crc)], end)
        os.fsync(descriptor)
    finally:
        os.close(descriptor)


def mend_file(scan: Scan) -> tuple[bool, list[Path]]:
    """Mend a file, read by `scan`; return whether it is whole now, and the files with the bytes taken out."""
    aside: list[Path] = []
    for _ in range(ROUNDS):
        if scan.whole:
            break
        pieces = _taken_out(scan)
        aside += [copy_aside(scan.path, piece.start, piece.end) for piece in pieces if piece.end > piece.start]
        if scan.damage:
            _overwrite(scan, pieces)
        else:
            finish_file(scan)
        scan = Scan(scan.path).run()
    return scan.whole, aside


def _taken_out(scan: Scan) -> list[_Piece]:
    """Return the pieces to take out; the last one is cut off, and may be empty."""
    cut = min([scan.size, *(d.start for d in scan.damage if d.end >= scan.size and not d.right)])
    if not scan.finished or any(damage.kind == "end" for damage in scan.damage):
        cut = min(cut, scan.good_end)
    pieces = [_Piece(d.start, d.end, d.right) for d in scan.damage if d.end <= cut]
    return [*pieces, _Piece(cut, scan.size)]


def _overwrite(scan: Scan, pieces: list[_Piece]) -> None:
    """Replace pieces by the right bytes, or by a record that readers skip; cut off the last piece.

    Where data are changed, the end of the file is cut off too: the next round writes it anew.
    """
    descriptor = os.open(scan.path, os.O_RDWR | os.O_CLOEXEC)
    try:
        for start, end, right in pieces[:-1]:
            os.pwrite(descriptor, right or RECORD_HEAD.pack(COVERED, end - start - RECORD_HEAD.size), start)
        os.ftruncate(descriptor, scan.good_end if pieces[1:] and scan.finished else pieces[-1].start)
        os.fsync(descriptor)
    finally:
        os.close(descriptor)


def repair(
    directory: Path, identity: RunIdentity | None = None, dry_run: bool = False, resuming: bool = False
) -> tuple[dict[str, Any], Inspection]:
    """Repair the files of a bag; see :func:`recover`.

    Parameters
    ----------
    directory
        Of the bag itself; may be empty or missing.
    identity
        Run and sweep of the bag, where they are known: files of others are set aside.
    dry_run
        Report what would be done, change nothing.
    resuming
        Also set aside files of other writers that the run cannot continue from.

    Returns
    -------
    report
        As of :func:`recover`.
    inspection
        What is in the bag now.

    Raises
    ------
    BagError
        Where the bag is of another run, or of several.
    """
    reports: dict[str, dict[str, Any]] = {}
    for _ in range(ROUNDS):
        found = inspect(directory, identity, resuming)
        failed = [part for part in found.parts if not _carry_out(part, reports, dry_run)]
        if not failed:
            break
    metadata = _repair_metadata(directory, found, dry_run)
    report = {
        "ok": not any(part.action == REFUSE for part in found.parts),
        "bag": str(directory),
        "files": [reports[name] for name in sorted(reports)],
        "metadata_rewritten": metadata.rewritten,
        "metadata_aside": str(metadata.aside) if metadata.aside else None,
        "missing": [list(missing) for missing in found.survey.missing()],
        "dry_run": dry_run,
    }
    return report, found


def _carry_out(part: Part, reports: dict[str, dict[str, Any]], dry_run: bool) -> bool:
    """Do what was decided for a file, and report it; return False where it could not be mended and was set aside."""
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


def _repair_metadata(directory: Path, found: Inspection, dry_run: bool) -> _Metadata:
    """Write metadata.yaml anew where it does not agree with the files."""
    path, infos = directory / METADATA, found.survey.files
    if any(part.action == REFUSE for part in found.parts) or not (infos or path.exists()):
        return _Metadata(False)
    aside: Path | None = None
    others: dict[str, Any] = {}
    try:
        info = parse(path.read_bytes())
        untouched = all(part.action == KEEP and not part.scan.ours for part in found.parts)
        if infos and (untouched or not differences(info, infos)):
            return _Metadata(False)
        others = others_part(info)
    except FileNotFoundError:
        pass
    except MetadataError:
        if not dry_run:
            aside = set_aside(path)
    if not dry_run and infos:
        if found.survey.identity and found.survey.version >= NAMES_ITS_RUN:
            others = with_custom_data(others, custom_data(*found.survey.identity))
        write_metadata(directory, infos, others)
    elif not dry_run and path.exists():
        aside = set_aside(path)  # all files that it describes are gone
    return _Metadata(bool(infos), aside)


def recover(run_directory: Path, dry_run: bool = False, lock: bool = True) -> dict[str, Any]:
    """Repair the bags of a run directory, or a bag directory; complete data stay as they are.

    Parameters
    ----------
    run_directory
        Run directory, or the bag itself.
    dry_run
        Report what would be done, change nothing.
    lock
        Lock the run directory; not possible on file systems without locks.

    Returns
    -------
    dict
        For JSON. ``ok``: no damage is left. ``files``: for each, what it ``was`` (whole, torn, damaged, misplaced: a
        copy or an older version), what was done, ``did`` (keep, mend, set aside, refuse: damaged, and by another
        writer), ``why``, ``messages`` that stay in it, ``dropped_bytes`` after its last complete chunk, ``damage``:
        ranges of bytes that differ from what was written, and ``aside``: the files that hold what was taken out.
        ``missing``: numbers of messages that are gone, [first, last]. Of a run with stations: ``bags``, such a report
        by the station.

    Raises
    ------
    BagError
        Where there is no bag, or it is of several runs.
    LockError
        Where a recorder is writing it, or the run directory cannot be locked.
    """
    folder = bag_of(run_directory)
    run, bags = run_of_bag(folder), bags_in(folder)
    identity = identity_of(run)
    reports: dict[str, dict[str, Any]] = {}
    with ExitStack() as locks:
        for station in () if dry_run else bags:
            locks.enter_context(locked(run, recorder_of(station), lock))
        for station, bag in bags.items():
            reports[station], found = repair(bag, identity, dry_run)
            identity = identity or found.survey.identity
    if list(bags) == [""]:
        return reports[""]
    ok = all(report["ok"] for report in reports.values())
    return {"ok": ok, "bag": str(folder), "bags": reports, "dry_run": dry_run}


def identity_of(run_directory: Path) -> RunIdentity | None:
    """Return run and sweep from the ledger beside a bag; None where there is no ledger with a plan."""
    reading = read_leniently(run_directory)
    return RunIdentity(reading.entries[0]["run_id"], reading.entries[0]["sweep_id"]) if reading.planned else None
