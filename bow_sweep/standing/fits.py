"""Whether a standing graph can serve a command, or the command needs a graph of its own."""

from __future__ import annotations

import importlib.metadata
import os
import time

from bow_sim.graph import discovery
from bow_sweep.standing.state import State, sources


def objection(
    state: State,
    *,
    simulators: int | None,
    dashboard: bool,
    watched: bool,
    sync: bool = True,
    lock: bool = True,
    stations: int = 1,
) -> str:
    """Return why a standing graph cannot serve a command, and what would do; "" where it can.

    Parameters
    ----------
    state
        The graph.
    simulators
        How many the user asks for; None for any number.
    dashboard
        Whether dashboard.rrd is wanted.
    watched
        Whether the user asks to see the sweep live.
    sync, lock
        Whether blocks are done only when they are on the disk, and whether run directories are locked.
    stations
        How many the user asks for; 1 for any number.
    """
    if state.version != importlib.metadata.version("bow") or state.sources != sources():
        return "the program has changed since it was started: bow down, bow up"
    domain = os.environ.get(discovery.DOMAIN, "").strip() or "0"
    if domain != state.domain:
        return f"it is in domain {state.domain}, {discovery.DOMAIN} is {domain} here"
    if discovery.goes_beyond(os.environ) and discovery.network_of(os.environ) != state.network:
        reach = "other machines than those that are asked for" if state.network else "this machine alone"
        return f"it is for {reach}; bow up --network says for which"
    if watched:
        return "it has no viewer: --view and --port need a graph of their own"
    if dashboard and not state.dashboard:
        return "it has no dashboard: --no-dashboard does without"
    if simulators not in (None, state.simulators):
        return f"it has {state.simulators} simulators, --simulators asks for {simulators}"
    if stations not in (1, state.stations):
        return f"it has {state.stations} stations, --stations asks for {stations}"
    if not sync:
        return "it brings every block to the disk: --no-sync needs a graph of its own"
    if not lock:
        return "it locks run directories: --no-lock needs a graph of its own"
    return ""


def since(state: State) -> str:
    """Return since when a graph is there, as text for people."""
    day = "" if time.time() - state.since < 12 * 3600 else "%Y-%m-%d "
    return time.strftime(f"{day}%H:%M", time.localtime(state.since))
