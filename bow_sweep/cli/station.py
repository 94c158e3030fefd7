"""The command `bow station`: joins a run with simulators, a recorder and a classifier of its own."""

from __future__ import annotations

import argparse
import os
import re
import shlex
import shutil
import socket
from pathlib import Path
from typing import Any

from bow_sim.graph import discovery
from bow_sim.protocol.stations import StationError, check_name
from bow_sweep.cli.sweep import add_no_sync, add_trust, bounded, cores
from bow_sweep.cli.terminal import environment_is_ready, fail, warn
from bow_sweep.processes.exit_status import DONE, FAILED, INTERRUPTED, USAGE
from bow_sweep.processes.new_directory import RUNS

STATION = """Join a run that is in progress, or a graph of `bow up` for all of its runs, here or on another machine, as
a station: simulators with a recorder and a classifier of their own. Their streams stay on this machine, in a bag of
their own; verdicts and receipts go to the coordinator of the run. A station may come and go: the run goes on without
it, and what it has not finished is computed by others. It ends with the run or the graph, or at Ctrl-C."""

RUN_ID, GRAPH_ID = re.compile(r"[a-f][0-9a-f]{15}"), re.compile(r"[a-f][0-9a-f]{7}")


def add_command(commands: Any) -> None:
    """Add the parser of `station`; its default `run` takes the parsed arguments."""
    parser = commands.add_parser(
        "station",
        help="join a run as a station: simulators with a recorder and a classifier of their own",
        formatter_class=argparse.RawDescriptionHelpFormatter,
        description=STATION,
        epilog="examples:\n"
        "  bow sweep fig11d --network SUBNET                       on the first machine; it prints the RUN_ID\n"
        "  bow station lab_2 --run RUN_ID --network SUBNET         on the second: one simulator a core\n"
        "  bow station half --run runs/fig11d-20260101-120000      a second station on the first machine\n"
        "  bow station lab_2 --run GRAPH_ID --network SUBNET       for all runs; `bow up --network` prints it\n\n"
        "The bag is in DIR/RUN_ID/bag/NAME. When the run is over, `bow collect` brings the bags together.\n\n"
        "exit status: 0 the run is over, 1 failed, 2 wrong usage, 130 interrupted",
    )
    parser.add_argument("name", metavar="NAME", help="of the station: lower-case letters, digits and _; one of a run")
    parser.add_argument(
        "--run",
        dest="joined",
        metavar="RUN",
        required=True,
        help="identity of the run, 16 hexadecimal digits, as `bow sweep --network` prints it; or its directory; or "
        "the graph of `bow up`, 8 digits",
    )
    parser.add_argument("--simulators", metavar="N", type=int, help="processes (default: one a core)")
    parser.add_argument(
        "--network",
        metavar="WHERE",
        default="",
        help="where the run's machine is: SUBNET, or its name or address (default: on this machine)",
    )
    add_trust(parser)
    parser.add_argument(
        "--out",
        metavar="DIR",
        type=Path,
        default=RUNS,
        help="directory in which RUN_ID/ is made (default: runs); a station that comes back goes on in it",
    )
    add_no_sync(parser)
    parser.add_argument(
        "--no-lock", action="store_true", help="for file systems without locks; see that no other process uses the bag"
    )
    parser.set_defaults(run=_station)


def _station(args: argparse.Namespace) -> int:
    simulators = cores() if args.simulators is None else args.simulators
    if simulators < 1:
        return fail(f"--simulators {args.simulators}: should be at least 1")
    if not environment_is_ready():
        return USAGE
    from bow_sweep.processes.run_graph import has_finished
    from bow_sweep.run.errors import RunError

    try:
        name, run_id = check_name(args.name), _identity(args.joined)
        if refusal := _of_standing_graph(run_id):
            return fail(f"--run {args.joined}: {refusal}")
        if args.network:
            os.environ.update(discovery.variables_for(args.network, args.trusted))
    except (StationError, RunError) as error:
        return fail(str(error))
    except discovery.NetworkError as error:
        return fail(f"--network {error}")
    if Path(args.joined).is_dir() and has_finished(Path(args.joined)):
        warn(f"{args.joined}: the run is over, there is nothing to join")
        return DONE
    most = bounded(simulators, cores())
    if most < simulators and args.simulators:
        warn(f"--simulators {simulators}: {most} are started, more do not start well here")
    return _join(args, name, run_id, most)


