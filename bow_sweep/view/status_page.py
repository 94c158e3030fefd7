"""The status of a sweep as Markdown: cells done, regimes found, nodes at work. No rerun."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from bow_sim.physics.parameters import CHUNK_PERIODS
from bow_sim.protocol.states import NODE_STATE_NAMES, BlockState
from bow_sim.protocol.sweep_outline import SweepOutline
from bow_sweep.maps.held_fixed import held_fixed, subject
from bow_sweep.maps.limit_lines import limit_lines
from bow_sweep.maps.plane import Snapshot, regime_label
from bow_sweep.maps.playability import MEASURES

USUAL_STATES = ("starting", "ready", "busy", "closed")

LETTERS = 58
"""Letters in a line of a formula: lines of code are not wrapped."""

SILENT_S = 5.0
"""A node is called silent after this time without a Health message; it should send one every second."""


@dataclass(frozen=True)
class NodeStatus:
    """The latest Health message of a node.

    Attributes
    ----------
    heard
        When it came, seconds of any clock.
    """

    name: str
    role: str
    state: int
    detail: str
    messages: int
    bytes: int
    ignored: int
    rss: int
    heard: float


def with_block_states(snapshot: Snapshot, outline: SweepOutline, block_states: Sequence[int] | np.ndarray) -> Snapshot:
    """Return the map with the numbers of cells that the block states of a plan give: they are newer than its own.

    The map keeps its own numbers where there are not as many states as blocks.
    """
    states = np.asarray(block_states)
    if len(states) != outline.blocks:
        return snapshot
    sizes = np.array([outline.planned.size(block) for block in range(outline.blocks)])
    done, quarantined = (int(sizes[states == state].sum()) for state in (BlockState.DONE, BlockState.QUARANTINED))
    outstanding = outline.planned.planned_cells - done - quarantined
    return replace(snapshot, done=done, quarantined=quarantined, outstanding=outstanding)


def is_complete(snapshot: Snapshot) -> bool:
    """Return whether the map has every test of all cells that are done, so that no newer map will come."""
    tests = int(snapshot.periods / CHUNK_PERIODS)
    return int((snapshot.tests >= tests).sum()) >= snapshot.done


def page(snapshot: Snapshot, nodes: Iterable[NodeStatus], now: float, state: str, rate: float) -> str:
    """Return the status page as Markdown.

    Parameters
    ----------
    nodes
        All nodes that have sent a Health message.
    now
        Time on the clock of `NodeStatus.heard`.
    state
        State of the sweep, such as "in progress".
    rate
        Cells done per second.
    """
    parts = [
        f"## {subject(snapshot)}",
        f"{state} · preset {snapshot.preset}" if snapshot.preset else state,
        "",
        *_cells(snapshot, rate),
    ]
    parts += [
        "",
        *_regimes(snapshot),
        "",
        *_held(snapshot),
        "",
        *_limits(snapshot),
        "",
        *_nodes(nodes, now),
        "",
        *_identity(snapshot),
    ]
    return "\n".join(parts) + "\n"


def playability_page(measured: Mapping[str, Any]) -> str:
    """Return the measures of playability and their errors as Markdown.

    Parameters
    ----------
    measured
        Result of :func:`bow_sweep.maps.playability.playability`.
    """
    rows = []
    for measure in MEASURES:
        value, error = measured[measure.name]["value"], measured[measure.name]["error"]
        scale, unit = (100, " %") if measure.unit == "%" else (1, f" {measure.unit}")
        shown = "" if value is None else f"{scale * value:.3g}{unit}".rstrip()
        rows.append((measure.title, shown, "" if error is None else f"{scale * error:.2g}"))
    head = f"Of {measured['cells']} cells; what each measure means is in docs/terrain.md."
    return "\n".join(["## Playability", head, "", *_table(("", "", "±"), rows)]) + "\n"


def _limits(snapshot: Snapshot) -> list[str]:
    """Return formulas and inputs of the limits over the map."""
    return [f"    {line}" for line in limit_lines(snapshot, LETTERS)]  # as code: stars and underscores stay


def _held(snapshot: Snapshot) -> list[str]:
    """Return what is the same in all cells."""
    rows = [
        (held.symbol(), held.text, held.unit + f" ({held.beside})" * bool(held.beside)) for held in held_fixed(snapshot)
    ]
    return _table(("held fixed", "", "unit"), rows, numbers_from=3) if rows else []


def _table(head: Sequence[str], rows: Iterable[Sequence[object]], numbers_from: int = 1) -> list[str]:
    rule = ["---" if column < numbers_from else "--:" for column in range(len(head))]
    lines = [" | ".join(head), " | ".join(rule)]
    lines += [" | ".join(_cell(item) for item in row) for row in rows]
    return [f"| {line} |" for line in lines]


def _cell(item: object) -> str:
    return str(item).replace("|", "/").replace("\n", " ")


def _cells(snapshot: Snapshot, rate: float) -> list[str]:
    row = (snapshot.planned, snapshot.done, snapshot.quarantined, snapshot.outstanding, f"{rate:.0f}")
    return _table(("planned", "done", "quarantined", "outstanding", "cells/s"), [row], numbers_from=0)


def _regimes(snapshot: Snapshot) -> list[str]:
    judged = int((snapshot.tests > 0).sum())
    found = snapshot.transient_periods[np.nan_to_num(snapshot.transient_periods) > 0]
    names = [*map(regime_label, snapshot.regime_names), "pending"]
    counts = snapshot.regime_counts()
    rows = [
        (name, int(count), f"{count / snapshot.regime.size:.1%}") for name, count in zip(names, counts, strict=True)
    ]
    text = f"Helmholtz motion came in {found.size} of {judged} cells"
    if found.size:
        text += f", after {np.median(found):g} periods in the median"
    return [text + ".", "", *_table(("regime", "cells", "share"), rows)]


def _nodes(nodes: Iterable[NodeStatus], now: float) -> list[str]:
    rows = []
    for node in sorted(nodes, key=lambda node: (node.role, node.name)):
        state = NODE_STATE_NAMES.get(node.state, str(node.state))
        silent = now - node.heard
        if silent > SILENT_S and state not in ("closed", "dead", "failed"):
            state = f"silent for {silent:.0f} s"
        counts = (node.messages, f"{node.bytes / 1e6:.1f}", node.ignored, f"{node.rss / 1e6:.0f}")
        shown = state if state in USUAL_STATES else f"**{state}**"
        rows.append((node.name.rpartition("/")[2], shown, node.detail, *counts))
    head = ("node", "state", "", "messages", "MB", "ignored", "memory MB")
    return _table(head, rows, numbers_from=3) if rows else ["No node has been heard of."]


def _identity(snapshot: Snapshot) -> list[str]:
    lines = [f"run `{snapshot.run_id}` · sweep `{snapshot.sweep_id}`", ""]
    if snapshot.settings:
        lines += ["```", *snapshot.settings, "```"]
    return lines
