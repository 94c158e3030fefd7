"""`bow sweep`: a graph on this machine, from its first process to the finished run directory."""

from __future__ import annotations

import gc
import json
import os
import time
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from bow_sweep.plan.sweep import Sweep
from bow_sweep.processes.interrupts import Ending
from bow_sweep.processes.progress import Display
from bow_sweep.processes.supervisor import Supervisor
from bow_sweep.run.directory import REPORT, RunError, is_finished, read_ledger

LOGS = "log"
AT_ONCE, BETWEEN_S = 8, 0.1
"""So many simulators, or one a core, are started at once, the others so long after one another: each begins by using a
whole core."""

INSPECTED = 6
"""Cells whose waveforms the dashboard shows unless told else."""


def inspected_cells(sweep: Sweep) -> list[int]:
    """Return cells spread over the plane, for their waveforms to be shown; some that are planned at the beginning."""
    columns = np.unique(np.linspace(0, sweep.x.count - 1, INSPECTED // 2 + 2).astype(int)[1:-1])
    rows = np.unique(np.linspace(0, sweep.y.count - 1, 4).astype(int)[1:-1])
    y, x = np.divmod(np.flatnonzero(sweep.first_blocks.planned), sweep.x.count)
    nearest = [np.argmin((y - iy) ** 2 + (x - ix) ** 2) for iy in rows for ix in columns]
    return np.unique((y * sweep.x.count + x)[nearest]).tolist()


def has_finished(directory: Path) -> bool:
    """Return whether the latest coordinator of a run has written its report, which is the last that it does."""
    try:
        entries = read_ledger(directory)
        report = json.loads((directory / REPORT).read_text())
    except (RunError, OSError, ValueError):
        return False
    latest = max(entry.get("epoch", 0) for entry in entries)
    return is_finished(directory, entries) and report.get("epoch") == latest


def conduct(
    directory: Path,
    run_id: str,
    sweep: Sweep,
    *,
    resume: bool,
    simulators: int,
    dashboard: dict[str, Any] | None,
    display: Display,
    sync: bool = True,
    lock: bool = True,
) -> list[Path]:
    """Run the graph until the run in `directory` is finished; return the logs of what was left out of it.

    Parameters
    ----------
    directory
        Run directory; exists.
    resume
        Go on with the run that is there.
    simulators
        Processes in the pool.
    dashboard
        ROS parameters of the dashboard, None for none.
    sync
        A block is done only when it is on the disk.
    lock
        Lock the run directory.

    Raises
    ------
    GraphError
        Where the graph cannot go on; the run can be resumed once the cause is mended.
    KeyboardInterrupt
        After Ctrl-C or SIGTERM; everything has been stopped in order.
    """
    coordinator: dict[str, object] = {"once": True, "dashboard": dashboard is not None, "lock": lock}
    if resume:
        coordinator["resume"] = str(directory)
    else:
        spec = {"preset": sweep.preset, "settings": list(sweep.settings())}
        coordinator |= {"run_dir": str(directory), "run_id": run_id, **spec}
    parameters: dict[str, dict[str, object]] = {
        "coordinator": coordinator,
        "recorder": {"run_dir": str(directory), "sync": sync, "lock": lock},
        "dashboard": {"run_dir": str(directory), **(dashboard or {})},
        "simulator": {"inspect": inspected_cells(sweep)},
    }
    supervisor = Supervisor(f"/bow/{run_id}", directory / LOGS, parameters, partial(has_finished, directory))
    finished = False
    gc.disable()  # nothing that the start loads becomes garbage
    with Ending("stopping the processes; a few seconds") as ending:
        try:
            for role in ("coordinator", "recorder"):
                supervisor.start(role)
            with ending.at_once():
                _load_compiled(sweep)
            supervisor.start("classifier")
            for number in range(simulators):
                if number >= max(AT_ONCE, len(os.sched_getaffinity(0))):
                    time.sleep(BETWEEN_S)
                    ending.check()
                supervisor.start("simulator")
            if dashboard is not None:  # last, as nobody waits for it
                supervisor.start("dashboard")
            from bow_sweep.processes.supervisor_node import (
                watch,  # it loads ROS: a process with DDS should not be copied
            )

            gc.enable()
            watch(supervisor, display, ending)
            finished = True
        finally:
            killed = supervisor.stop(idle=finished)
            gc.enable()
            if killed:
                display.say(f"had to kill {', '.join(child.name for child in killed)}: no answer to SIGINT")
    return supervisor.left_out


def _load_compiled(sweep: Sweep) -> None:
    """Load the kernel and the tests, or compile them where they never were: processes copied from here have them."""
    from bow_classifier.precompile import warm
    from bow_sim.kernel.block import Block

    Block(sweep.parameters, sweep.lanes(sweep.block(0))).advance()
    warm()
