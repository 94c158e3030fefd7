"""The process that keeps a standing graph: it starts the nodes, watches them, and stops them."""

from __future__ import annotations

import gc
import importlib.metadata
import json
import os
import select
import sys
import time
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import setproctitle

from bow_sim.graph import environment
from bow_sim.graph.leaving import run_command
from bow_sim.graph.process_stat import start_of
from bow_sim.protocol.identity import random_id
from bow_sim.protocol.inspected import SPREAD
from bow_sim.protocol.stations import numbered
from bow_sweep.plan.sweep import Sweep
from bow_sweep.processes.exit_status import DONE, FAILED
from bow_sweep.processes.interrupts import Interrupts
from bow_sweep.processes.start_nodes import start_nodes
from bow_sweep.processes.supervisor import GraphError, Supervisor
from bow_sweep.run.errors import RunError
from bow_sweep.run.lock import take
from bow_sweep.run.places import remove_places
from bow_sweep.standing.state import (
    FILE,
    LEFT_OUT,
    LOGS,
    MAIN_LOG,
    PLACES,
    State,
    boot,
    make_folder,
    note_left_out,
    sources,
)

ROLE = "graph"
"""Of the lock in the folder: held as long as the graph is there."""

GRAPH_ID = 8
"""Digits of the namespace of a standing graph. A run has 16: the two never have the same name."""

SMALL = ("x.count=8", "y.count=8", "periods=20")
"""The sweep for which the kernel is loaded before the nodes are started: they share what is loaded."""


def main() -> int:
    """Keep a graph until SIGTERM; the argument is a JSON object, see :func:`bow_sweep.standing.start.start`."""
    options = json.loads(sys.argv[1])
    setproctitle.setproctitle("bow graph")
    folder = Path(options["folder"])
    try:
        environment.clean()
        make_folder(folder)
        lock = take(folder, ROLE)
    except (GraphError, RunError, environment.EnvironmentProblem) as error:
        print_line(str(error))
        return FAILED
    try:
        return run_command(lambda: _keep_until_the_end(folder, options))
    finally:
        (folder / FILE).unlink(missing_ok=True)
        remove_places(folder / PLACES)
        os.close(lock)


def _keep_until_the_end(folder: Path, options: dict[str, Any]) -> int:
    try:
        _keep(folder, options)
    except (GraphError, OSError) as error:
        print_line(f"the graph ends: {error}")
        return FAILED
    except KeyboardInterrupt:
        print_line("the graph was told to end")
    return DONE


def print_line(text: str) -> None:
    """Print a line with the time to the log of the graph, which is the stdout of this process."""
    print(time.strftime("%Y-%m-%d %H:%M:%S "), text, flush=True)


def _keep(folder: Path, options: dict[str, Any]) -> None:
    """Start the nodes, watch them until the graph is not needed any more, and stop them."""
    namespace = f"/bow/{random_id()[:GRAPH_ID]}"
    places, root = str(folder / PLACES), options["root"]
    runs: dict[str, object] = {"places": places, "runs_dir": root}
    cells = [SPREAD]
    parameters: dict[str, dict[str, object]] = {
        "coordinator": {**runs, "dashboard": options["dashboard"]},
        "recorder": runs,
        "dashboard": {**runs, "inspect": cells},
        "simulator": {"inspect": cells},
    }
    remove_places(folder / PLACES)
    (folder / FILE).unlink(missing_ok=True)
    (folder / LEFT_OUT).unlink(missing_ok=True)
    _remove_logs(folder / LOGS)
    supervisor = Supervisor(namespace, folder / LOGS, parameters)
    state = State(
        pid=os.getpid(),
        started=start_of(os.getpid()) or 0,
        boot=boot(),
        since=time.time(),
        namespace=namespace,
        domain=os.environ.get("ROS_DOMAIN_ID", "").strip() or "0",
        version=importlib.metadata.version("bow"),
        sources=sources(),
        simulators=options["simulators"],
        dashboard=options["dashboard"],
        root=root,
        stations=options["stations"],
        network=options["network"],
    )
    stations = numbered(options["stations"])
    gc.disable()  # no garbage arises while modules are imported
    with Interrupts("stopping the processes; a few seconds") as interrupts:
        try:
            small = Sweep.from_spec("", SMALL)
            start_nodes(supervisor, small, options["simulators"], stations, options["dashboard"], interrupts)
            from bow_sweep.standing.watch import watch  # start_nodes has loaded ROS

            gc.enable()

            def ready() -> None:
                replace(state, since=time.time()).write(folder)
                print_line(f"the graph is ready, in {namespace} of domain {state.domain}")

            is_over = _has_lost_its_owner if options["owned"] else lambda: False
            watch(supervisor, print_line, interrupts, ready, partial(note_left_out, folder), is_over)
        finally:
            (folder / FILE).unlink(missing_ok=True)  # at once: nobody begins a run any more
            killed = supervisor.stop(idle=False)
            gc.enable()
            if killed:
                print_line(f"had to kill {', '.join(child.name for child in killed)}: no answer to SIGINT")


def _remove_logs(logs: Path) -> None:
    """Remove the logs of the graph before this one, so that they do not grow for ever."""
    for path in logs.glob("*.log"):
        if path.name != MAIN_LOG:
            path.unlink(missing_ok=True)


def _has_lost_its_owner() -> bool:
    """Return whether the process is gone that holds the other end of the pipe at our stdin, or has closed it."""
    readable, _, _ = select.select([0], [], [], 0)
    return bool(readable) and not os.read(0, 1)
