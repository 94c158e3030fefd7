"""Going on with a run: ledger and bag, two records of one truth, are held against each other before anything else.

They can be of different age: copies made while it ran, restored backups, deleted files, power cuts. What is not whole
in the bag is due again, whatever the ledger says; what is whole there is done. Bag and ledger are repaired first;
whatever that takes out of them is set aside in files beside.
"""

from __future__ import annotations

import json
import os
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from bow_sim.physics.errors import ParameterError
from bow_sim.protocol.blocks import Blocks
from bow_sim.protocol.states import BlockState
from bow_sweep.maps.map_file import MAP
from bow_sweep.plan.sweep import Sweep
from bow_sweep.record.bag import FOLDER, BagError
from bow_sweep.record.bag_contents import Survey
from bow_sweep.record.inspection import Identity
from bow_sweep.record.recover import repair
from bow_sweep.run.directory import (
    PICTURE,
    REPORT,
    Run,
    RunError,
    blocks_of,
    digest,
    planned,
    round_entry,
    sweep_of,
)
from bow_sweep.run.ledger_file import LEDGER, Reading, latest_states, read_leniently, set_ledger_aside, write_ledger
from bow_sweep.run.lock import LockedError, LockError, locked

Say = Callable[[str], None]
"""Takes a line for people."""


@dataclass
class Prepared:
    """A run that can be gone on with.

    Attributes
    ----------
    entries
        Of its ledger, as it is on disk now.
    survey
        What is in its bag.
    complete
        Nothing is left to do: every block is settled, and what lies beside the bag agrees with it.
    """

    directory: Path
    run_id: str
    sweep: Sweep
    entries: list[dict[str, Any]]
    survey: Survey
    blocks: Blocks
    complete: bool = False


def prepare(directory: Path, say: Say = lambda _: None, locks: bool = True) -> Prepared:
    """Repair ledger and bag of a run and hold them against each other; what comes of it is in the ledger then.

    Parameters
    ----------
    say
        Is told what was found and done.
    locks
        Keep others off the directory meanwhile.

    Raises
    ------
    RunError
        Where this cannot be gone on with; the message says what would be right.
    """
    if not directory.is_dir():
        raise RunError(f"{directory / LEDGER}: no such directory; a run directory of `bow sweep` holds one")
    try:
        with locked(directory, "coordinator", locks):
            return _prepare(directory, say, locks)
    except LockError as error:
        raise RunError(str(error)) from None
    except OSError as error:
        raise RunError(f"{error.filename or directory}: {error.strerror or error}") from None


def resume(directory: Path, say: Say = lambda _: None, locks: bool = True) -> tuple[Run, dict[str, np.ndarray] | None]:
    """Go on with a run; return it, and the verdicts in its bag, see :func:`bow_sweep.record.replay.load_verdicts`.

    Raises
    ------
    RunError
        As :func:`prepare`.
    """
    prepared = prepare(directory, say, locks)
    return Run.resume(directory, locks), prepared.survey.layers() if prepared.survey.expected else None


def _prepare(directory: Path, say: Say, locks: bool) -> Prepared:
    reading = read_leniently(directory)
    survey = _bag(directory, reading, say, locks)
    entries, sweep, blocks, changed = _plan(directory, reading, survey, say)
    if changed or reading.bad:
        _write(directory, reading, entries, changed, say)
    events = _differences(entries, survey, blocks, say)
    if events:
        entries = [*entries, *events]
        write_ledger(directory, entries)
    prepared = Prepared(directory, entries[0]["run_id"], sweep, entries, survey, blocks)
    states = latest_states(entries)
    settled = all(states.get(block, "reopened") != "reopened" for block in range(blocks.count))
    prepared.complete = settled and _agrees(directory, survey, say)
    return prepared


# ---- the bag


