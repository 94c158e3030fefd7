"""Checks a run: every cell, chunk, sample and checksum of its bag, and its verdicts, which are computed again.

The recorded streams are the reference: verdicts, receipts, plan, map and ledger are compared with them. Of a run that
does not record them, some blocks are computed again instead, see :mod:`bow_sweep.record.again`.
"""

from __future__ import annotations

import time
from pathlib import Path
from typing import Any

import numpy as np

from bow_classifier.verdict.regimes import is_helmholtz
from bow_sim.physics.errors import ParameterError
from bow_sim.protocol.states import BlockState, PlanState, ReceiptKind
from bow_sim.protocol.sweep_outline import SweepOutline
from bow_sim.protocol.verdict_fields import differing
from bow_sweep.maps.map_file import MAP
from bow_sweep.plan.adaptive import next_round, within_budget
from bow_sweep.record.again import Again, Kernel, compare
from bow_sweep.record.bag import FOLDER, BagError
from bow_sweep.record.bag_contents import Chunks, Key, Progress, Survey
from bow_sweep.record.index_contents import IndexSurvey
from bow_sweep.record.replay import SCAN_SHARE, classify_block, task_of
from bow_sweep.record.run_bags import RunSurvey, read_run
from bow_sweep.record.verify_files import FileChecks, transient_lengths
from bow_sweep.run.directory import LEDGER, REPORT

EARLY_BYTES = 1 << 32
"""A larger bag is not checked while the last files are written: nobody looks after the processes meanwhile."""

RECEIPTS_BLOCKS = 2
"""From this version of the record on, complete blocks have a receipt of their own."""


def verify(
    run_directory: Path,
    progress: Progress | None = None,
    classify: bool = True,
    index: bool = False,
    again: Again | None = None,
) -> dict[str, Any]:
    """Check everything in a run's bag.

    Parameters
    ----------
    run_directory
        Of the run; or a bag alone: then there is no map or ledger to compare with it. All bags of a run are read, see
        :mod:`bow_sweep.record.run_bags`.
    progress
        Called with (done, total).
    classify
        Compute the verdicts again.
    index
        Find the messages by the index of the files and trust their checksums, instead of reading every byte.
    again
        What to compute again; None: nothing.

    Returns
    -------
    dict
        For JSON. ``ok``: there is no problem. ``cells``, ``chunks``, ``samples``: complete, each counted once;
        ``*_planned``: planned, which includes ``cells_quarantined``. ``chunks_recorded``: those whose streams are in
        the bag. ``verdicts_equal``: the number of ``chunks`` whose verdicts were derived again with the same bytes.
        ``computed_again``: blocks and cells that were, and how many of the cells are as recorded; only where ``again``
        asks for some. ``quarantined_blocks``: listed, and no problem, because the
        sweep has reported them. ``unseen``: station -> the blocks that it did and whose bag is not here, and
        ``cells_unseen``, their cells: no problem, but nothing is said of them. ``problems``: dicts with ``what``,
        ``run`` and the place: ``block``, ``chunk``, ``file``, ``station`` ...
    """
    began = time.monotonic()
    survey = _read(run_directory, index, progress, SCAN_SHARE if classify else 1.0)
    result = account(survey, Path(run_directory), classify, progress, again)
    return {**result, "seconds": round(time.monotonic() - began, 2)}


