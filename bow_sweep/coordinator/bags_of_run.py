"""The bags of a run that is to be resumed: repaired, synced, read as one; refused where some are not here."""

from __future__ import annotations

import os
import shlex
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from contextlib import ExitStack
from pathlib import Path
from typing import Any, NamedTuple

from bow_sweep.record.bag import FOLDER, BagError, station_bags
from bow_sweep.record.bag_contents import RunIdentity, Survey
from bow_sweep.record.recover import repair
from bow_sweep.record.run_bags import RunSurvey, in_words
from bow_sweep.run.errors import RunError
from bow_sweep.run.ledger_file import LEDGER, Reading, done_at
from bow_sweep.run.lock import LockedError, locked, recorder_of

Log = Callable[[str], None]
"""Takes a line for people."""


class Bags(NamedTuple):
    """The bags of a run, and whether a recorder is at work on one of them."""

    survey: RunSurvey
    at_work: bool


def repaired_bags(directory: Path, reading: Reading, log: Log, locks: bool) -> Bags:
    """Repair all bags of a run and log what was done; one that a recorder is writing is only read.

    Raises
    ------
    RunError
        Where a bag is of another run, or cannot be repaired.
    """
    first = reading.entries[0] if reading.planned else None
    right = identity = RunIdentity(first["run_id"], first["sweep_id"]) if first else None
    folder = directory / FOLDER
    bags: dict[str, Survey] = {}
    at_work = False
    for station, bag in {"": folder, **station_bags(directory)}.items():
        with ExitStack() as stack:
            try:
                stack.enter_context(locked(directory, recorder_of(station), locks))
            except LockedError:  # only the coordinator of this graph was started again
                bags[station] = _only_read(bag, directory, right)
                at_work = True
            else:
                bags[station] = _repaired(bag, directory, right, log)
            _sync(bag)
        right = right or bags[station].identity
    return Bags(RunSurvey(folder, bags, done_at(reading.entries), identity), at_work)


def _repaired(bag: Path, directory: Path, identity: RunIdentity | None, log: Log) -> Survey:
    try:
        report, found = repair(bag, identity, resuming=True)
    except BagError as error:
        raise RunError(f"{error}. {_remedy(directory, bag, identity)}") from None
    for line in _repairs(report, bag.relative_to(directory)):
        log(line)
    return found.survey


def _only_read(bag: Path, directory: Path, identity: RunIdentity | None) -> Survey:
    survey = Survey(bag).read()
    if identity and survey.identity and survey.identity != identity:
        other = f"{bag}: holds run {survey.identity.run_id}, this is run {identity.run_id}"
        raise RunError(f"{other}. {_remedy(directory, bag, identity)}") from None
    return survey


_ACTIONS = {"mend": "repaired", "set aside": "set aside, its blocks are computed again", "refuse": "left as it is"}


def _repairs(report: Mapping[str, Any], bag: Path) -> Iterator[str]:
    """Yield the report of :func:`bow_sweep.record.recover.repair` as lines for people."""
    for file in report["files"]:
        if file["did"] != "keep":
            why = f": {file['why']}" if file["why"] else ""
            aside = f"; taken out: {', '.join(file['aside'])}" if file["aside"] else ""
            yield f"{bag}/{file['file']} is {file['was']}{why}: {_ACTIONS[file['did']]}{aside}"
    if report["metadata_aside"]:
        what = "cannot be read: written again" if report["metadata_rewritten"] else "names files that do not exist"
        yield f"{bag}/metadata.yaml {what}; its old content is in {report['metadata_aside']}"
    if report["missing"]:
        count = sum(end - start + 1 for start, end in report["missing"])
        yield f"{count} messages of the bag are missing; the next file notes which"


def _sync(bag: Path) -> None:
    """Sync the bag to the disk: the ledger is about to mark its blocks as done."""
    for path in bag.glob("*.mcap"):
        with open(path, "rb") as file:
            os.fdatasync(file.fileno())


def _remedy(directory: Path, bag: Path, identity: RunIdentity | None) -> str:
    if identity is None:
        return "Then resume it again"
    if bag != directory / FOLDER:  # of a station; not beside it, where it would be taken for one
        return f"Move it away: mv {bag} {directory / f'{bag.name}.other'}; then resume it again"
    return (
        f"If the bag is right: mv {directory / LEDGER} {directory / LEDGER}.other, if the ledger is: "
        f"mv {directory / FOLDER} {directory / FOLDER}.other; then resume it again"
    )


def check_lost(directory: Path, survey: RunSurvey, lost: Collection[str]) -> None:
    """Raise RunError where a station that is said to be lost has its bag here, or no blocks that are missed."""
    for station in lost:
        if station in survey.bags and station not in survey.unseen:
            raise RunError(
                f"--lost {station}: its bag is here, {directory / FOLDER / station}: what is whole in it stays, "
                "and the rest is computed again without --lost"
            )
        if station not in survey.unseen:
            known = ", ".join(sorted(survey.unseen)) or "there is none"
            raise RunError(f"--lost {station}: should be a station whose blocks are not here: {known}")


def need_all_bags(directory: Path, survey: RunSurvey, lost: Collection[str]) -> None:
    """Raise RunError where blocks are in bags that are not here, because the map is made from the bags alone."""
    absent = {station: blocks for station, blocks in survey.unseen.items() if station not in lost}
    if absent:
        run = shlex.quote(str(directory))
        lines = (f"{in_words(name)}: blocks {_listed(blocks)}" for name, blocks in sorted(absent.items()))
        flags = " ".join(f"--lost {station}" for station in sorted(absent))
        raise RunError(
            f"{directory}: blocks are not here that some stations have recorded:\n  " + "\n  ".join(lines) + "\n"
            f"to bring them here: bow collect {run} WHERE_THEY_ARE\n"
            f"if they are lost, to compute these blocks again: bow sweep --resume {run} {flags}"
        )


def _listed(blocks: Sequence[int], most: int = 8) -> str:
    more = f" and {len(blocks) - most} more" if len(blocks) > most else ""
    return ", ".join(map(str, blocks[:most])) + more
