"""All bags of a run read as one: ``bag/`` of the coordinator's machine, and ``bag/NAME/`` of each station.

A block counts from one bag: that of the station that the ledger names as having done it. Where that bag is not here, or
lacks the block, it counts from one that has it whole. Its messages in other bags are duplicates, with equal checksums.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from bow_sim.protocol import stations
from bow_sim.protocol.states import BlockState, PlanState, ReceiptKind
from bow_sweep.record.bag import COLLECTED, bag_files, bag_of, bags_in, run_of_bag, station_of_bag
from bow_sweep.record.bag_contents import MAX_PROBLEMS, Key, Progress, RunIdentity, Survey
from bow_sweep.run.ledger_file import done_at, read_leniently

UNKNOWN = "?"
"""Station of blocks that are done in a bag which is not here, where no ledger names it."""

NOT_HERE = "whose bag is not here, or was collected before; `bow collect` brings it"


class RunSurvey(Survey):
    """The contents of all bags of a run, each block from one of them.

    Parameters
    ----------
    directory
        The folder of the bags.
    bags
        Station -> the contents of its bag.
    done
        Block -> the station that did it, from the ledger; None without a ledger.
    identity
        Of the run, where it is known: bags of other runs are left out, and are a problem.

    Attributes
    ----------
    bags
        Station -> the contents of its bag, of those that are of this run.
    copies
        Stations whose bags `bow collect` has brought.
    counts_from
        Block -> the station from whose bag it counts, here or not.
    unseen
        Station -> its blocks that no bag here has whole, while its own bag is not here, or was collected before they
        were done.
    """

    def __init__(
        self,
        directory: Path,
        bags: Mapping[str, Survey],
        done: Mapping[int, str] | None = None,
        identity: RunIdentity | None = None,
    ) -> None:
        super().__init__(directory)
        self.bags = dict(bags)
        self.copies = {station for station, bag in bags.items() if (bag.directory / COLLECTED).is_file()}
        self.counts_from: dict[int, str] = {}
        self.unseen: dict[str, list[int]] = {}
        self._leave_out_other_runs(identity)
        for station, bag in self.bags.items():
            self._take_problems(station, bag)
            self.messages += bag.messages
            self.version = max(self.version, bag.version)
            self.noted += bag.noted
            self.files += [_named(station, file) for file in bag.files]
        planned = [bag for bag in self.bags.values() if bag.expected is not None]
        if not planned:
            return
        latest = max(planned, key=_age)
        self.expected, self.plan, self.identity = latest.expected, latest.plan, latest.identity
        self.epoch = max(bag.epoch for bag in planned)
        for bag in planned:
            for block, attempt in bag.attempts.items():
                self.attempts[block] = max(attempt, self.attempts.get(block, 0))
        self._choose(done)
        for station, bag in self.bags.items():
            self._take_blocks(station, bag)
        if len(planned) > 1:
            self._compare()

    def _leave_out_other_runs(self, identity: RunIdentity | None) -> None:
        right = identity or next((bag.identity for bag in self.bags.values() if bag.identity), None)
        for station, bag in list(self.bags.items()):
            if station and bag.identity not in (None, right):
                found = "is of run {}, sweep {}".format(*bag.identity)
                should = "should be of run {}, sweep {}".format(*right) if right else ""
                self.problem(f"{found}; {should}", file=f"{station}/", station=station)
                del self.bags[station]

    def _take_problems(self, station: str, bag: Survey) -> None:
        for problem in bag.problems[: MAX_PROBLEMS - len(self.problems)]:
            self.problems.append(_placed(station, problem))
        self.problem_count += bag.problem_count

    # ---- which bag a block counts from

    def _choose(self, done: Mapping[int, str] | None) -> None:
        """Find out for each block from which bag it counts."""
        assert self.expected is not None
        if not any(self.bags) and not any((done or {}).values()):  # no stations
            self.counts_from = dict.fromkeys(range(self.expected.blocks), "")
            return
        elsewhere = done is None and "" not in self.bags
        states = self.plan["block_states"].tolist()
        parts = {station: _blocks_in(bag) for station, bag in self.bags.items()}
        for block in range(self.expected.blocks):
            having = [station for station, blocks in parts.items() if block in blocks]
            named = (done or {}).get(block)
            having.sort(key=lambda station: station != named)
            early = {station for station in self.bags if self._was_collected_before(block, station)}
            whole = [station for station in having if station not in early and not self.bags[station].lacks(block)]
            if elsewhere and block < len(states) and states[block] == BlockState.DONE and not self._promised(block):
                named = UNKNOWN
            if whole:
                self.counts_from[block] = whole[0]
                if named not in early:
                    self._tell_of_another(block, named, whole[0])
            elif named and (named not in self.bags or named in early):
                self.counts_from[block] = named
                self.unseen.setdefault(named, []).append(block)
            else:
                most = max(having, key=lambda station: (station == named, parts[station][block]), default="")
                self.counts_from[block] = most if named is None else named

    def _was_collected_before(self, block: int, station: str) -> bool:
        """Return whether the bag of a station is a copy that ends before a block was done, by all that it states."""
        if station not in self.copies:
            return False
        bag = self.bags[station]
        states = bag.plan["block_states"] if bag.plan else ()
        is_done = block < len(states) and states[block] == BlockState.DONE
        return not is_done and (ReceiptKind.BLOCK, block, 0) not in bag.receipts

    def _promised(self, block: int) -> bool:
        """Return whether a bag here states that a whole block is on its disk."""
        return any((ReceiptKind.BLOCK, block, 0) in bag.receipts for bag in self.bags.values())

    def _tell_of_another(self, block: int, named: str | None, station: str) -> None:
        if named is not None and named != station and named in self.bags:
            bag = self.bags[named]
            lacks = bag.lacks(block) if bag.expected else "it holds no plan"
            what = f"was done at {in_words(named)}, whose bag lacks it ({lacks}); that of {in_words(station)} has it"
            self.problem(what, block=block, **stations.named(named))

    def _take_blocks(self, station: str, bag: Survey) -> None:
        """Take in what counts from a bag."""
        if len(self.bags) == 1 and not self.unseen:
            self.places, self.verdicts, self.receipts = bag.places, bag.verdicts, bag.receipts
            return

        def counts(block: int) -> bool:
            return self.counts_from.get(block, station) == station and not self.is_unseen(block)

        for topic, places in bag.places.items():
            self.places[topic].update((key, place) for key, place in places.items() if counts(key[0]))
        self.verdicts.update((key, verdict) for key, verdict in bag.verdicts.items() if counts(key[0]))
        for key, checksums in bag.receipts.items():
            if counts(key[1]):
                self.receipts.setdefault(key, set()).update(checksums)

    def _compare(self) -> None:
        """Compare the checksums of what several bags have."""
        known: dict[tuple[str, Key], tuple[int, str]] = {}
        for station, bag in self.bags.items():
            stores: dict[str, Mapping[Key, Any]] = {**bag.places, "verdicts": bag.verdicts}
            for topic, stored in stores.items():
                for key, message in stored.items():
                    checksum, before = known.setdefault((topic, key), (message.checksum, station))
                    if checksum != message.checksum:
                        what = f"{topic} is {message.checksum:016x}, at {in_words(before)} {checksum:016x}"
                        self.problem(what, block=key[0], chunk=key[1], **stations.named(station))

    # ---- reading

    def at(self, block: int) -> dict[str, str]:
        """Return the station of a block as the place of a problem; empty for that of the coordinator's machine."""
        return stations.named(self.counts_from.get(block, ""))

    def is_unseen(self, block: int) -> bool:
        """Return whether a block was done where its bag is not here, or goes on."""
        return block in self.unseen.get(self.counts_from.get(block, ""), ())

    def is_receipted(self, block: int) -> bool:
        """Return whether the bag from which a block counts says that all of it is on the disk."""
        return (ReceiptKind.BLOCK, block, 0) in self.receipts

    def version_of(self, block: int) -> int:
        """Return the version of the bag from which a block counts."""
        bag = self.bags.get(self.counts_from.get(block, ""))
        return bag.version if bag else self.version


