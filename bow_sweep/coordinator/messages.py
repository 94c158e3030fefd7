"""What the coordinator says, built from a run and its map: plan, basin map, image, progress, diagnostics."""

from __future__ import annotations

from array import array
from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np
from bow_msgs.action import RunSweep
from bow_msgs.msg import Health, Plan, SweepSpec
from builtin_interfaces.msg import Time
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from sensor_msgs.msg import Image

from bow_classifier.verdict.regimes import REGIMES
from bow_sim.kernel.fingerprint import fingerprint
from bow_sim.protocol import cdr
from bow_sweep.maps.basin_map import Basin
from bow_sweep.maps.plane import Snapshot, image_of
from bow_sweep.run.directory import Run
from bow_sweep.run.ledger import State

BLOCK_STATES = {State.DONE: Plan.DONE, State.QUARANTINED: Plan.QUARANTINED}
LEVELS = {
    Health.READY: DiagnosticStatus.OK,
    Health.BUSY: DiagnosticStatus.OK,
    Health.CLOSED: DiagnosticStatus.OK,
    Health.STARTING: DiagnosticStatus.WARN,
    Health.DEAD: DiagnosticStatus.STALE,
    Health.FAILED: DiagnosticStatus.ERROR,
}
STATE_NAMES = {
    getattr(Health, name): name.lower() for name in ("STARTING", "READY", "BUSY", "CLOSED", "DEAD", "FAILED")
}
NUMBERS = ("messages", "bytes", "duplicates", "ignored", "rss", "pid")


def spec_message(run: Run) -> SweepSpec:
    """Return the resolved sweep of a run."""
    return SweepSpec(preset=run.sweep.preset, settings=list(run.sweep.settings()))


def plan_message(run: Run, state: int, incarnation: str) -> Plan:
    """Return the plan of a run with the state of every block, from the coordinator of this incarnation."""
    return Plan(
        run_id=run.run_id,
        sweep_id=run.sweep.sweep_id,
        epoch=run.ledger.epoch,
        state=state,
        spec=spec_message(run),
        fingerprint=fingerprint(),
        classifier=run.sweep.thresholds.hash,
        block_states=bytes(BLOCK_STATES.get(block.state, Plan.OUTSTANDING) for block in run.ledger.blocks),
        rounds=run.blocks.announce().tobytes(),
        incarnation=incarnation,
    )


def block_message(run: Run, coordinator: str, simulator: str = "", block: int = 0, attempt: int = 0) -> bytes:
    """Return a Block: one to compute, for the simulator of an incarnation, or without one an empty one for all."""
    cells = run.blocks.block(block) if simulator else np.zeros(0, np.uint32)
    lanes = run.sweep.lanes(cells)
    values = {
        "run_id": run.run_id,
        "sweep_id": run.sweep.sweep_id,
        "coordinator": coordinator,
        "simulator": simulator,
        "epoch": run.ledger.epoch,
        "fingerprint": fingerprint(),
        "spec.preset": run.sweep.preset,
        "spec.settings": run.sweep.settings(),
        "block": block,
        "attempt": attempt,
        "cells": cells,
        "x": lanes[run.sweep.x.name],
        "y": lanes[run.sweep.y.name],
    }
    return cdr.encode("Block", values)


def map_message(run: Run, basin: Basin) -> dict[str, Any]:
    """Return the map so far, the fields of a BasinMap: NumPy writes its long arrays faster than message objects."""
    accounts = run.accounts()
    return {
        "run_id": run.run_id,
        "sweep_id": run.sweep.sweep_id,
        "x_name": run.sweep.x.name,
        "y_name": run.sweep.y.name,
        "x": run.sweep.x.values(),
        "y": run.sweep.y.values(),
        "transient_periods": basin.transient_periods,
        "tests": basin.tested,
        "regime_names": list(REGIMES),
        "cells_done": accounts["done"],
        "cells_quarantined": accounts["quarantined"],
        "cells_outstanding": accounts["outstanding"],
        **{name: basin.latest(name) for name in ("regime", "correlation", "slips", "corners")},
    }


def image_message(basin_map: Mapping[str, Any], stamp: Time) -> Image:
    """Return the transient lengths of a map as an image that RViz and its like show: 32FC1, first row on top."""
    height, width, data = image_of(Snapshot.from_message(basin_map))
    image = Image(height=height, width=width, encoding="32FC1", step=4 * width, data=array("B", data))
    image.header.stamp = stamp
    image.header.frame_id = "basin_map"
    return image


def feedback_message(run: Run, basin: Basin, cells_per_second: float) -> RunSweep.Feedback:
    """Return the progress of a sweep."""
    feedback = RunSweep.Feedback(regime_names=list(REGIMES), regime_counts=basin.regime_counts().tolist())
    for name, count in run.accounts().items():
        setattr(feedback, f"cells_{name}", count)
    feedback.cells_per_second = cells_per_second
    return feedback


def result_message(run: Run, report: Mapping[str, Any], message: str) -> RunSweep.Result:
    """Return the result of a sweep from its report."""
    return RunSweep.Result(
        run_id=run.run_id,
        sweep_id=run.sweep.sweep_id,
        **{f"cells_{name}": report["cells"][name] for name in ("planned", "done", "quarantined")},
        helmholtz_fraction=report["helmholtz_fraction"],
        wall_seconds=report["wall_seconds"],
        directory=str(run.directory),
        message=message,
    )


def diagnostics_message(nodes: Iterable[Health], stamp: Time) -> DiagnosticArray:
    """Return the health of the nodes as diagnostics."""
    array = DiagnosticArray(
        status=[
            DiagnosticStatus(
                level=LEVELS.get(health.state, DiagnosticStatus.WARN),
                name=f"bow: {health.node}",
                hardware_id=health.host,
                message=health.detail or STATE_NAMES.get(health.state, ""),
                values=[KeyValue(key=name, value=str(getattr(health, name))) for name in NUMBERS],
            )
            for health in nodes
        ]
    )
    array.header.stamp = stamp
    return array
