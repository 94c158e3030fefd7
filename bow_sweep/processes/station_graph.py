"""The processes of `bow station` on this machine: simulators, a recorder and a classifier that join a graph."""

from __future__ import annotations

import gc
from pathlib import Path

from bow_sim.protocol.inspected import SPREAD
from bow_sweep.processes.interrupts import Interrupts
from bow_sweep.processes.progress import Display
from bow_sweep.processes.run_graph import LOGS
from bow_sweep.processes.start_nodes import load_ros, start_simulators
from bow_sweep.processes.supervisor import Supervisor


def run_station(
    directory: Path,
    run_id: str,
    station: str,
    *,
    simulators: int,
    display: Display,
    sync: bool = True,
    lock: bool = True,
    root: Path | None = None,
    was_closed: bool = False,
) -> None:
    """Be a station of a run until that closes, or of a standing graph until that ends.

    Parameters
    ----------
    directory
        Directory for logs and, of a run, for what the station records, in ``bag/STATION``; exists.
    run_id, station
        The run or the graph, by the last part of its namespace, and the name of the station.
    simulators
        Number of simulator processes.
    display
        Shows the progress.
    sync
        A block is done only when it is on the disk.
    lock
        Lock the bag.
    root
        Of a standing graph, the directory in which each run has one, named by it, with ``bag/STATION``; None for a run.
    was_closed
        The bag that is there says that the run was closed: without a coordinator the run is over.

    Raises
    ------
    GraphError
        Where the station cannot go on, or does not hear the run's coordinator.
    KeyboardInterrupt
        After Ctrl-C or SIGTERM; all processes have been stopped in order.
    """
    parameters: dict[str, dict[str, object]] = {
        "recorder": {"sync": sync, "lock": lock},
        "simulator": {"inspect": [SPREAD]},
    }
    parameters["recorder"] |= {"runs_dir": str(root)} if root else {"run_dir": str(directory)}
    supervisor = Supervisor(f"/bow/{run_id}", directory / LOGS, parameters)
    gc.disable()  # no garbage arises while modules are imported
    with Interrupts("leaving the run; a few seconds") as interrupts:
        try:
            with interrupts.immediate():
                load_ros("recorder")
            supervisor.start("recorder", station)
            with interrupts.immediate():
                from bow_classifier.precompile import precompile

                precompile()  # the processes that are forked later have it
                load_ros("classifier", "simulator")
            supervisor.start("classifier", station)
            start_simulators(supervisor, simulators, [station], interrupts)
            from bow_sweep.processes.station_watch import watch_station  # load_ros has loaded ROS

            gc.enable()
            watch_station(supervisor, station, display, interrupts, stays=root is not None, was_closed=was_closed)
        finally:
            # All at once: what is under way is computed again by others, and the recorder needs its time.
            killed = supervisor.stop(idle=True)
            gc.enable()
            if killed:
                display.print_line(f"had to kill {', '.join(child.label for child in killed)}: no answer to SIGINT")
