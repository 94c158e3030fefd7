"""The graph of `bow sweep` on this machine, from its first process to the finished run directory."""

from __future__ import annotations

import gc
import json
from functools import partial
from pathlib import Path
from typing import Protocol

from bow_sim.protocol.inspected import spread_cells
from bow_sim.protocol.stations import numbered
from bow_sweep.plan.sweep import Sweep
from bow_sweep.processes.interrupts import Interrupts
from bow_sweep.processes.progress import Display
from bow_sweep.processes.start_nodes import start_nodes
from bow_sweep.processes.supervisor import Supervisor
from bow_sweep.run.directory import REPORT, RunError, is_finished, read_ledger
from bow_sweep.view.viewer import Screen

LOGS = "log"


class Check(Protocol):
    """The check of a finished run."""

    def begin(self) -> bool:
        """Check what is complete when the bag is closed; return False if that has to be asked again."""

    def end(self) -> str:
        """Check the rest when all files are complete; return what does not agree, "" where all of it does."""


def inspected_cells(sweep: Sweep) -> list[int]:
    """Return cells whose waveforms are shown: spread over the plane, from the blocks of the first round."""
    return spread_cells(sweep.x.count, sweep.y.count, sweep.first_blocks.planned)


def has_finished(directory: Path) -> bool:
    """Return whether the latest coordinator of a run has written its report, the last thing that it does."""
    try:
        entries = read_ledger(directory)
        report = json.loads((directory / REPORT).read_text())
    except (RunError, OSError, ValueError):
        return False
    latest = max(entry.get("epoch", 0) for entry in entries)
    return is_finished(directory, entries) and report.get("epoch") == latest


def run_graph(
    directory: Path,
    run_id: str,
    sweep: Sweep,
    *,
    resume: bool,
    simulators: int,
    dashboard: bool,
    display: Display,
    screen: Screen | None = None,
    sync: bool = True,
    lock: bool = True,
    stations: int = 1,
    check: Check,
) -> tuple[list[Path], str]:
    """Run a graph until the run in `directory` is finished.

    Parameters
    ----------
    directory
        Run directory; exists.
    run_id, sweep
        The run.
    resume
        Resume the run that is in the directory.
    simulators
        Number of simulator processes.
    dashboard
        Whether there is a dashboard.
    display
        Shows the progress.
    screen
        Where the dashboard is seen live.
    sync
        A block is done only when it is on the disk.
    lock
        Lock the run directory.
    stations
        Number of stations among which the simulators are divided, see :mod:`bow_sim.protocol.stations`.
    check
        It begins while the last files are written, and ends when all are complete, while the processes end.

    Returns
    -------
    tuple
        Logs of the processes that the sweep went on without, and what `check` has found.

    Raises
    ------
    GraphError
        Where the graph cannot go on; the run can be resumed when the cause is removed.
    KeyboardInterrupt
        After Ctrl-C or SIGTERM; all processes have been stopped in order.
    """
    common: dict[str, object] = {"once": True, "dashboard": dashboard, "lock": lock}
    again = {**common, "resume": str(directory)}
    spec = {"preset": sweep.preset, "settings": list(sweep.settings())}
    coordinator = again if resume else {**common, "run_dir": str(directory), "run_id": run_id, **spec}
    parameters: dict[str, dict[str, object]] = {
        "coordinator": coordinator,
        "recorder": {"run_dir": str(directory), "sync": sync, "lock": lock},
        "dashboard": {"run_dir": str(directory), "inspect": inspected_cells(sweep)},
        "simulator": {"inspect": inspected_cells(sweep)},
    }
    if screen is not None and screen.uri:
        parameters["dashboard"]["connect"] = screen.uri
    supervisor = Supervisor(f"/bow/{run_id}", directory / LOGS, parameters, partial(has_finished, directory), screen)
    supervisor.again = again
    finished = False
    gc.disable()  # no garbage arises while modules are imported
    with Interrupts("stopping the processes; a few seconds") as interrupts:
        try:
            start_nodes(supervisor, sweep, simulators, numbered(stations), dashboard, interrupts)
            from bow_sweep.processes.supervisor_node import watch  # start_nodes has loaded ROS

            gc.enable()
            watch(supervisor, display, interrupts, check.begin)
            finished = True
            with interrupts.immediate():
                problem = check.end()
        finally:
            killed = supervisor.stop(idle=finished)
            gc.enable()
            if killed:
                display.print_line(f"had to kill {', '.join(child.label for child in killed)}: no answer to SIGINT")
    return supervisor.left_out, problem