def _bag(directory: Path, reading: Reading, say: Say, locks: bool) -> Survey:
    """Repair the bag and say what was done; one that a recorder is writing is read as it is."""
    plan = reading.entries[0] if reading.planned else None
    identity: Identity | None = (plan["run_id"], plan["sweep_id"]) if plan else None
    bag = directory / FOLDER
    try:
        try:
            with locked(directory, "recorder", locks):
                report, found = repair(bag, identity, resuming=True)
                _sync(bag)
        except LockedError:  # the recorder of a graph whose coordinator was started again
            survey = Survey(bag).read()
            if identity and survey.said and survey.said != identity:
                raise BagError(f"{bag}: holds run {survey.said[0]}, this is run {identity[0]}") from None
            _sync(bag)
            return survey
    except BagError as error:
        raise RunError(f"{error}. {_remedy(directory, identity)}") from None
    for file in report["files"]:
        if file["did"] not in ("keep",):
            why = f": {file['why']}" if file["why"] else ""
            aside = f"; taken out: {', '.join(file['aside'])}" if file["aside"] else ""
            say(f"{FOLDER}/{file['file']} is {file['was']}{why}: {_DID[file['did']]}{aside}")
    if report["metadata_aside"]:
        what = "cannot be read: written anew" if report["metadata_rewritten"] else "names files that are gone"
        say(f"{FOLDER}/metadata.yaml {what}; what it was is in {report['metadata_aside']}")
    if report["missing"]:
        count = sum(end - start + 1 for start, end in report["missing"])
        say(f"{count} messages of the bag are missing; the next file notes which")
    return found.survey


_DID = {"mend": "repaired", "set aside": "set aside, what it held is computed again", "refuse": "left as it is"}


def _sync(bag: Path) -> None:
    """See on the disk what the ledger is about to call done."""
    for path in bag.glob("*.mcap"):
        with open(path, "rb") as file:
            os.fdatasync(file.fileno())


def _remedy(directory: Path, identity: Identity | None) -> str:
    if identity is None:
        return "Then resume it again"
    return (
        f"If the bag is right: mv {directory / LEDGER} {directory / LEDGER}.other, if the ledger is: "
        f"mv {directory / FOLDER} {directory / FOLDER}.other; then resume it again"
    )


# ---- the plan


def _plan(
    directory: Path, reading: Reading, survey: Survey, say: Say
) -> tuple[list[dict[str, Any]], Sweep, Blocks, bool]:
    """Return entries that begin with the plan, its sweep and blocks, and whether these are other entries than before.

    The plan is the ledger's; where that is lost or cannot be, it is the latest of the bag.
    """
    path = directory / LEDGER
    entries = reading.entries
    problem = ""
    if reading.planned:
        try:
            sweep = sweep_of(entries[0], path)
        except RunError as error:
            problem = str(error)
    else:
        problem = f"{path}: {'has lost its first line, the plan' if reading.exists else 'is not there'}"
    changed = False
    if problem:
        if not survey.plan:
            what = "" if reading.planned else "; the bag holds no plan either, so nothing tells which sweep this is"
            remedy = "" if reading.planned else ": sweep anew, bow sweep PRESET --out ANOTHER_DIRECTORY"
            raise RunError(f"{problem}{what}{remedy}")
        entries, sweep = _from_bag(path, entries, survey, problem)
        changed = True
        say(f"{problem}; it is made anew from the bag")
    blocks, entries, grown = _rounds(path, sweep, entries, survey)
    return entries, sweep, blocks, changed or grown


def _from_bag(path: Path, entries: Sequence[dict[str, Any]], survey: Survey, problem: str) -> tuple[list[Any], Sweep]:
    """Return entries that begin with the latest plan of the bag, and its sweep."""
    plan = survey.plan
    try:
        sweep = Sweep.from_spec("", plan["spec.settings"])
    except ParameterError as error:
        raise RunError(f"{problem}; the plan in the bag is none either: {error}") from None
    first = planned(plan["run_id"], sweep, plan["epoch"])
    told = {"preset": plan["spec.preset"], "sweep_id": plan["sweep_id"], "fingerprint": plan["fingerprint"]}
    first = {**first, **told, "why": "made anew from the bag"}
    sweep = sweep_of(first, path)
    rest = [entry for entry in entries if entry.get("event") not in ("planned", "round")]
    said = {entry["block"] for entry in rest if entry.get("event") in ("quarantined", "reopened")}
    given_up = np.flatnonzero(plan["block_states"] == BlockState.QUARANTINED).tolist()
    why = "given up before, as the plan in the bag says"
    rest += [{"event": "quarantined", "block": block, "why": why} for block in given_up if block not in said]
    return [first, *rest], sweep