def _was_closed(bag: Path) -> bool:
    """Return whether the bag that a station has left says that the run was closed."""
    from bow_sim.protocol.states import PlanState
    from bow_sweep.record.bag import BagError, bag_files
    from bow_sweep.record.index_contents import IndexSurvey

    if not bag_files(bag):
        return False
    try:
        plan = IndexSurvey(bag).read().plan
    except (BagError, OSError):
        return False
    return bool(plan) and plan["state"] == PlanState.CLOSED


def _identity(run: str) -> str:
    """Return the identity of a run that is named by it, or by its directory.

    Raises
    ------
    RunError
        Where it is neither.
    """
    from bow_sweep.run.directory import RunError, read_ledger

    if RUN_ID.fullmatch(run) or GRAPH_ID.fullmatch(run):
        return run
    if not Path(run).is_dir():
        raise RunError(
            f"--run {run}: should be the identity of a run, 16 hexadecimal digits of which the first is a letter, "
            "or a run directory"
        )
    return str(read_ledger(Path(run))[0]["run_id"])


def _of_standing_graph(run_id: str) -> str:
    """Return what to join where the run is in the graph of `bow up`; "" otherwise."""
    from bow_sweep.processes.supervisor import GraphError
    from bow_sweep.run.places import find_place
    from bow_sweep.standing.state import PLACES, default_folder, read_state

    folder = default_folder()
    try:
        state = read_state(folder)
    except GraphError:
        return ""
    if state is None or find_place(folder / PLACES, run_id) is None:
        return ""
    graph = state.namespace.rpartition("/")[2]
    return f"this run is in the graph of `bow up`: a station joins that, for all of its runs, by --run {graph}"


def _join(args: argparse.Namespace, name: str, run_id: str, simulators: int) -> int:
    """Be the station until the run is over; leave no directory where nothing was recorded."""
    from bow_sweep.processes.progress import Display
    from bow_sweep.processes.station_graph import run_station
    from bow_sweep.processes.supervisor import GraphError
    from bow_sweep.record.bag import bag_files, bag_folder
    from bow_sweep.run.errors import RunError
    from bow_sweep.run.lock import locked

    directory = args.out.absolute() / run_id
    of, root = ("graph", args.out.absolute()) if GRAPH_ID.fullmatch(run_id) else ("run", None)
    display = Display()
    again = f"go on with: bow station {name} --run {shlex.quote(args.joined)}"
    new = not directory.exists()
    problem, status = "", DONE
    try:
        directory.mkdir(parents=True, exist_ok=True)
        with locked(directory, f"station-{name}", not args.no_lock):
            bag = bag_folder(directory.resolve(), name)
            where = root / "RUN_ID" / "bag" / name if root else bag
            display.print_line(f"station {name} of {of} {run_id}: {simulators} simulators -> {where}")
            run_station(
                bag.parent.parent,
                run_id,
                name,
                simulators=simulators,
                display=display,
                sync=not args.no_sync,
                lock=not args.no_lock,
                root=root,
                was_closed=root is None and _was_closed(bag),
            )
    except KeyboardInterrupt:
        problem, status = f"interrupted; the {of} goes on without station {name}; {again}", INTERRUPTED
    except GraphError as error:
        problem, status = f"{error}\n{again}", FAILED
    except (RunError, OSError) as error:
        problem, status = f"station {name}: {error}", FAILED
    display.stop()
    kept = bag_files(bag_folder(directory, name))
    if root:
        display.print_line(
            f"to bring what is recorded to its run: bow collect RUN {socket.gethostname()}:{root}/RUN_ID"
        )
    elif kept:
        here = Path(args.joined).is_dir()
        run, where = (args.joined, str(directory)) if here else ("RUN", f"{socket.gethostname()}:{directory}")
        display.print_line(
            f"recorded in {kept[0].parent}; to bring it to the run{'' if here else ', where that is'}: "
            f"bow collect {shlex.quote(run)} {shlex.quote(where)}"
        )
    elif new and status != DONE:
        shutil.rmtree(directory, ignore_errors=True)  # nothing but logs and locks of this start
    return fail(problem, status) if problem else DONE
