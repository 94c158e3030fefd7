"""Starts the process that keeps a standing graph, and stops it."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Mapping
from pathlib import Path
from types import MappingProxyType

from bow_sim.graph import discovery
from bow_sweep.processes.roles import CHILD
from bow_sweep.processes.supervisor import GraphError, tail
from bow_sweep.standing.state import LOGS, MAIN_LOG, State, make_folder, read_state

START_S = 600.0
"""A graph has this long until all its nodes are heard: a minute, and more where kernel and classifier
have to be compiled first, on a busy machine."""

STOP_S = 60.0
"""A graph has this long to stop in order; then its process is killed, and its children end with it."""

AFTER_KILL_S = 10.0

POLL_S, SAY_S = 0.05, 2.0


def start(
    folder: Path,
    *,
    simulators: int,
    root: Path,
    dashboard: bool = True,
    owned: bool = False,
    stations: int = 1,
    network: Mapping[str, str] = MappingProxyType({}),
    say: Callable[[str], None] = lambda _: None,
) -> tuple[State, subprocess.Popen[bytes]]:
    """Start a graph in the background, and wait until it is ready.

    The environment has to be checked before, see :mod:`bow_sim.graph.environment`.

    Parameters
    ----------
    folder
        Folder of the graph.
    simulators
        Number of simulator processes.
    root
        Directory of the runs of goals that have no place of their own.
    dashboard
        Whether there is a dashboard.
    owned
        The graph ends when this process ends, or closes the stdin of the graph's process.
    stations
        Number of stations among which the simulators are divided, see :mod:`bow_sim.protocol.stations`.
    network
        Variables that extend the graph to other machines, as :func:`bow_sim.graph.discovery.variables_for` gives them.
    say
        Takes a line for the user where it takes long.

    Returns
    -------
    state, process
        The graph, and the process that keeps it.

    Raises
    ------
    GraphError
        Where it cannot start.
    """
    if not network and discovery.goes_beyond(os.environ):
        given = (discovery.RANGE, discovery.PEERS, discovery.SERVER)
        names = " or ".join(name for name in given if os.environ.get(name))
        right = "unset it, or say so with bow up --network"
        raise GraphError(f"a standing graph is for this machine alone, and {names} extends it to others: {right}")
    make_folder(folder)
    log = folder / LOGS / MAIN_LOG
    options = {
        "folder": str(folder),
        "simulators": simulators,
        "root": str(root.absolute()),
        "dashboard": dashboard,
        "owned": owned,
        "stations": stations,
        "network": dict(network),
    }
    packages = str(Path(__file__).parents[2])
    with open(log, "wb") as output:
        process = subprocess.Popen(
            [sys.executable, "-c", CHILD, packages, "bow_sweep.standing.process", json.dumps(options)],
            stdin=subprocess.PIPE if owned else subprocess.DEVNULL,
            stdout=output,
            stderr=subprocess.STDOUT,
            env={**os.environ, **network, "PYTHONUNBUFFERED": "1"},
            cwd=folder,
            start_new_session=True,
        )
    began, said = time.monotonic(), False
    try:
        while True:
            state = read_state(folder)
            if state is not None and state.pid == process.pid:
                return state, process
            if process.poll() is not None:
                raise GraphError(f"the graph does not start (exit status {process.returncode}):\n{tail(log)}")
            waited = time.monotonic() - began
            if waited > START_S:
                raise GraphError(f"the graph is not ready after {START_S:g} s:\n{tail(log)}\nsee {log.parent}")
            if waited > SAY_S and not said:
                say(f"the graph starts; {START_S:g} s at most")
                said = True
            time.sleep(POLL_S)
    except BaseException:
        if process.poll() is None:
            process.terminate()
            _wait(lambda: process.poll() is not None, STOP_S)
            process.kill()
            process.wait()
        raise


def stop(state: State, say: Callable[[str], None] = lambda _: None) -> bool:
    """Stop a graph in order, and wait until its processes have ended.

    Returns
    -------
    bool
        Whether it ended in order; otherwise its process was killed.

    Raises
    ------
    GraphError
        Where its process cannot be stopped.
    """
    try:
        if state.is_alive:
            os.kill(state.pid, signal.SIGTERM)
        if _wait(lambda: not state.is_alive, STOP_S, lambda: say(f"the graph stops; {STOP_S:g} s at most")):
            return True
        os.kill(state.pid, signal.SIGKILL)
    except ProcessLookupError:
        return True
    except PermissionError:
        raise GraphError(f"process {state.pid} belongs to another user") from None
    if not _wait(lambda: not state.is_alive, AFTER_KILL_S):
        raise GraphError(f"process {state.pid} does not end after SIGKILL; it may wait for a disk")
    return False


def _wait(until: Callable[[], bool], seconds: float, long: Callable[[], None] = lambda: None) -> bool:
    """Wait until something holds; return whether it does. Call `long` once where it takes over two seconds."""
    began, said = time.monotonic(), False
    while not until():
        waited = time.monotonic() - began
        if waited > seconds:
            return False
        if waited > SAY_S and not said:
            said = True
            long()
        time.sleep(POLL_S)
    return True
