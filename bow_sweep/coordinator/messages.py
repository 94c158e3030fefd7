"""What the coordinator publishes about a run: plan, block, map, progress and result. No ROS."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from bow_classifier.verdict.regimes import REGIMES
from bow_sim.protocol import cdr
from bow_sim.protocol.states import BlockState, PlanState
from bow_sim.protocol.sweep_spec import values_of
from bow_sweep.maps.basin_map import Basin
from bow_sweep.run.directory import Run
from bow_sweep.run.ledger import State

BLOCK_STATES = {State.DONE: BlockState.DONE, State.QUARANTINED: BlockState.QUARANTINED}

SHOWN = ("regime", "correlation", "slips", "corners")
"""The fields of verdicts that are in a BasinMap."""


def _identity(run: Run) -> dict[str, Any]:
    """Return the fields that plan and block have in common."""
    return {
        "run_id": run.run_id,
        "sweep_id": run.sweep.sweep_id,
        "epoch": run.ledger.announced,
        "spec.preset": run.sweep.preset,
        "spec.settings": run.sweep.settings(),
        "fingerprint": run.sweep.fingerprint,
    }


def plan_message(run: Run, state: PlanState, coordinator: str) -> bytes:
    """Return the Plan of a run with the state of every block; `coordinator` is an incarnation."""
    states = np.zeros(run.blocks.count, np.uint8)  # OUTSTANDING; the ledger does not have the blocks of a new round yet
    states[: len(run.ledger.blocks)] = [BLOCK_STATES.get(block.state, 0) for block in run.ledger.blocks]
    values = {
        "state": state,
        "classifier": run.sweep.thresholds.hash,
        "block_states": states,
        "rounds": run.blocks.announce(),
        "incarnation": coordinator,
    }
    return cdr.encode("Plan", {**_identity(run), **values})


def block_message(run: Run, coordinator: str, simulator: str = "", block: int = 0, attempt: int = 0) -> bytes:
    """Return a Block for the simulator of an incarnation to compute; without `simulator` a hello for all of them."""
    epoch = run.ledger.epoch_of(block) if simulator else run.ledger.announced
    return _block(run, coordinator, simulator, epoch, block, attempt)


def epoch_message(run: Run, coordinator: str, simulator: str, epoch: int) -> bytes:
    """Return a Block without cells: it only tells the simulator of an incarnation that older epochs are over."""
    return _block(run, coordinator, simulator, epoch)


def _block(run: Run, coordinator: str, simulator: str, epoch: int, block: int | None = None, attempt: int = 0) -> bytes:
    cells = run.blocks.block(block) if simulator and block is not None else np.zeros(0, np.uint32)
    at = run.sweep.axis_values(cells)
    values = {
        "epoch": epoch,
        "coordinator": coordinator,
        "simulator": simulator,
        "block": block or 0,
        "attempt": attempt,
        "cells": cells,
        "x": at[run.sweep.x.name],
        "y": at[run.sweep.y.name],
    }
    return cdr.encode("Block", {**_identity(run), **values})


def receipt_entries(receipt: Mapping[str, Any]) -> list[tuple[int, int, int, int]] | None:
    """Return kind, block, chunk and checksum of each entry of a decoded Receipt; None where its arrays do not fit."""
    columns = [receipt[name].tolist() for name in ("kind", "block", "chunk", "checksum")]
    return list(zip(*columns, strict=True)) if len({len(column) for column in columns}) == 1 else None


def map_values(run: Run, basin: Basin) -> dict[str, Any]:
    """Return the fields of a BasinMap: the map so far.

    :func:`bow_sim.protocol.cdr.encode` writes its long arrays faster than a message object of rclpy does.
    """
    accounts = run.accounts()
    return {
        "run_id": run.run_id,
        "sweep_id": run.sweep.sweep_id,
        "x_name": run.sweep.x.name,
        "y_name": run.sweep.y.name,
        "x": values_of(run.sweep.x),
        "y": values_of(run.sweep.y),
        "transient_periods": basin.of_plane(basin.transient_periods).ravel(),
        "tests": basin.of_plane(basin.tested).ravel(),
        "regime_names": list(REGIMES),
        "cells_done": accounts["done"],
        "cells_quarantined": accounts["quarantined"],
        "cells_outstanding": accounts["outstanding"],
        **{name: basin.of_plane(latest).ravel() for name, latest in basin.latest_of(SHOWN).items()},
    }


def feedback_values(run: Run, basin: Basin, cells_per_second: float) -> dict[str, Any]:
    """Return the fields of RunSweep.Feedback: the progress of a sweep."""
    return {
        **{f"cells_{name}": count for name, count in run.accounts().items()},
        "cells_per_second": cells_per_second,
        "regime_names": list(REGIMES),
        "regime_counts": basin.regime_counts().tolist(),
    }


def result_values(run: Run, report: Mapping[str, Any]) -> dict[str, Any]:
    """Return the fields of RunSweep.Result: the result of a sweep, from its report."""
    cells = report["cells"]
    return {
        "run_id": run.run_id,
        "sweep_id": run.sweep.sweep_id,
        **{f"cells_{name}": cells[name] for name in ("planned", "done", "quarantined")},
        "helmholtz_fraction": report["helmholtz_fraction"],
        "wall_seconds": report["wall_seconds"],
        "directory": str(run.directory),
        "message": f"{cells['done']} of {cells['planned']} cells done, {cells['quarantined']} quarantined",
    }