class SelfCheck:
    """The check of a run at its end; most of it can be done while the last files are written.

    Parameters
    ----------
    run_directory
        Of the run.
    whole
        Read every byte of the bag; otherwise only its index.
    """

    def __init__(self, run_directory: Path, *, whole: bool) -> None:
        self._directory, self._whole = run_directory, whole
        self._begun: tuple[RunSurvey, _Accounts] | None = None
        self._stamps: list[tuple[Any, ...]] = []

    def begin(self) -> bool:
        """Check bag, ledger and map, unless that takes long; return False if the map is not written yet.

        Call it when the bag is closed. Whatever changes afterwards is checked by :meth:`end`.
        """
        if self._whole or (self._directory / REPORT).is_file():
            return True
        if not (self._directory / MAP).is_file():
            return False
        self._stamps = self._look()
        if sum(size for _, size, *_ in self._stamps) <= EARLY_BYTES:
            survey = _read(self._directory, index=True)
            if survey.expected is not None and survey.plan:
                accounts = _Accounts(survey, survey.expected)
                accounts.all(self._directory, None, False, None)
                self._begun = survey, accounts
        return True

    def end(self) -> dict[str, Any]:
        """Check what was not checked, or has changed since; return the same as :func:`verify`, as far as that counts.

        Returns
        -------
        dict
            ``ok``, ``problem_count``, ``problems`` and ``unseen``.
        """
        if self._begun is None or self._stamps != self._look():
            return verify(self._directory, classify=False, index=not self._whole)
        survey, accounts = self._begun
        accounts.files.check_report()
        return {"unseen": survey.unseen, **_problems(survey)}

    def _look(self) -> list[tuple[Any, ...]]:
        """Return name, size, time and inode of all files that :meth:`begin` reads."""
        files = (*sorted((self._directory / FOLDER).rglob("*")), self._directory / LEDGER, self._directory / MAP)
        found = [(path, path.stat()) for path in files if path.is_file()]
        return [(path, about.st_size, about.st_mtime_ns, about.st_ino) for path, about in found]


def _read(run_directory: Path, index: bool, progress: Progress | None = None, share: float = 1.0) -> RunSurvey:
    """Read all bags of a run; it is a problem of the survey if there is none."""
    try:
        return read_run(run_directory, IndexSurvey if index else Survey, progress, share)
    except BagError as error:
        survey = RunSurvey(Path(run_directory), {})
        survey.problem(str(error))
        return survey


def account(
    survey: RunSurvey,
    run_directory: Path,
    classify: bool,
    progress: Progress | None = None,
    again: Again | None = None,
) -> dict[str, Any]:
    """Check what was found in a bag against its plan, itself, and the files beside it; see :func:`verify`."""
    result: dict[str, Any] = {"ok": False, "directory": str(run_directory)}
    if survey.expected is not None and survey.plan:
        result |= _Accounts(survey, survey.expected).all(run_directory, progress, classify, again)
    elif survey.files:
        survey.problem("the bag holds no plan", file=FOLDER)
    return {
        **result,
        "messages": survey.messages,
        "files": [file.name for file in survey.files],
        **_problems(survey),
    }


def _problems(survey: RunSurvey) -> dict[str, Any]:
    return {"ok": not survey.problem_count, "problem_count": survey.problem_count, "problems": survey.problems}


