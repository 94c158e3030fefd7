"""`bow sweep`: a graph on this machine, from its first process to the finished run directory."""

from __future__ import annotations

import gc
from pathlib import Path
from typing import Any

import numpy as np

from .display import Display
from .ending import Ending
from .plan import Sweep
from .supervisor import Supervisor

LOGS = "log"
INSPECTED = 6
"""Cells whose waveforms the dashboard shows unless told else."""


def inspected_cells(sweep: Sweep) -> list[int]:
    """Return cells spread over the plane, for their waveforms to be shown; some that are planned at the beginning."""
    columns = np.unique(np.linspace(0, sweep.x.count - 1, INSPECTED // 2 + 2).astype(int)[1:-1])
    rows = np.unique(np.linspace(0, sweep.y.count - 1, 4).astype(int)[1:-1])
    y, x = np.divmod(np.flatnonzero(sweep.first_blocks.planned), sweep.x.count)
    nearest = [np.argmin((y - iy) ** 2 + (x - ix) ** 2) for iy in rows for ix in columns]
    return np.unique((y * sweep.x.count + x)[nearest]).tolist()


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
) -> None:
    """Run the graph until the run in `directory` is finished.

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
    supervisor = Supervisor(f"/bow/{run_id}", directory / LOGS, parameters)
    finished = False
    gc.disable()  # nothing that the start loads becomes garbage
    with Ending("stopping the processes; a few seconds") as ending:
        try:
            for role in ("coordinator", "recorder"):
                supervisor.start(role)
            with ending.at_once():
                _load_compiled(sweep)
            for role in ["classifier"] + ["simulator"] * simulators:
                supervisor.start(role)
            if dashboard is not None:  # last, as nobody waits for it
                supervisor.start("dashboard")
            from .watch import watch  # it loads ROS: a process with DDS should not be copied

            gc.enable()
            watch(supervisor, display, ending)
            finished = True
        finally:
            killed = supervisor.stop(idle=finished)
            if killed:
                display.say(f"had to kill {', '.join(child.name for child in killed)}: no answer to SIGINT")


def _load_compiled(sweep: Sweep) -> None:
    """Load the kernel and the tests, or compile them where they never were: processes copied from here have them."""
    from bow_classifier.warm import warm
    from bow_sim.kernel import Block

    Block(sweep.parameters, sweep.lanes(sweep.block(0))).advance()
    warm()