def read_run(
    run_directory: Path, kind: type[Survey] = Survey, progress: Progress | None = None, share: float = 1.0
) -> RunSurvey:
    """Read all bags of a run.

    Parameters
    ----------
    run_directory
        Of the run; or the folder of its bags; or a bag alone.
    kind
        How each bag is read.
    progress
        Called with (done, total) bytes of all files.
    share
        Of reading in the work that `progress` reports.

    Raises
    ------
    BagError
        Where there is no bag.
    """
    folder = bag_of(run_directory)
    bags = bags_in(folder)
    sizes = {station: sum(path.stat().st_size for path in bag_files(bag)) for station, bag in bags.items()}
    found: dict[str, Survey] = {}
    for station, bag in bags.items():
        before = sum(sizes[name] for name in found) * share
        found[station] = kind(bag).read(progress and _after(progress, before, sum(sizes.values())), share)
    reading = read_leniently(folder if station_of_bag(folder) else run_of_bag(folder))
    first = reading.entries[0] if reading.planned else None
    identity = RunIdentity(first["run_id"], first["sweep_id"]) if first else None
    return RunSurvey(folder, found, done_at(reading.entries) if reading.exists else None, identity)


def unseen_in_words(unseen: Mapping[str, Sequence[int]]) -> Iterator[str]:
    """Yield a line for each station whose blocks are not here; `unseen` as of :class:`RunSurvey`."""
    for station, blocks in sorted(unseen.items()):
        what = f"{len(blocks)} block{'s' * (len(blocks) != 1)} of {in_words(station)}"
        yield f"not seen: {what}, {NOT_HERE}"


def in_words(station: str) -> str:
    """Return how a station is called."""
    if station == UNKNOWN:
        return "a station that no ledger here names"
    if not station:
        return "the coordinator's machine"
    return station if station.startswith("station") else f"station {station}"


def _after(progress: Progress, before: float, total: float) -> Progress:
    return lambda done, _: progress(before + done, total)


def _age(bag: Survey) -> tuple[int, int, int, bool]:
    """Return what is larger for a later plan."""
    states = bag.plan["block_states"]
    return bag.plan["epoch"], len(states), int((states != 0).sum()), bag.plan["state"] == PlanState.CLOSED


def _blocks_in(bag: Survey) -> dict[int, int]:
    """Return block -> number of its messages in a bag."""
    counts: dict[int, int] = {}
    stores: list[Mapping[Key, Any]] = [*bag.places.values(), bag.verdicts]
    for stored in stores:
        for block, _ in stored:
            counts[block] = counts.get(block, 0) + 1
    return counts


def _named(station: str, file: Any) -> Any:
    return dataclasses.replace(file, name=f"{station}/{file.name}") if station else file


def _placed(station: str, problem: dict[str, Any]) -> dict[str, Any]:
    """Return a problem of a station's bag, with the station."""
    if not station:
        return problem
    file = {"file": f"{station}/{problem['file']}"} if "file" in problem else {}
    return {**problem, **file, "station": station}