class _Accounts:
    """Checks the contents of a bag against its plan and against each other."""

    def __init__(self, survey: RunSurvey, expected: SweepOutline) -> None:
        self.survey, self.expected, self.problem = survey, expected, survey.problem
        self.notes: list[str] = []
        states = survey.plan["block_states"].tolist()
        if len(states) != expected.blocks:
            self.problem(f"the plan gives the state of {len(states)} blocks, there are {expected.blocks}")
        self.states = (states + [0] * expected.blocks)[: expected.blocks]
        self.complete = np.zeros(expected.blocks, bool)
        self.unseen = np.array([survey.is_unseen(block) for block in range(expected.blocks)])
        self.equal = 0

    def all(
        self, run_directory: Path, progress: Progress | None, classify: bool, again: Again | None
    ) -> dict[str, Any]:
        """Check everything; return the counts."""
        expected, survey = self.expected, self.survey
        if survey.plan["state"] != PlanState.CLOSED:
            self.problem("the last plan is open: the run is not finished, or its end was cut out")
        for block in range(expected.blocks):
            self._block(block)
        self._receipts()
        proved = self._derive(progress, again) if classify else {}
        done = expected.planned.cells_of(np.flatnonzero(self.complete))
        self._rounds(done)
        sizes = np.array([expected.planned.size(block) for block in range(expected.blocks)])
        quarantined = np.array([state == BlockState.QUARANTINED for state in self.states])
        counts = {
            "run": expected.run_id,
            "sweep": expected.sweep_id,
            "cells": int(sizes[self.complete].sum()),
            "cells_planned": expected.planned.planned_cells,
            "cells_predicted": expected.cells - expected.planned.planned_cells,
            "cells_quarantined": int(sizes[quarantined].sum()),
            "cells_unseen": int(sizes[self.unseen].sum()),
            "chunks": int(self.complete.sum()) * expected.chunks,
            "chunks_planned": expected.blocks * expected.chunks,
            "chunks_recorded": int(self.complete.sum()) * len(expected.recorded_chunks),
            "samples": int(sizes[self.complete].sum()) * expected.chunks * expected.chunk_samples,
            "samples_planned": expected.planned.planned_cells * expected.chunks * expected.chunk_samples,
            "verdicts": len(survey.verdicts),
            "verdicts_equal": self.equal,
            "classifier": survey.plan["classifier"],
            "quarantined_blocks": np.flatnonzero(quarantined).tolist(),
            "unseen": survey.unseen,
            **proved,
            "notes": self.notes,
        }
        unseen = expected.planned.cells_of(np.flatnonzero(self.unseen))
        self.files = FileChecks(run_directory, survey, expected, self.states, done, unseen, counts)
        self.files.check()
        return counts

    # ---- every chunk once

    def _block(self, block: int) -> None:
        """Check that every chunk of a block is stored as far as it is to be, with verdicts on exactly its streams."""
        survey, state = self.survey, self.states[block]
        if state == BlockState.QUARANTINED or self.unseen[block]:
            return
        missing = 0
        for chunk in range(self.expected.chunks):
            key = (block, chunk)
            lacking = survey.lacking(key)
            missing += bool(lacking)
            if lacking and state == BlockState.DONE:
                self.problem("missing", block=block, chunk=chunk, topics=lacking, **survey.at(block))
            self._agree(key)
        if state != BlockState.DONE:
            self.problem(f"outstanding: {missing} of {self.expected.chunks} chunks are not complete", block=block)
        self.complete[block] = state == BlockState.DONE and not missing

    def _agree(self, key: Key) -> None:
        whole, verdict = self.survey.chunk_checksum(key), self.survey.verdicts.get(key)
        if whole is not None and verdict is not None and verdict.chunk_checksum != whole:
            what = f"the verdicts are on chunk {verdict.chunk_checksum:016x}, stored is {whole:016x}"
            self.problem(what, block=key[0], chunk=key[1])

    # ---- receipts

    def _receipts(self) -> None:
        """Check that all stored chunks and verdicts have a receipt, and that everything receipted is stored.

        Not stored are also messages that a file lists as missing.
        """
        survey = self.survey
        keys = survey.places["bridge_force"].keys() | survey.verdicts.keys()
        for key in sorted(keys):
            verdict = survey.verdicts.get(key)
            stored: dict[int, int | None] = {
                ReceiptKind.STREAMS: survey.chunk_checksum(key),
                ReceiptKind.VERDICTS: verdict and verdict.checksum,
            }
            for kind, checksum in stored.items():
                receipted = survey.receipts.get((kind, *key), set())
                if checksum is not None and receipted != {checksum}:
                    found = ", ".join(f"{c:016x}" for c in sorted(receipted)) or "nothing"
                    what = f"{_KINDS[kind]} stored as {checksum:016x}, receipted {found}"
                    self.problem(what, block=key[0], chunk=key[1])
        for kind, block, chunk in sorted(survey.receipts):
            there: dict[int, bool] = {
                ReceiptKind.STREAMS: survey.chunk_checksum((block, chunk)) is not None,
                ReceiptKind.VERDICTS: (block, chunk) in survey.verdicts,
                ReceiptKind.BLOCK: block < self.expected.blocks and (self.complete[block] or not survey.lacks(block)),
            }
            lost = bool(survey.noted) and block < self.expected.blocks and self.states[block] != BlockState.DONE
            if not (there.get(kind) or lost):
                self.problem(f"{_KINDS.get(kind, kind)} receipted, not stored", block=block, chunk=chunk)
        for block in np.flatnonzero(self.complete).tolist():
            if survey.version_of(block) >= RECEIPTS_BLOCKS and (ReceiptKind.BLOCK, block, 0) not in survey.receipts:
                self.problem("no receipt states that it is on the disk", block=block, **survey.at(block))

    # ---- verdicts

    def _derive(self, progress: Progress | None, again: Again | None) -> dict[str, Any]:
        """Derive the verdicts again and compare them; return what is said of blocks that were computed again.

        They are derived from the recorded streams where these are all recorded.
        """
        survey = self.survey
        try:
            task = task_of(survey)
        except ParameterError as error:
            self.problem(f"the plan cannot be classified: {error}")
            return {}
        if task.thresholds.hash != survey.plan["classifier"]:
            self.notes.append(
                f"classified with {survey.plan['classifier']}, here is {task.thresholds.hash}: the numbers of the "
                "verdicts are compared, their hash is not"
            )
        outline = task.outline
        recorded = len(outline.recorded_chunks) == outline.chunks
        stored = [block for block in range(outline.blocks) if recorded and self.states[block] != BlockState.QUARANTINED]
        drawn = again.draw(outline, np.flatnonzero(self.complete).tolist()) if again else []
        steps = len(stored) + len(drawn)
        equal: list[int] = []
        with Chunks() as chunks:
            for number, block in enumerate(stored + drawn, 1):
                if number <= len(stored):
                    self._classify_block(task, block, chunks)
                elif again is not None and self._compute_block(task, block, again.kernel, count=not recorded):
                    equal.append(block)
                if progress is not None:
                    progress(SCAN_SHARE * steps + (1 - SCAN_SHARE) * number, steps)
        if not recorded and not drawn:
            self.notes.append(f"the run was recorded with record={outline.record}, and nothing was computed again")
        if not drawn:
            return {}
        cells = {name: sum(map(outline.planned.size, blocks)) for name, blocks in (("cells", drawn), ("equal", equal))}
        return {"computed_again": {"blocks": drawn, **cells, "seed": again.seed if again else 0}}

    def _compute_block(self, task: Any, block: int, kernel: Kernel, count: bool) -> bool:
        """Compute a block again; return whether it is as recorded."""
        what = "it gave no chunk"
        try:
            for key, what in compare(self.survey, task, block, kernel):
                self.equal += count and not what
                if what:
                    self.problem(what, block=block, chunk=key[1])
        except ParameterError as error:
            self.problem(f"cannot be computed again: {error}", block=block)
            return False
        return not what

    def _classify_block(self, task: Any, block: int, chunks: Chunks) -> None:
        try:
            for key, again in classify_block(self.survey, task, block, chunks):
                known = self.survey.verdicts.get(key)
                if known is None:
                    continue  # reported before
                names = differing(known.layers, again)
                self.equal += not names
                if names:
                    what = f"the verdicts derived again differ in {', '.join(names)}"
                    self.problem(what, block=block, chunk=key[1])
        except (BagError, OSError) as error:
            self.problem(str(error), block=block)

    # ---- the rounds of an adaptive sweep

    def _rounds(self, done: np.ndarray) -> None:
        """Note where a round of an adaptive sweep differs from the one that the verdicts before it give here.

        Not where verdicts are not here.
        """
        expected, planned = self.expected, self.expected.planned
        if not planned.adaptive or self.unseen.any():
            return
        budget = within_budget(expected.adaptive, expected.cells)
        layers = self.survey.layers()
        length = np.where(done, transient_lengths(is_helmholtz(layers["regime"]), layers["transient"]), np.nan)
        tried = np.zeros(expected.cells, bool)
        for number, cells in enumerate([*planned.rounds, np.zeros(0, np.uint32)], 1):
            known = np.where(tried, length, np.nan).reshape(expected.shape)
            if not np.array_equal(next_round(tried.reshape(expected.shape), known, budget), cells):
                self.notes.append(f"round {number} has other cells than the verdicts before it ask for here")
                return
            tried[cells] = True


_KINDS: dict[int, str] = {
    ReceiptKind.STREAMS: "streams",
    ReceiptKind.VERDICTS: "verdicts",
    ReceiptKind.BLOCK: "the whole block",
}
