"""Resuming a run: ledger and bag, two records of the same run, are compared and repaired before anything else.

They can be of different age: copies made while it ran, restored backups, deleted files, power cuts. A block that is not
complete in a bag is due again, whatever the ledger states; a block that is complete there is done. Bags and ledger are
repaired first; what is taken out of them is kept in files beside them. Blocks of a station whose bag is not here are
computed again only if somebody says that it is lost.
"""

from __future__ import annotations

import json
from collections.abc import Collection, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from bow_sim.physics.errors import ParameterError
from bow_sim.protocol.blocks import Blocks
from bow_sim.protocol.states import BlockState
from bow_sweep.coordinator.bags_of_run import Log, check_lost, need_all_bags, repaired_bags
from bow_sweep.maps.map_file import MAP
from bow_sweep.plan.sweep import Sweep
from bow_sweep.record.bag import FOLDER
from bow_sweep.record.bag_contents import Survey
from bow_sweep.record.run_bags import RunSurvey, in_words, unseen_in_words
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
from bow_sweep.run.errors import OtherProgramError
from bow_sweep.run.ledger_file import (
    LEDGER,
    Reading,
    done_at,
    latest_states,
    read_leniently,
    set_ledger_aside,
    write_ledger,
)
from bow_sweep.run.lock import locked


class Prepared(NamedTuple):
    """A run that can be resumed; its ledger on disk agrees with its bag.

    Attributes
    ----------
    survey
        What is in its bags.
    complete
        Nothing is left to do: every block is settled, and the files beside the bag agree with it.
    """

    run_id: str
    sweep: Sweep
    survey: RunSurvey
    complete: bool


class Resumed(NamedTuple):
    """A resumed run, and the verdicts in its bag, None if it holds no plan.

    The verdicts are as :func:`bow_sweep.record.replay.load_verdicts` returns them.
    """

    run: Run
    layers: dict[str, np.ndarray] | None


class _Plan(NamedTuple):
    """The plan of a run as its entries give it: these begin with it."""

    entries: list[dict[str, Any]]
    sweep: Sweep
    blocks: Blocks


def resume(directory: Path, log: Log = lambda _: None, locks: bool = True) -> Resumed:
    """Resume a run, as its coordinator.

    Where a recorder is at work on it, only the coordinator was started again: nobody is asked then, and blocks in bags
    that are not here are computed again.

    Raises
    ------
    RunError
        As :func:`prepare`.
    """
    survey = prepare(directory, log, locks, going_on=True).survey
    return Resumed(Run.resume(directory, locks), survey.layers() if survey.expected else None)


def prepare(
    directory: Path,
    log: Log = lambda _: None,
    locks: bool = True,
    lost: Collection[str] = (),
    going_on: bool = False,
) -> Prepared:
    """Repair ledger and bags of a run and make the ledger agree with the bags.

    Parameters
    ----------
    log
        Takes lines about what was found and done.
    locks
        Lock the directory meanwhile.
    lost
        Stations whose bags are lost: their blocks are computed again.
    going_on
        Where a recorder is at work on the run, so are those of all stations whose bags are not here.

    Raises
    ------
    RunError
        If the run cannot be resumed; the message says what would be right.
    """
    if not directory.is_dir():
        raise RunError(f"{directory / LEDGER}: no such directory; a run directory of `bow sweep` holds one")
    try:
        with locked(directory, "coordinator", locks):
            return _prepare(directory, log, locks, lost, going_on)
    except OSError as error:
        raise RunError(f"{error.filename or directory}: {error.strerror or error}") from None


def _prepare(directory: Path, log: Log, locks: bool, lost: Collection[str], going_on: bool) -> Prepared:
    reading = read_leniently(directory)
    survey, at_work = repaired_bags(directory, reading, log, locks)
    check_lost(directory, survey, lost)
    if going_on and at_work:
        lost = list(survey.unseen)
    plan = _with_rounds_of_bag(directory / LEDGER, _plan(directory / LEDGER, reading, survey, log), survey)
    if reading.bad or plan.entries != reading.entries:
        _replace_ledger(directory, reading, plan.entries, log)
    entries = plan.entries
    events = _differences(entries, survey, plan.blocks, lost, log)
    settled = _settled([*entries, *events], plan.blocks)
    complete = settled and _results_agree(directory, survey, log)
    if not complete:
        need_all_bags(directory, survey, lost)
    for line in unseen_in_words({name: blocks for name, blocks in survey.unseen.items() if name not in lost}):
        log(line)
    if events:
        entries = [*entries, *events]
        write_ledger(directory, entries)
    return Prepared(entries[0]["run_id"], plan.sweep, survey, complete)


