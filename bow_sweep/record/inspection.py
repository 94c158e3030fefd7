"""What is to be done with each file of a bag that may be torn, damaged, copied, or older than the others.

Every file of ours begins with a plan, numbers its messages on from the file before, and stores nothing again that is
stored. So a file can be judged by itself, and against those before it.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path

from bow_sweep.record.bag import BagError, bag_files
from bow_sweep.record.bag_contents import Survey
from bow_sweep.record.mcap_reader import Scan
from bow_sweep.record.mcap_records import Damage
from bow_sweep.record.mcap_writer import COVER, MAGIC
from bow_sweep.record.notes import Range

KEEP, MEND, ASIDE, REFUSE = "keep", "mend", "set aside", "refuse"
"""What is done with a file."""

Identity = tuple[str, str]
"""Run and sweep, 16 hexadecimal digits each."""


@dataclass
class Part:
    """One file of a bag.

    Attributes
    ----------
    was
        "whole", "torn", "damaged", or "misplaced": a copy, an older version, of another run.
    action, why
        What is to be done with it, and why.
    """

    scan: Scan
    survey: Survey
    was: str = "whole"
    action: str = KEEP
    why: str = ""

    @property
    def path(self) -> Path:
        """Where it is."""
        return self.scan.path

    @property
    def dropped_bytes(self) -> int:
        """How many bytes after the last complete chunk, or after a whole end, are cut off."""
        start = min(
            [self.scan.good_end if not self.scan.finished else self.scan.size, *(d.start for d in self.scan.damage)]
        )
        return self.scan.size - start if self.was == "torn" else 0

    @property
    def identity(self) -> Identity | None:
        """Run and sweep that its first plan is of."""
        return self.survey.said


@dataclass
class Inspection:
    """A bag: its files, and what is in those that stay.

    Attributes
    ----------
    survey
        Of the files that stay, once all is done that is to be done.
    """

    parts: list[Part] = field(default_factory=list)
    survey: Survey = field(default_factory=lambda: Survey(Path()))

    @property
    def missing(self) -> list[Range]:
        """Numbers of the messages that are missing and of which no file says so."""
        return self.survey.missing()


def inspect(directory: Path, identity: Identity | None = None, resuming: bool = False) -> Inspection:
    """Read all files of a bag and say what is to be done with each; changes nothing.

    Parameters
    ----------
    identity
        Run and sweep that the bag belongs to, where it is known.
    resuming
        The run goes on: what others wrote has to be good for that too, or is set aside.

    Raises
    ------
    BagError
        Where none of its files is of that run, or where it is not known and they are of several.
    """
    found = Inspection(survey=Survey(directory))
    for path in bag_files(directory):
        part = _read(path, found.survey)
        found.parts.append(part)
        right = identity or next((p.identity for p in found.parts if p.identity), None)
        if part.identity in (None, right):
            _judge(part, found.survey, resuming)
        else:
            part.was, part.action, part.why = "misplaced", ASIDE, "is of run {}, sweep {}".format(*part.identity)
        if part.action in (KEEP, MEND):
            found.survey.merge(part.survey)
    _refuse_strangers(directory, found.parts, identity)
    return found


def _read(path: Path, before: Survey) -> Part:
    scan = Scan(path)
    survey = Survey(path.parent, before.expected, last=None)
    for _ in survey.read_file(scan):
        pass
    return Part(scan, survey)


def _judge(part: Part, before: Survey, resuming: bool) -> None:
    """Say what is to be done with a file."""
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
        why = "is compressed, which bow does not read" if packed else _misplaced(part.survey, before)
        if why:
            part.was, part.action, part.why = "misplaced", ASIDE, why


def _can_be_mended(scan: Scan, damage: Damage) -> bool:
    """Whether bad bytes can be derived again, cut off, or covered by a record."""
    if damage.kind == "bytes":
        return damage.end == scan.size or damage.end - damage.start >= COVER.size
    return damage.kind != "data"


def _has_no_head(scan: Scan) -> bool:
    """Whether nothing tells what a file is: it does not begin as an MCAP file does."""
    return not scan.library and scan.damage[0].start < len(MAGIC)


def _misplaced(survey: Survey, before: Survey) -> str:
    """Return why a file that can be read does not belong after those before it, or ""."""
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


def _refuse_strangers(directory: Path, parts: list[Part], identity: Identity | None) -> None:
    """Raise where nobody can say which files belong here, or none does."""
    said = {part.identity: part.path.name for part in reversed(parts) if part.identity}
    if identity is None and len(said) > 1:
        names = ", ".join(f"{name} is of run {run}" for (run, _), name in said.items())
        raise BagError(f"{directory}: is of several runs ({names}): move away the files that do not belong here")
    if identity is not None and said and identity not in said:
        run, sweep = next(iter(said))
        raise BagError(
            f"{directory}: holds run {run}, sweep {sweep}; this is run {identity[0]}, sweep {identity[1]}: it needs a "
            "directory of its own"
        )