def _rounds(
    path: Path, sweep: Sweep, entries: list[dict[str, Any]], survey: Survey
) -> tuple[Blocks, list[dict[str, Any]], bool]:
    """Return the blocks that ledger and bag have, the longer of the two, and the entries with them."""
    kept: list[dict[str, Any]] = []
    count = 0
    for entry in entries:
        if entry.get("event") == "round":
            if entry.get("round", count + 1) != count + 1:
                continue  # one before it is lost
            try:
                blocks_of(sweep, [*kept, entry])
            except ValueError:
                continue
            count += 1
        kept.append(entry)
    blocks = blocks_of(sweep, kept)
    there = survey.expected.planned if survey.expected else blocks
    if not (there.extends(blocks) or blocks.extends(there)):
        raise RunError(
            f"{path}: has rounds of other cells than {path.parent / FOLDER}; to go on with those of the bag: "
            f"mv {path} {path}.other, then resume it again"
        )
    if there.extends(blocks):
        for number in range(count, len(there.rounds) if there.adaptive else 0):
            part = Blocks(there.cells, there.block_cells, there.rounds[: number + 1])
            kept.append(round_entry(part))
        blocks = there
    return blocks, kept, kept != entries


def _write(directory: Path, reading: Reading, entries: list[dict[str, Any]], changed: bool, say: Say) -> None:
    """Put a repaired ledger in the place of the one that is there, which is kept beside it."""
    if reading.exists:
        aside = set_ledger_aside(directory)
        lines = f"lines {', '.join(map(str, reading.bad[:5]))}{' ...' if len(reading.bad) > 5 else ''} are no entries"
        what = lines if reading.bad else "entries are added or left out"
        say(f"{LEDGER}: {what}; what it was is in {aside}")
    write_ledger(directory, entries)


# ---- what was done


def _differences(
    entries: Sequence[Mapping[str, Any]], survey: Survey, blocks: Blocks, say: Say
) -> list[dict[str, Any]]:
    """Return the events that make the ledger say what the bag has."""
    states = latest_states(entries)
    known = survey.expected.blocks if survey.expected else 0
    attempts: dict[int, int] = {}
    for entry in entries:
        if isinstance(entry.get("block"), int):
            attempts[entry["block"]] = max(attempts.get(entry["block"], 0), int(entry.get("attempt", 0)))
    epoch = max(int(entry.get("epoch", 1)) for entry in entries)
    events: list[dict[str, Any]] = []
    for block in range(blocks.count):
        attempt = max(attempts.get(block, 0), survey.attempts.get(block, 0))
        state = states.get(block, "")
        if state == "quarantined":
            continue
        lacks = survey.lacks(block) if block < known else "nothing of it is in the bag"
        if state == "done" and lacks:
            events.append({"event": "reopened", "block": block, "attempt": attempt, "why": lacks})
        elif state != "done" and not lacks:
            events.append({"event": "done", "block": block, "attempt": attempt, "why": "found whole in the bag"})
        elif attempt > attempts.get(block, 0):
            events.append({"event": "due", "block": block, "attempt": attempt, "why": "found in part in the bag"})
    if survey.epoch > epoch:
        events.append({"event": "resumed", "epoch": survey.epoch, "why": "the epoch of the bag"})
    reopened = [event for event in events if event["event"] == "reopened"]
    found = [event for event in events if event["event"] == "done"]
    if reopened:
        first = reopened[0]
        say(
            f"{len(reopened)} of {blocks.count} blocks are due again, the bag does not have them whole "
            f"(first: block {first['block']}, {first['why']})"
        )
    if found:
        say(f"{len(found)} of {blocks.count} blocks are whole in the bag, the ledger did not know: they are done")
    return events


def _agrees(directory: Path, survey: Survey, say: Say) -> bool:
    """Whether a run is finished: its bag is closed, and what lies beside it agrees with it."""
    from bow_sweep.record.verify import account

    lost = [name for name in (MAP, REPORT, PICTURE) if not (directory / name).is_file()]
    problems = [f"{name}: is not there" for name in lost]
    if not problems:
        result = account(survey, directory, judge=False)
        problems = [f"{problem.get('file', FOLDER)}: {problem['what']}" for problem in result["problems"]]
    if not problems and not _is_its_picture(directory):
        problems = [f"{PICTURE}: is damaged, or of another map"]
    if problems:
        say(f"to be finished again: {problems[0]}" + (f", and {len(problems) - 1} more" if problems[1:] else ""))
    return not problems


def _is_its_picture(directory: Path) -> bool:
    """Whether the picture is the one that the report was written with; reports of old do not say."""
    right = json.loads((directory / REPORT).read_bytes()).get("picture")
    return right is None or right == digest(directory / PICTURE)
