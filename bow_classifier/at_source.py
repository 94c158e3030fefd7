"""Judging in the process that computes: the streams of a sweep that records none are neither sent nor kept.

The verdicts have the same bytes as those of the classifier node, but for who judged.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from bow_classifier.features.slips import Intervals
from bow_classifier.task import Task
from bow_sim.block_request import Judge
from bow_sim.kernel.block import ChunkResult
from bow_sim.physics.errors import ParameterError
from bow_sim.protocol import cdr
from bow_sim.protocol.cdr_in_place import Template
from bow_sim.protocol.sweep_outline import SweepOutline

COMMON = ("run_id", "sweep_id", "block", "attempt", "incarnation", "cells")
"""Fields that the verdicts on a block have in common with each other and with its streams."""


class Judges:
    """Makes what judges a block, for :class:`bow_sim.node.SimulatorNode`."""

    def __init__(self) -> None:
        self._task: Task | None = None

    def of_block(self, plan: Mapping[str, Any], cells: Sequence[int]) -> Judge:
        """Return what judges the chunks of a block of the sweep that a decoded Plan describes, by the cells' indices.

        Raises
        ------
        ParameterError
            Where the sweep cannot be judged here.
        """
        task = self._task_of(plan)
        classifier = task.block_classifier(np.asarray(cells))
        template: Template | None = None

        def judge(about: Mapping[str, Any], chunk: ChunkResult) -> cdr.Buffer:
            nonlocal template
            intervals = Intervals(*(getattr(chunk, name) for name in Intervals._fields))
            verdicts = classifier.classify(chunk.bridge_force, intervals)
            if template is None:
                common = {name: about[name] for name in COMMON}
                template = Template("Verdicts", {**common, "classifier": task.thresholds.hash})
            return template.write(about, verdicts)[0]

        return judge

    def _task_of(self, plan: Mapping[str, Any]) -> Task:
        """Return the task of a run; later plans of a run have the same one, but for its rounds, which are not used."""
        task, wanted = self._task, (plan["run_id"], plan["sweep_id"], plan["classifier"])
        if task is None or (task.outline.run_id, task.outline.sweep_id, task.outline.classifier) != wanted:
            task = Task.of(SweepOutline.of(plan))
            if task.objection:
                raise ParameterError(task.objection)
            self._task = task
        return task
