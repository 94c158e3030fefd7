"""Brings the bags of stations to the other bags of a run: copied aside, checked, then moved to their place.

What is there stays until the copy is whole. Nothing is deleted: a bag that is replaced by a longer one of itself is
kept in ``bag_aside/``.
"""

from __future__ import annotations

import filecmp
import os
import re
import shutil
import subprocess
import tempfile
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import NamedTuple

from bow_sim.atomic_files import sync_directory
from bow_sim.graph.parent import end_with_parent
from bow_sim.protocol import cdr
from bow_sweep.record.aside import PIECE, folder_of, free_name
from bow_sweep.record.bag import COLLECTED, FOLDER, METADATA, bag_files, bag_folder, label, station_of_bag
from bow_sweep.record.bag_contents import Progress, RunIdentity
from bow_sweep.record.mcap_reader import Scan
from bow_sweep.record.mcap_writer import MAGIC
from bow_sweep.record.recover import identity_of
from bow_sweep.record.run_bags import in_words
from bow_sweep.run.lock import locked

Log = Callable[[str], object]
"""Takes a line for people."""

CONNECT_S, SILENT_S = 30, 120
"""Seconds that ssh may take to connect, and that rsync waits while nothing comes."""

TOLD_S = 5
"""Seconds after which is told how much rsync has copied."""

_ROOM = ".collect-"

_NOT_THERE = 23
"""Exit status of rsync where a directory, or some of what is in it, cannot be read."""

_REMOTE = re.compile(r"([^/:]+):(.+)")
"""HOST:DIR, as rsync takes it."""


class CollectError(ValueError):
    """Bags cannot be collected; the message says what would be right."""


class Collected(NamedTuple):
    """What was brought.

    Attributes
    ----------
    bags
        Stations whose bags were brought, in order.
    known
        Stations whose bags were here already, the same or longer.
    """

    bags: list[str]
    known: list[str]


def collect(
    run: Path, source: str, log: Log = lambda _: None, progress: Progress | None = None, lock: bool = True
) -> Collected:
    """Copy the bags of stations from one place to those of a run.

    Parameters
    ----------
    run
        Run directory, with a ledger or a bag that tells which run it is.
    source
        Directory ``DIR`` of a machine's part of the run, or ``HOST:DIR``, which rsync copies. In it is ``bag/NAME/``,
        or ``RUN_ID/bag/NAME/``, which ``bow station --out DIR`` leaves.
    log
        Takes lines about what was done.
    progress
        Called with (done, total) bytes of a local copy.
    lock
        Lock the run directory; not possible on file systems without locks.

    Raises
    ------
    CollectError
        Where there is no bag of a station, or one is of another run: nothing is changed then.
    LockError
        Where another process collects bags of this run.
    OSError
        Where something cannot be read or written.
    """
    identity = _identity(run)
    folder = run / FOLDER
    with locked(run, "collector", lock), _room_beside(folder) as room:
        if (remote := _REMOTE.fullmatch(source)) and not Path(source).exists():
            _fetch(remote[1], remote[2].rstrip("/"), identity.run_id, room, log)
        else:
            _copy(Path(source), identity.run_id, folder, room, progress)
        found = [path for path in sorted(room.iterdir()) if station_of_bag(folder / path.name) and bag_files(path)]
        if not found:
            what = f"holds no bag of a station: should have {FOLDER}/NAME/ or {identity.run_id}/{FOLDER}/NAME/"
            raise CollectError(f"{source}: {what}")
        for bag in found:
            _check(bag, f"{source}: bag {bag.name}", identity)
        made = Collected([], [])
        for bag in found:
            (bag / COLLECTED).write_text(f"{source}\n")
            _take_place(bag, bag_folder(run, bag.name), made, log)
    return made


