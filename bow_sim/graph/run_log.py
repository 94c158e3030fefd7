"""What a node says of a run in its log, at INFO: that it opens, each tenth of its work, that it closes. No ROS."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from bow_sim.protocol.states import BlockState, PlanState
from bow_sim.protocol.sweep_outline import SweepOutline

STEPS = 10
"""A line of progress each tenth of the run."""


class RunLog:
    """Turns plans into lines for the log; each line is said once for each run.

    Parameters
    ----------
    says_ends
        Whether it says that a run opens and closes; a node that says so itself, with more in it, does not need that.

    Attributes
    ----------
    run
        run_id of the run that was opened and not closed; "" for none.
    """

    def __init__(self, says_ends: bool = True) -> None:
        self.run = ""
        self._closed = ""  # the last run that it said to be closed
        self._says_ends = says_ends
        self._outline: SweepOutline | None = None
        self._step = 0

    def take(self, plan: Mapping[str, Any], note: Callable[[], str] = str) -> list[str]:
        """Return the lines that a plan gives rise to: none, one, or two where a run opens that has begun, or is over.

        Parameters
        ----------
        plan
            Fields of the Plan of the run that the node has taken up.
        note
            Returns what the node itself has to add, "" for nothing.
        """
        run, lines = plan["run_id"], []
        is_open = plan["state"] == PlanState.OPEN
        if not run:  # no name of a run; the node reports it
            return []
        if run != self.run:
            if not is_open and run == self._closed:
                return []
            try:
                self._outline = SweepOutline.of(plan)
            except ValueError:  # the plan is of no sweep; the node reports it
                return []
            self.run, self._step = run, 0
            if self._says_ends:
                lines.append(f"run {run} opens: {describe(self._outline)}")
        settled = int(np.count_nonzero(plan["block_states"] != BlockState.OUTSTANDING))
        added = f"; {said}" if (said := note()) else ""
        if not is_open:
            self.run, self._closed = "", run
            if self._says_ends:
                lines.append(f"run {run} closes: {settled} of {len(plan['block_states'])} blocks done{added}")
            return lines
        step = int(STEPS * self._share(plan, settled))
        if step > self._step:
            self._step = step
            lines.append(f"run {run}: {100 // STEPS * step} %, {settled} blocks done{added}")
        return lines

    def leave(self, note: Callable[[], str] = str) -> list[str]:
        """Return the line of a node that ends while a run is open, or before it hears that the run has closed."""
        run, self.run = self.run, ""
        if not run or not self._says_ends:
            return []
        return [f"run {run} closes: the node was told to stop{f'; {said}' if (said := note()) else ''}"]

    def _share(self, plan: Mapping[str, Any], settled: int) -> float:
        """Return how much is done, 0 ... 1: of all cells, or of those that an adaptive sweep may simulate."""
        assert self._outline is not None
        blocks, rounds = len(plan["block_states"]), plan["rounds"]
        if not len(rounds):
            return settled / max(blocks, 1)
        planned = np.count_nonzero(rounds) / max(self._outline.adaptive * self._outline.cells, 1)
        return min(settled / max(blocks, 1) * planned, 1.0)


def describe(outline: SweepOutline) -> str:
    """Return a sweep in a few words: its preset, its plane and its length."""
    plane = f"{outline.x.count} x {outline.y.count} cells of {outline.x.name} x {outline.y.name}"
    share = f", at most {outline.adaptive:.0%} of them" if outline.adaptive < 1 else ""
    repeats = f", repeated {outline.repeats.count} times" if outline.repeats.count else ""
    return f"{outline.preset or 'no preset'}, {plane}{share}{repeats}, {outline.parameters.periods} periods each"
