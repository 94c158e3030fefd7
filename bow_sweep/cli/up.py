"""The commands `bow up` and `bow down`: start and stop a standing graph."""

from __future__ import annotations

import argparse
import os
from pathlib import Path
from typing import Any

from bow_sim.graph import discovery
from bow_sweep.cli.sweep import add_trust, bounded, cores
from bow_sweep.cli.terminal import environment_is_ready, fail, warn
from bow_sweep.processes.exit_status import DONE, FAILED, USAGE
from bow_sweep.processes.new_directory import RUNS

UP = """Start a graph that stays in the background of this machine, until `bow down`. While it is there, `bow sweep`
uses it: a sweep then does without the seconds in which a graph of its own starts and ends. It survives the end of the
shell, listens on 127.0.0.1 only unless there is --network, and uses little CPU time while it waits. Each user has one
graph on a machine; several clients are served one after the other."""


def add_command(commands: Any) -> None:
    """Add the parsers of `up` and `down`; their defaults `run` take the parsed arguments."""
    parser = commands.add_parser(
        "up",
        help="start a graph that stays: sweeps are faster with it",
        formatter_class=argparse.RawDescriptionHelpFormatter,
        description=UP,
        epilog="examples:\n"
        "  bow up                                    one simulator a core\n"
        "  bow up --stations 4                       on a large machine: see docs, several machines\n"
        "  bow up --network SUBNET                   stations of other machines may join: it prints how\n"
        "  bow sweep fig11d --nx 64 --ny 32          uses the graph, in any directory\n"
        "  bow status                                what the graph does\n"
        "  bow down                                  stops it\n\n"
        "Files of the graph: ~/.local/state/bow, or $XDG_STATE_HOME/bow. ROS nodes reach it in its namespace, which\n"
        "`bow status` prints: ros2 action send_goal /bow/NAME/run_sweep bow_msgs/action/RunSweep ...\n\n"
        "exit status: 0 ready, 1 not started, 2 wrong usage",
    )
    parser.add_argument("--simulators", metavar="N", type=int, help="processes (default: one a core)")
    parser.add_argument(
        "--stations",
        metavar="N",
        type=int,
        default=1,
        help="divide the simulators among N stations, each with a recorder and a classifier of its own (default: 1)",
    )
    parser.add_argument(
        "--root",
        metavar="DIR",
        type=Path,
        default=RUNS,
        help="where the runs of goals go that other ROS nodes send (default: runs); `bow sweep --out` may be anywhere",
    )
    parser.add_argument(
        "--network",
        metavar="WHERE",
        default="",
        help="let stations of other machines join, for all runs: SUBNET, or their names or addresses. Others there can "
        "send goals too then (default: this machine alone)",
    )
    add_trust(parser)
    parser.add_argument(
        "--no-dashboard", action="store_true", help="no dashboard node; sweeps then need --no-dashboard too"
    )
    parser.set_defaults(run=_up)
    parser = commands.add_parser(
        "down",
        help="stop the graph of `bow up`",
        description="Stop the standing graph of this user in order; nothing of it is left. A run that is in progress "
        "can be resumed. Exit status: 0 there is no graph any more, 1 it does not end.",
    )
    parser.set_defaults(run=_down)


def _up(args: argparse.Namespace) -> int:
    if args.simulators is not None and args.simulators < 1:
        return fail(f"--simulators {args.simulators}: should be at least 1")
    wanted = args.simulators or cores()
    if not 1 <= args.stations <= wanted:
        return fail(f"--stations {args.stations}: should be 1 ... {wanted}, as each needs a simulator")
    if not environment_is_ready():
        return USAGE
    from bow_sweep.processes.supervisor import GraphError
    from bow_sweep.standing.fits import since
    from bow_sweep.standing.start import start
    from bow_sweep.standing.state import FILE, default_folder, read_state

    try:
        network = discovery.variables_for(args.network, args.trusted) if args.network else {}
    except discovery.NetworkError as error:
        return fail(f"--network {error}")
    number = bounded(wanted, cores())
    if number < wanted:
        warn(f"--simulators {wanted}: {number} are started, more do not start well here")
    folder = default_folder()
    try:
        state = read_state(folder)
        if state is not None:
            there = f"a graph is there already, process {state.pid}, since {since(state)}"
            return fail(f"{there}; bow status says what it does, bow down stops it", FAILED)
        if (folder / FILE).exists():
            warn("the last graph ended without `bow down`; what it left is removed")
        state, _ = start(
            folder,
            simulators=number,
            root=args.root,
            dashboard=not args.no_dashboard,
            stations=min(args.stations, number),
            network=network,
            say=warn,
        )
    except GraphError as error:
        return fail(str(error), FAILED)
    shown = "a dashboard" if state.dashboard else "no dashboard"
    divided = f" in {state.stations} stations" if state.stations > 1 else ""
    print(
        f"the graph is ready: process {state.pid}, {state.simulators} simulators{divided}, {shown}, "
        f"in {state.namespace}"
    )
    if network:
        command = discovery.station_command(state.namespace.rpartition("/")[2], {**os.environ, **network})
        print(f"stations of other machines join with: {command}")
    print("bow sweep uses it; bow status says what it does; bow down stops it")
    return DONE


def _down(args: argparse.Namespace) -> int:
    from bow_sweep.processes.supervisor import GraphError
    from bow_sweep.standing.start import stop
    from bow_sweep.standing.state import FILE, default_folder, read_state

    folder = default_folder()
    try:
        state = read_state(folder)
        if state is None:
            left = folder / FILE
            old = left.exists()
            left.unlink(missing_ok=True)
            print("there is no graph" + ("; the state file of one that is gone is removed" if old else ""))
            return DONE
        if stop(state, warn):
            print("the graph has ended")
        else:
            (folder / FILE).unlink(missing_ok=True)
            warn(f"process {state.pid} did not stop in order and was killed; its nodes end with it")
    except GraphError as error:
        return fail(str(error), FAILED)
    return DONE