def _identity(run: Path) -> RunIdentity:
    """Return which run is in a directory, from its ledger or its bag."""
    if not run.is_dir():
        raise CollectError(f"{run}: is no directory; should be that of a run")
    found = identity_of(run) or next(filter(None, map(_first_plan, bag_files(run / FOLDER))), None)
    if found is None:
        raise CollectError(f"{run}: has neither ledger.jsonl nor a bag; should be the directory of a run")
    return found


def _first_plan(path: Path) -> RunIdentity | None:
    """Return the run of a file of a bag, from its first message; None where it has none."""
    scan = Scan(path)
    for message in scan.messages():
        found = label(scan.contents, message, path)
        if found.topic == "plan":
            plan = cdr.decode("Plan", found.data)
            return RunIdentity(plan["run_id"], plan["sweep_id"])
    return None


@contextmanager
def _room_beside(folder: Path) -> Iterator[Path]:
    """Yield a new directory in the folder of a run's bags, whose name no station can have; it is removed.

    So is what a killed process has left: the run is locked for this.
    """
    new = not folder.exists()
    folder.mkdir(exist_ok=True)
    for left in folder.glob(f"{_ROOM}*"):
        shutil.rmtree(left, ignore_errors=True)
    room = Path(tempfile.mkdtemp(prefix=_ROOM, dir=folder))
    try:
        yield room
    finally:
        shutil.rmtree(room, ignore_errors=True)
        if new:
            with suppress(OSError):  # not empty: bags were brought
                folder.rmdir()


# ---- copying


def _copy(source: Path, run_id: str, here: Path, room: Path, progress: Progress | None) -> None:
    """Copy the bags in a directory of this machine."""
    if not source.is_dir():
        raise CollectError(f"{source}: is no directory")
    places = [source / FOLDER, source / run_id / FOLDER, source]
    bags = next((found for place in places if (found := _bags_at(place))), [])
    bags = [bag for bag in bags if bag.parent.resolve() != here.resolve()]
    total = sum(path.stat().st_size for bag in bags for path in bag_files(bag))
    before = 0
    for bag in bags:
        (room / bag.name).mkdir()
        metadata = [bag / METADATA] if (bag / METADATA).is_file() else []
        for path in (*bag_files(bag), *metadata):
            with open(path, "rb") as given, open(room / bag.name / path.name, "xb") as made:
                while piece := given.read(PIECE):
                    made.write(piece)
                    before += len(piece)
                    if progress is not None:
                        progress(before, total)


def _bags_at(place: Path) -> list[Path]:
    if place.name != FOLDER or not place.is_dir():
        return []
    return [path for path in sorted(place.iterdir()) if station_of_bag(path) and bag_files(path)]


def _fetch(host: str, directory: str, run_id: str, room: Path, log: Log) -> None:
    """Have rsync copy the bags in a directory of another machine."""
    if shutil.which("rsync") is None:
        raise CollectError(f"{host}:{directory}: rsync is needed to copy from another machine, and is not installed")
    said = ""
    for place in (f"{directory}/{FOLDER}/", f"{directory}/{run_id}/{FOLDER}/"):
        status, words = _rsync(f"{host}:{place}", room, log)
        if not status and any(bag_files(path) for path in room.iterdir()):
            return
        said = said or words
        if status not in (0, _NOT_THERE):
            break
    if said:
        raise CollectError(f"{host}:{directory}: rsync could not copy: {said}")


