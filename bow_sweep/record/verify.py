"""Accounts for a run: every cell, chunk, sample and checksum of its bag, and its verdicts derived again.

The recorded streams are the ground: verdicts, receipts, plan, map and ledger are held against them.
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
from bow_sweep.plan.adaptive import next_round, within_budget
from bow_sweep.record.bag import FOLDER, BagError, bag_of
from bow_sweep.record.bag_contents import Chunks, Key, Progress, Survey
from bow_sweep.record.index_contents import IndexSurvey
from bow_sweep.record.replay import differing, rejudge, task_of
from bow_sweep.record.verify_files import Beside, transient_lengths

RECEIPTS_BLOCKS = 2
"""Version of the record from which on a block is receipted as a whole."""

SCAN_SHARE = 0.4
"""Part of the work that is reading the bag; judging is the rest."""


def verify(
    run_directory: Path, progress: Progress | None = None, judge: bool = True, index: bool = False
) -> dict[str, Any]:
    """Account for everything in a run's bag.

    Parameters
    ----------
    run_directory
        Of the run; or a bag alone, and then there is no map or ledger to hold against it.
    progress
        Called with (done, total).
    judge
        Derive the verdicts again.
    index
        Find the messages by the index of the files and believe the checksums that they carry, instead of reading all.

    Returns
    -------
    dict
        For JSON. ``ok``: everything holds. ``cells``, ``chunks``, ``samples``: complete and accounted for, each once;
        ``*_planned`` what they should be together with ``cells_quarantined``. ``verdicts_equal``: of the ``chunks``,
        how many verdicts were derived again byte for byte. ``quarantined_blocks`` are named, and are no problem here:
        the sweep said so. ``problems``: dicts with ``what``, ``run`` and where: ``block``, ``chunk``, ``file`` ...
    """
    began = time.monotonic()
    try:
        survey = (IndexSurvey if index else Survey)(bag_of(run_directory))
    except BagError as error:
        survey = Survey(Path(run_directory))
        survey.problem(str(error))
    else:
        survey.read(progress, SCAN_SHARE if judge else 1.0)
    return {**account(survey, Path(run_directory), judge, progress), "seconds": round(time.monotonic() - began, 2)}


def account(survey: Survey, run_directory: Path, judge: bool, progress: Progress | None = None) -> dict[str, Any]:
    """Hold what was found in a bag against its plan, itself, and what lies beside it; see :func:`verify`."""
    result: dict[str, Any] = {"ok": False, "directory": str(run_directory)}
    if survey.expected is not None and survey.plan:
        result |= _Accounts(survey, survey.expected).all(run_directory, progress, judge)
    elif survey.files:
        survey.problem("the bag holds no plan", file=FOLDER)
    return {
        **result,
        "ok": not survey.problem_count,
        "messages": survey.messages,
        "files": [file.name for file in survey.files],
        "problem_count": survey.problem_count,
        "problems": survey.problems,
    }


class _Accounts:
    """Holds what a survey found against the plan and against itself."""

    def __init__(self, survey: Survey, expected: SweepOutline) -> None:
        self.survey, self.expected, self.problem = survey, expected, survey.problem
        self.notes: list[str] = []
        states = survey.plan["block_states"].tolist()
        if len(states) != expected.blocks:
            self.problem(f"the plan gives the state of {len(states)} blocks, there are {expected.blocks}")
        self.states = (states + [0] * expected.blocks)[: expected.blocks]
        self.complete = np.zeros(expected.blocks, bool)
        self.equal = 0

    def all(self, run_directory: Path, progress: Progress | None, judge: bool) -> dict[str, Any]:
        """Check everything; return the counts."""
        expected, survey = self.expected, self.survey
        if survey.plan["state"] != PlanState.CLOSED:
            self.problem("the last plan is open: the run is not finished, or its end was cut out")
        for block in range(expected.blocks):
            self._block(block)
        self._receipts()
        if judge:
            self._judge(progress)
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
            "chunks": int(self.complete.sum()) * expected.chunks,
            "chunks_planned": expected.blocks * expected.chunks,
            "samples": int(sizes[self.complete].sum()) * expected.chunks * expected.chunk_samples,
            "samples_planned": expected.planned.planned_cells * expected.chunks * expected.chunk_samples,
            "verdicts": len(survey.verdicts),
            "verdicts_equal": self.equal,
            "classifier": survey.plan["classifier"],
            "quarantined_blocks": np.flatnonzero(quarantined).tolist(),
            "notes": self.notes,
        }
        Beside(run_directory, survey, expected, self.states, done, counts).check()
        return counts

    # ---- every chunk once

    def _block(self, block: int) -> None:
        """Every chunk of a block is there, with its verdicts on the very bytes that are stored."""
        survey, state = self.survey, self.states[block]
        if state == BlockState.QUARANTINED:
            return
        missing = 0
        for chunk in range(self.expected.chunks):
            key = (block, chunk)
            stored: dict[str, Any] = {**survey.places, "verdicts": survey.verdicts}
            lacking = [topic for topic, places in stored.items() if key not in places]
            missing += bool(lacking)
            if lacking and state == BlockState.DONE:
                self.problem("missing", block=block, chunk=chunk, topics=lacking)
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
        """What is stored was receipted, with its checksum; nothing else was, but for what is noted as missing."""
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
                    said = ", ".join(f"{c:016x}" for c in sorted(receipted)) or "nothing"
                    what = f"{_KINDS[kind]} stored as {checksum:016x}, receipted {said}"
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
        if survey.version >= RECEIPTS_BLOCKS:
            for block in np.flatnonzero(self.complete).tolist():
                if (ReceiptKind.BLOCK, block, 0) not in survey.receipts:
                    self.problem("nothing says that it came to the disk", block=block)

    # ---- the verdicts again

    def _judge(self, progress: Progress | None) -> None:
        """Derive the verdicts of all complete and begun blocks again from the recorded streams."""
        survey = self.survey
        try:
            task = task_of(survey)
        except ParameterError as error:
            self.problem(f"the plan cannot be judged: {error}")
            return
        if task.thresholds.hash != survey.plan["classifier"]:
            self.notes.append(
                f"judged by classifier {survey.plan['classifier']}, here is {task.thresholds.hash}: the numbers of the "
                "verdicts are compared, their hash is not"
            )
        with Chunks() as chunks:
            for block in range(task.outline.blocks):
                if self.states[block] != BlockState.QUARANTINED:
                    self._judge_block(task, block, chunks)
                if progress is not None:
                    progress(SCAN_SHARE * task.outline.blocks + (1 - SCAN_SHARE) * (block + 1), task.outline.blocks)

    def _judge_block(self, task: Any, block: int, chunks: Chunks) -> None:
        try:
            for key, again in rejudge(self.survey, task, block, chunks):
                known = self.survey.verdicts.get(key)
                if known is None:
                    continue  # said before
                names = differing(known.layers, again)
                self.equal += not names
                if names:
                    what = f"the verdicts derived again differ in {', '.join(names)}"
                    self.problem(what, block=block, chunk=key[1])
        except (BagError, OSError) as error:
            self.problem(str(error), block=block)

    # ---- the rounds of an adaptive sweep

    def _rounds(self, done: np.ndarray) -> None:
        """Note where the rounds of an adaptive sweep are not what the verdicts before them ask for, here and now."""
        expected, planned = self.expected, self.expected.planned
        if not planned.adaptive:
            return
        budget = within_budget(expected.adaptive, expected.cells)
        length = np.where(done, transient_lengths(is_helmholtz(self.survey.layers()["regime"])), np.nan)
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
