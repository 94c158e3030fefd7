"""The command `bow status`: what a standing graph is and does."""

from __future__ import annotations

import argparse
import json
import time
from typing import TYPE_CHECKING, Any

from bow_sweep.cli.terminal import environment_is_ready, fail, width
from bow_sweep.processes.exit_status import DONE, FAILED, USAGE

if TYPE_CHECKING:
    from bow_sweep.standing.client import Graph

HEARD_S = 4.0
"""Nodes have this long to be heard; each sends a heartbeat a second."""


def add_command(commands: Any) -> None:
    """Add the parser of `status`; its default `run` takes the parsed arguments."""
    parser = commands.add_parser(
        "status",
        help="what the graph of `bow up` is and does",
        description="Say whether there is a standing graph, since when, what its nodes do and how much memory they "
        "use, which run is in progress, and which clients wait.",
        epilog="exit status: 0 all its nodes are heard, 1 there is no graph, or a node of it is not heard",
    )
    parser.add_argument("--json", action="store_true", help="print all that as JSON")
    parser.set_defaults(run=_status)


def _status(args: argparse.Namespace) -> int:
    if not environment_is_ready():
        return USAGE
    from bow_sweep.processes.supervisor import GraphError
    from bow_sweep.standing.client import connect
    from bow_sweep.standing.state import FILE, default_folder, read_state

    folder = default_folder()
    try:
        if read_state(folder) is None:
            old = "; a state file is left of one that ended without `bow down`" if (folder / FILE).exists() else ""
            if args.json:
                print(json.dumps({"graph": None, "nodes": [], "run": None, "clients": []}, indent=2))
                return FAILED
            return fail(f"there is no graph{old}; bow up starts one", FAILED)
        with connect(folder) as graph:
            found = _look(graph)
    except GraphError as error:
        return fail(str(error), FAILED)
    print(json.dumps(found, indent=2) if args.json else _table(found))
    return FAILED if found["missing"] else DONE


def _look(graph: Graph) -> dict[str, Any]:
    """Listen until all nodes are heard; return what there is."""
    from dataclasses import asdict

    from bow_sim.protocol.states import NodeState
    from bow_sweep.run.places import find_place
    from bow_sweep.standing.fits import objection
    from bow_sweep.standing.state import PLACES, TURNS
    from bow_sweep.standing.turns import tickets

    state = graph.state
    wanted = {"coordinator": 1, "recorder": state.stations, "classifier": state.stations, "simulator": state.simulators}
    if state.dashboard:
        wanted["dashboard"] = 1

    def missing() -> list[str]:
        roles = [node.role for node in graph.nodes.values()]
        return [role for role, number in wanted.items() if roles.count(role) < number]

    deadline = time.monotonic() + HEARD_S
    while missing() and time.monotonic() < deadline:
        graph.spin()
    coordinator = graph.coordinator
    run = coordinator.run_id if coordinator is not None else ""
    place = find_place(graph.folder / PLACES, run)
    return {
        "graph": {**asdict(state), "folder": str(graph.folder)},
        "fits": objection(state, simulators=None, dashboard=False, watched=False),
        "nodes": [
            {
                "name": node.node.removeprefix(f"{state.namespace}/"),
                "role": node.role,
                "process": node.pid,
                "state": NodeState(node.state).name,
                "memory_bytes": node.rss,
                "run_id": node.run_id,
                "detail": node.detail,
            }
            for node in sorted(graph.nodes.values(), key=lambda node: node.node)
            if node.role in wanted
        ],
        "missing": missing(),
        "run": {"run_id": run, "directory": str(place.directory) if place else f"{state.root}/{run}"} if run else None,
        "clients": [{"process": t.pid, "directory": t.directory} for t in tickets(graph.folder / TURNS)],
    }


def _table(found: dict[str, Any]) -> str:
    """Return what there is as lines for people."""
    graph = found["graph"]
    since = time.strftime("%Y-%m-%d %H:%M:%S", time.localtime(graph["since"]))
    lines = [
        f"graph since {since}: process {graph['pid']}, namespace {graph['namespace']}, domain {graph['domain']}, "
        f"bow {graph['version']}",
        f"logs: {graph['folder']}/log",
    ]
    if found["fits"]:
        lines.append(f"bow sweep does not use it: {found['fits']}")
    run = found["run"]
    lines.append(f"run {run['run_id']} -> {run['directory']}" if run else "no run is in progress")
    for number, client in enumerate(found["clients"]):
        what = "is served" if not number else "waits"
        lines.append(f"client: process {client['process']} {what} -> {client['directory']}")
    longest = max([14, *(len(node["name"]) for node in found["nodes"])])
    lines += ["", f"{'node':{longest}} {'process':>8} {'state':9} {'memory':>8}  "]
    for node in found["nodes"]:
        name, state, memory = node["name"], node["state"].lower(), node["memory_bytes"] / 1e6
        what = f"{name:{longest}} {node['process']:8d} {state:9} {memory:5.0f} MB  {node['detail']}"
        lines.append(what[: width()])
    lines += [f"{role}: not heard for {HEARD_S:g} s" for role in found["missing"]]
    return "\n".join(lines)