def _rsync(source: str, room: Path, log: Log) -> tuple[int, str]:
    """Copy bags from another machine; return rsync's exit status and, of a failure, what it and ssh say."""
    chosen = ["--include=/*/", "--include=/*/*.mcap", f"--include=/*/{METADATA}", "--exclude=*"]
    command = ["rsync", "--recursive", "--times", f"--timeout={SILENT_S}", "-e", f"ssh -o ConnectTimeout={CONNECT_S}"]
    command.append("--copy-dest=..")  # what the run has of a bag does not come over the network again
    with tempfile.TemporaryFile("w+") as errors:
        copying = [*command, *chosen, "--", source, f"{room}/"]
        process = subprocess.Popen(
            copying,
            stderr=errors,
            preexec_fn=end_with_parent,  # noqa: PLW1509  # it calls the C library only
        )
        try:
            while True:
                try:
                    status = process.wait(TOLD_S)
                    break
                except subprocess.TimeoutExpired:
                    size = sum(path.stat().st_size for path in room.glob("*/*"))
                    log(f"{source}: {size / 1e6:.0f} MB copied so far")
        finally:
            if process.poll() is None:
                process.terminate()
                process.wait()
        if not status:
            return 0, ""
        errors.seek(0)
        lines = [line.strip() for line in errors if line.strip()]
        cause = [line for line in lines if line.startswith("rsync")][:1]  # the other lines of rsync follow from it
        said = [line for line in lines if not line.startswith("rsync")]  # by ssh, or the shell there
        return status, "; ".join([*said, *cause]) or f"exit status {status}"


# ---- checking and taking the place


def _check(bag: Path, name: str, identity: RunIdentity) -> None:
    """Raise CollectError unless all files of a bag are of a run."""
    for path in bag_files(bag):
        try:
            found = _first_plan(path)
        except cdr.WireError as error:
            raise CollectError(f"{name}: {path.name}: {error}") from None
        if found is not None and found != identity:
            raise CollectError(
                f"{name}: {path.name} is of run {found.run_id}, sweep {found.sweep_id}; should be of run "
                f"{identity.run_id}, sweep {identity.sweep_id}: nothing was copied"
            )


def _take_place(bag: Path, place: Path, made: Collected, log: Log) -> None:
    """Move a copied bag to its place, unless it has nothing that is not there."""
    sizes = {path.name: path.stat().st_size for path in bag_files(bag)}
    size = sum(sizes.values())
    name = in_words(place.name)
    what = f"{name}: {len(sizes)} file{'s' * (len(sizes) != 1)}, {size / 1e6:.1f} MB"
    before = {path.name: path.stat().st_size for path in bag_files(place)}
    if before and (_equal(bag, place) or _contains(before, sizes)):
        made.known.append(place.name)
        log(f"{what}: is here already")
        return
    if not _contains(sizes, before):
        raise CollectError(
            f"{place}: its files are not those that were found, and neither are older ones of the same: what is here "
            "stays; to replace it, move it away first"
        )
    for path in bag.iterdir():
        with open(path, "rb") as file:
            os.fsync(file.fileno())
    sync_directory(bag)
    if os.path.lexists(place):
        aside = folder_of(place)
        aside.parent.mkdir(exist_ok=True)
        kept = free_name(aside.with_name(f"{aside.name}.before"))
        os.replace(place, kept)
        log(f"{name}: the shorter bag that was here is in {kept}")
    os.replace(bag, place)
    sync_directory(place.parent)
    made.bags.append(place.name)
    log(f"{what} -> {place}")
    if not _is_closed(bag_files(place)[-1]):
        again = "collect it again when the station has ended, or have `bow recover` close it"
        log(f"{name}: its last file is cut off or still being written: {again}")


def _contains(sizes: Mapping[str, int], others: Mapping[str, int]) -> bool:
    """Return whether files, by their sizes, have at least what other ones have, and not the same."""
    return sizes != others and all(sizes.get(name, -1) >= size for name, size in others.items())


def _equal(one: Path, other: Path) -> bool:
    """Return whether two bags have the same files."""
    names = [[path.name for path in bag_files(bag)] for bag in (one, other)]
    return names[0] == names[1] and all(filecmp.cmp(one / name, other / name, shallow=False) for name in names[0])


def _is_closed(path: Path) -> bool:
    with open(path, "rb") as file:
        file.seek(-min(len(MAGIC), path.stat().st_size), os.SEEK_END)
        return file.read() == MAGIC and path.stat().st_size > 2 * len(MAGIC)