def _settled(entries: Sequence[Mapping[str, Any]], blocks: Blocks) -> bool:
    states = latest_states(entries)
    return all(states.get(block, "reopened") != "reopened" for block in range(blocks.count))


# ---- the plan


def _plan(path: Path, reading: Reading, survey: Survey, log: Log) -> _Plan:
    """Return the plan of the ledger at `path`; if it is lost or not valid, the latest one of the bag."""
    if not reading.planned:
        problem = f"{path}: {'has lost its first line, the plan' if reading.exists else 'is not there'}"
        if not survey.plan:
            raise RunError(
                f"{problem}; the bag holds no plan either, so it is unknown which sweep this is: sweep anew, "
                "bow sweep PRESET --out ANOTHER_DIRECTORY"
            )
    else:
        try:
            sweep = sweep_of(reading.entries[0], path)
        except RunError as error:
            problem = str(error)
            if not survey.plan:
                if isinstance(error, OtherProgramError):
                    raise
                raise RunError(
                    f"{problem}; the bag holds no plan to take its place: sweep anew, "
                    "bow sweep PRESET --out ANOTHER_DIRECTORY"
                ) from None
        else:
            return _with_valid_rounds(sweep, reading.entries)
    entries = _entries_from_bag(path, reading.entries, survey, problem)
    log(f"{problem}; it is made anew from the bag")
    return _with_valid_rounds(sweep_of(entries[0], path), entries)


def _entries_from_bag(
    path: Path, entries: Sequence[Mapping[str, Any]], survey: Survey, problem: str
) -> list[dict[str, Any]]:
    """Return entries that begin with the latest plan of the bag."""
    plan = survey.plan
    try:
        sweep = Sweep.from_spec("", plan["spec.settings"])
    except ParameterError as error:
        raise RunError(f"{problem}; the plan in the bag is not valid either: {error}") from None
    first = {
        **planned(plan["run_id"], sweep, plan["epoch"]),
        "preset": plan["spec.preset"],
        "sweep_id": plan["sweep_id"],
        "fingerprint": plan["fingerprint"],
        "why": "made anew from the bag",
    }
    rest = [dict(entry) for entry in entries if entry.get("event") not in ("planned", "round")]
    known = {entry["block"] for entry in rest if entry.get("event") in ("quarantined", "reopened")}
    quarantined = np.flatnonzero(plan["block_states"] == BlockState.QUARANTINED).tolist()
    why = "quarantined in the plan in the bag"
    rest += [{"event": "quarantined", "block": block, "why": why} for block in quarantined if block not in known]
    return [first, *rest]


def _with_valid_rounds(sweep: Sweep, entries: Sequence[dict[str, Any]]) -> _Plan:
    """Return the entries without rounds that do not follow the one before, and the blocks that they give."""
    kept: list[dict[str, Any]] = []
    blocks, number = sweep.first_blocks, 1
    for entry in entries:
        if entry.get("event") == "round":
            if entry.get("round", number) != number:
                continue  # one before it is lost
            try:
                blocks = blocks_of(sweep, [*kept, entry])
            except ValueError:
                continue
            number += 1
        kept.append(entry)
    return _Plan(kept, sweep, blocks)


def _with_rounds_of_bag(path: Path, plan: _Plan, survey: Survey) -> _Plan:
    """Return the plan with an entry for each round, also for those that only the bag has.

    Raises
    ------
    RunError
        If ledger and bag have rounds of different cells.
    """
    of_bag = survey.expected.planned if survey.expected else plan.blocks
    if not of_bag.extends(plan.blocks):
        if plan.blocks.extends(of_bag):
            return plan
        raise RunError(
            f"{path}: has rounds of other cells than {path.parent / FOLDER}; to resume with those of the bag: "
            f"mv {path} {path}.other, then resume it again"
        )
    recorded = sum(entry.get("event") == "round" for entry in plan.entries)
    missing = range(recorded, len(of_bag.rounds) if of_bag.adaptive else 0)
    parts = [Blocks(of_bag.cells, of_bag.block_cells, of_bag.rounds[: number + 1], of_bag.kinds) for number in missing]
    return plan._replace(entries=[*plan.entries, *map(round_entry, parts)], blocks=of_bag)


