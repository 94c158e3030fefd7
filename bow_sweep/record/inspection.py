"""Decides what to do with each file of a bag that may be torn, damaged, a copy, or older than the others.

Each file of ours begins with a plan, continues the numbers of its messages from the file before, and stores nothing
that is stored already. So a file can be checked alone, and against the files before it.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path

from bow_sweep.record.bag import BagError, bag_files
from bow_sweep.record.bag_contents import RunIdentity, Survey
from bow_sweep.record.mcap_reader import Scan
from bow_sweep.record.mcap_records import Damage
from bow_sweep.record.mcap_writer import MAGIC, RECORD_HEAD
from bow_sweep.record.notes import Range, too_new

KEEP, MEND, ASIDE, REFUSE = "keep", "mend", "set aside", "refuse"
"""What is done with a file."""


@dataclass
class Part:
    """One file of a bag.

    Attributes
    ----------
    scan, survey
        Its records, and its contents.
    was
        "whole", "torn", "damaged", or "misplaced": a copy, an older version, or of another run.
    action, why
        What to do with it, and why.
    """

    scan: Scan
    survey: Survey
    was: str = "whole"
    action: str = KEEP
    why: str = ""

    @property
    def path(self) -> Path:
        """Of the file."""
        return self.scan.path

    @property
    def dropped_bytes(self) -> int:
        """Number of bytes of a torn file that are cut off: after its last complete chunk, or after its end."""
        start = min(
            [self.scan.good_end if not self.scan.finished else self.scan.size, *(d.start for d in self.scan.damage)]
        )
        return self.scan.size - start if self.was == "torn" else 0

    @property
    def identity(self) -> RunIdentity | None:
        """Run and sweep of its first plan."""
        return self.survey.identity


@dataclass
class Inspection:
    """The files of a bag.

    Attributes
    ----------
    survey
        Contents of the bag when all actions are done.
    """

    parts: list[Part] = field(default_factory=list)
    survey: Survey = field(default_factory=lambda: Survey(Path()))

    @property
    def missing(self) -> list[Range]:
        """Numbers of the messages that are missing, unless a file lists them as missing."""
        return self.survey.missing()


def inspect(directory: Path, identity: RunIdentity | None = None, resuming: bool = False) -> Inspection:
    """Read all files of a bag and decide what to do with each; changes nothing.

    Parameters
    ----------
    directory
        Of the bag.
    identity
        Run and sweep of the bag, where they are known.
    resuming
        The run is resumed: files of other writers that it cannot continue from are set aside.

    Raises
    ------
    BagError
        Where no file is of that run; or where it is not known, and the files are of several runs. Where a file was
        written by a later bow.
    """
    found = Inspection(survey=Survey(directory))
    for path in bag_files(directory):
        part = _read(path, found.survey)
        if not part.scan.damage and (why := too_new(part.survey.version)):
            raise BagError(f"{path}: {why}")
        found.parts.append(part)
        right = identity or next((p.identity for p in found.parts if p.identity), None)
        if part.identity in (None, right):
            _decide(part, found.survey, resuming)
        else:
            part.was, part.action, part.why = "misplaced", ASIDE, "is of run {}, sweep {}".format(*part.identity)
        if part.action in (KEEP, MEND):
            found.survey.merge(part.survey)
    _refuse_other_runs(directory, found.parts, identity)
    return found


def _read(path: Path, before: Survey) -> Part:
    scan = Scan(path)
    survey = Survey(path.parent, before.expected, last=None)
    for _ in survey.read_file(scan):
        pass
    return Part(scan, survey)


def _decide(part: Part, before: Survey, resuming: bool) -> None:
    """Decide what to do with a file of the right run, given the contents of the files before it."""
    scan = part.scan
    last = max((chunk.chunk_start_offset + chunk.chunk_length for chunk in scan.contents.chunks), default=0)
    ends = [damage.kind == "end" or (damage.kind == "index" and damage.start >= last) for damage in scan.damage]
    torn = not scan.finished and all(ends)
    tail = bool(scan.damage) and all(damage.kind == "tail" for damage in scan.damage)
    part.was = "whole" if scan.whole else "torn" if torn or tail else "damaged"
    if scan.whole or torn or tail:
        part.action = KEEP if scan.whole else MEND
    elif scan.ours and all(_can_be_mended(scan, damage) for damage in scan.damage):
        part.action = MEND
    elif scan.ours or resuming or _has_no_head(scan):
        part.action, part.why = ASIDE, f"cannot be mended: {scan.damage[0].what}"
    else:
        part.action, part.why = REFUSE, "is not of bow, and damaged within: it is left as it is"
    if part.action in (KEEP, MEND) and (scan.ours or resuming):
        packed = any(chunk.compression for chunk in scan.contents.chunks)
        why = "is compressed, which bow does not read" if packed else _why_misplaced(part.survey, before)
        if why:
            part.was, part.action, part.why = "misplaced", ASIDE, why


def _can_be_mended(scan: Scan, damage: Damage) -> bool:
    """Return whether damaged bytes can be derived again, cut off, or covered by a record."""
    if damage.kind == "bytes":
        return damage.end == scan.size or damage.end - damage.start >= RECORD_HEAD.size
    return damage.kind != "data"


def _has_no_head(scan: Scan) -> bool:
    """Return whether the writer of a file is unknown, because its start is damaged."""
    return not scan.library and scan.damage[0].start < len(MAGIC)


def _why_misplaced(survey: Survey, before: Survey) -> str:
    """Return why a readable file does not continue the files before it; "" where it does."""
    if survey.problems:
        problem = survey.problems[0]
        return f"message {problem.get('message', '?')}: {problem['what']}"
    if survey.first is not None and survey.first <= (before.last or 0):
        return (
            f"its messages begin at {survey.first}, the file before ends at {before.last}: a copy or an older version"
        )
    twice = survey.verdicts.keys() & before.verdicts.keys()
    for topic, places in survey.places.items():
        twice |= places.keys() & before.places[topic].keys()
    if twice:
        block, chunk = min(twice)
        return f"block {block}, chunk {chunk} is stored before: it is of another copy of this run"
    return ""


def _refuse_other_runs(directory: Path, parts: list[Part], identity: RunIdentity | None) -> None:
    """Raise BagError where the files are of several runs and `identity` is unknown, or none is of this run."""
    names = {part.identity: part.path.name for part in reversed(parts) if part.identity}
    if identity is None and len(names) > 1:
        runs = ", ".join(f"{name} is of run {found.run_id}" for found, name in names.items())
        raise BagError(f"{directory}: is of several runs ({runs}): move away the files that do not belong here")
    if identity is not None and names and identity not in names:
        other = next(iter(names))
        raise BagError(
            f"{directory}: holds run {other.run_id}, sweep {other.sweep_id}; this is run {identity.run_id}, sweep "
            f"{identity.sweep_id}: it needs a directory of its own"
        )