def _replace_ledger(directory: Path, reading: Reading, entries: list[dict[str, Any]], log: Log) -> None:
    """Replace the ledger by a repaired one, and keep a copy of it."""
    if reading.exists:
        aside = set_ledger_aside(directory)
        lines = f"lines {', '.join(map(str, reading.bad[:5]))}{' ...' if len(reading.bad) > 5 else ''} are not entries"
        what = lines if reading.bad else "entries are added or left out"
        log(f"{LEDGER}: {what}; its old content is in {aside}")
    write_ledger(directory, entries)


# ---- what was done


def _differences(
    entries: Sequence[Mapping[str, Any]], survey: RunSurvey, blocks: Blocks, lost: Collection[str], log: Log
) -> list[dict[str, Any]]:
    """Return the entries that make the ledger agree with the bags.

    Blocks in bags that are not here stay as the ledger has them, unless their station is lost.
    """
    states, stations = latest_states(entries), done_at(entries)
    known = survey.expected.blocks if survey.expected else 0
    attempts: dict[int, int] = {}
    for entry in entries:
        if isinstance(entry.get("block"), int):
            attempts[entry["block"]] = max(attempts.get(entry["block"], 0), int(entry.get("attempt", 0)))
    events: list[dict[str, Any]] = []
    moved: list[dict[str, Any]] = []
    for block in range(blocks.count):
        attempt = max(attempts.get(block, 0), survey.attempts.get(block, 0))
        state = states.get(block, "")
        if state == "quarantined":
            continue
        lacks = survey.lacks(block) if block < known else "nothing of it is in the bag"
        if state == "done" and survey.is_unseen(block):
            if stations[block] not in lost:
                continue
            lacks = f"the bag of {in_words(stations[block])} is lost, or not here"
        where = survey.at(block)
        if state == "done" and lacks:
            events.append({"event": "reopened", "block": block, "attempt": attempt, "why": lacks})
        elif state != "done" and not lacks and (not where.get("station") or survey.is_receipted(block)):
            # The recorder of a station that is not there any more gives no receipt: such a block is computed again.
            why = "found complete in the bag"
            events.append({"event": "done", "block": block, "attempt": attempt, **where, "why": why})
        elif state == "done" and stations[block] != where.get("station", ""):
            why = f"not in the bag of {in_words(stations[block])}"
            moved.append({"event": "done", "block": block, "attempt": attempt, **where, "why": why})
        elif attempt > attempts.get(block, 0):
            events.append({"event": "due", "block": block, "attempt": attempt, "why": "found in part in the bag"})
    reopened = [event for event in events if event["event"] == "reopened"]
    found = [event for event in events if event["event"] == "done"]
    events += moved
    if survey.epoch > max(int(entry.get("epoch", 1)) for entry in entries):
        events.append({"event": "resumed", "epoch": survey.epoch, "why": "the epoch of the bag"})
    if reopened:
        first = reopened[0]
        log(
            f"{len(reopened)} of {blocks.count} blocks are due again, they are not complete in the bag "
            f"(first: block {first['block']}, {first['why']})"
        )
    if found:
        log(f"{len(found)} of {blocks.count} blocks are complete in the bag, but not done in the ledger: they are done")
    if moved:
        log(f"{len(moved)} of {blocks.count} blocks count from the bag of another station than the ledger names")
    return events


def _results_agree(directory: Path, survey: RunSurvey, log: Log) -> bool:
    """Return whether a run is finished: its bag is closed, and the files beside it agree with it."""
    from bow_sweep.record.verify import account

    lost = [name for name in (MAP, REPORT, PICTURE) if not (directory / name).is_file()]
    problems = [f"{name}: is not there" for name in lost]
    if not problems:
        result = account(survey, directory, classify=False)
        problems = [f"{problem.get('file', FOLDER)}: {problem['what']}" for problem in result["problems"]]
    if not problems and not _is_picture_of_report(directory):
        problems = [f"{PICTURE}: is damaged, or of another map"]
    if problems:
        log(f"to be finished again: {problems[0]}" + (f", and {len(problems) - 1} more" if problems[1:] else ""))
    return not problems


def _is_picture_of_report(directory: Path) -> bool:
    """Return whether the report was written with this picture; old reports do not state it."""
    right = json.loads((directory / REPORT).read_bytes()).get("picture")
    return right is None or right == digest(directory / PICTURE)
