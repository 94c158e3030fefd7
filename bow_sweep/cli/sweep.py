"""The command `bow sweep`: runs one sweep, or all sweeps of a campaign, which is a study over presets."""

from __future__ import annotations

import argparse
import contextlib
import os
import shlex
import shutil
import time
from collections.abc import Iterator
from contextlib import nullcontext
from pathlib import Path
from typing import TYPE_CHECKING, Any

from bow_sim.graph import discovery
from bow_sim.graph.exposure import TRUST
from bow_sim.graph.leaving import close_all
from bow_sim.physics.errors import ParameterError
from bow_sim.physics.parameters import MODELS
from bow_sim.physics.reflection_text import embed_files
from bow_sweep.cli.settings import SET_HELP
from bow_sweep.cli.study_report import print_study
from bow_sweep.cli.sweep_report import RunCheck, print_run
from bow_sweep.cli.terminal import environment_is_ready, fail, warn
from bow_sweep.plan.preset_files import choose
from bow_sweep.plan.presets import presets
from bow_sweep.processes.exit_status import DONE, FAILED, INTERRUPTED, QUARANTINED, USAGE
from bow_sweep.study.campaigns import campaigns
from bow_sweep.view.wanted import Wanted, WantedError, wanted

if TYPE_CHECKING:
    from bow_sweep.cli.sweep_jobs import Work
    from bow_sweep.processes.progress import Display, Progress
    from bow_sweep.standing.client import Graph
    from bow_sweep.view.viewer import Screen

MOST_A_CORE = 8
"""Simulators started for each core at most. More slow each other down until they are connected, and compute no faster:
of 64 on two cores none began within minutes."""

MOST = 64
"""Simulators of one graph on one machine at most: each of them receives the heartbeats of all others."""


def cores() -> int:
    """Return the number of cores that this process may use."""
    return len(os.sched_getaffinity(0))


def bounded(simulators: int, on: int) -> int:
    """Return how many of the requested simulators are started on a machine with this number of cores."""
    return min(simulators, MOST_A_CORE * on, MOST)


def add_trust(parser: argparse.ArgumentParser) -> None:
    """Add the option that lets `--network` reach public addresses."""
    parser.add_argument(
        TRUST, dest="trusted", action="store_true", help="--network also with public addresses: DDS does not encrypt"
    )


def add_no_sync(parser: argparse.ArgumentParser) -> None:
    """Add the option that does without waiting for the disk."""
    parser.add_argument(
        "--no-sync", action="store_true", help="call blocks done before they are on the disk: a power cut may lose some"
    )


def add_command(commands: Any) -> None:
    """Add the parser of `sweep`; its default `run` takes the parsed arguments."""
    names, more = (
        "\n".join(f"  {name:16} {title}" for name, title in listed.items()) for listed in (presets(), campaigns())
    )
    parser = commands.add_parser(
        "sweep",
        help="run a sweep on this machine, recorded and classified",
        formatter_class=argparse.RawDescriptionHelpFormatter,
        description="Start the graph on this machine (loopback only, unless --network is given), run a sweep, and "
        "write a run directory. Where `bow up` has started a graph that fits, the sweep uses that.",
        epilog=f"presets:\n{names}\n\ncampaigns, several sweeps one after the other:\n{more}\n\nexamples:\n"
        "  bow sweep fig11d                          the paper's Fig 11(d), 8192 cells\n"
        "  bow sweep fig11c --nx 32 --ny 16 --out small\n"
        "  bow sweep fig11d --set x.first=2 --set x.last=8 --set mu_s=0.9\n"
        "  bow sweep fig11d --set x=stiffness_b --set y=mu_s         any two parameters, with ranges of their own\n"
        "  bow sweep fig11d --set x=model --set y=beta --set y.values=[0.08,0.1,0.2]   all values of an axis\n"
        "  bow sweep fig11c --nx 32 --ny 16 --set repeats=8          each cell again, forces up to 1 % off\n"
        "  bow sweep fig11d --record verdicts        a small bag: waveforms are computed again when asked for\n"
        "  bow sweep fig11d --set mu_s=0.9 --save-preset mine.yaml      then: bow sweep mine\n"
        "  bow sweep --resume small                  continue a run that was interrupted\n"
        "  bow sweep fig11d --network SUBNET         prints how simulators of other machines join\n"
        "  bow sweep fig11d --simulators 16 --stations 4      on a large machine: see docs, several machines\n\n"
        "exit status: 0 done, 1 failed, 2 wrong usage, 3 done but for quarantined blocks, 130 interrupted",
    )
    parser.add_argument(
        "preset",
        nargs="?",
        default="",
        help="named sweep, or a .yaml file; a name is searched in ./, in ~/.config/bow/presets and in the package; "
        "without one, the defaults of the package",
    )
    parser.add_argument("--model", help=f"one of {', '.join(MODELS)}")
    parser.add_argument("--v-mid", metavar="V", help="string speed where friction is midway, in v_b; below 1")
    parser.add_argument("--nx", metavar="N", help="cells along x (f_asym)")
    parser.add_argument("--ny", metavar="N", help="cells along y (f_init/f_asym)")
    parser.add_argument("--periods", metavar="N", help="length of each simulation, a multiple of 5")
    parser.add_argument("--adaptive", metavar="F", help="simulate at most this share of the cells, predict the others")
    parser.add_argument(
        "--record",
        metavar="WHAT",
        help="what the bag holds beside the verdicts: all streams (the default), last (those of the last five periods) "
        "or verdicts (none); what is left out can be computed again to the bit, and `bow verify` proves it",
    )
    parser.add_argument("--set", metavar="NAME=VALUE", action="append", default=[], dest="settings", help=SET_HELP)
    parser.add_argument(
        "--simulators",
        metavar="N",
        type=int,
        help="processes (default: one a core)",
    )
    parser.add_argument(
        "--stations",
        metavar="N",
        type=int,
        default=1,
        help="divide the simulators among N recorders and N classifiers, each with a bag of its own: for machines on "
        "which one of each is not enough (more than two or three simulators)",
    )
    parser.add_argument(
        "--own-graph", action="store_true", help="start a graph for this sweep, even if `bow up` has started one"
    )
    parser.add_argument("--out", metavar="DIR", type=Path, help="run directory (default: runs/PRESET-DATE)")
    parser.add_argument(
        "--save-preset", metavar="FILE", type=Path, help="write this sweep to a .yaml file, then run it"
    )
    parser.add_argument("--resume", metavar="RUN", type=Path, help="continue the run in this directory")
    parser.add_argument(
        "--lost",
        metavar="NAME",
        action="append",
        default=[],
        help="with --resume: the bag of this station is lost, compute its blocks again; repeatable",
    )
    parser.add_argument(
        "--network",
        metavar="WHERE",
        default="",
        help="let simulators of other machines join: SUBNET, or their names or addresses, separated by commas",
    )
    add_trust(parser)
    parser.add_argument("--view", action="store_true", help="open the rerun viewer and watch the map grow")
    parser.add_argument(
        "--port", metavar="P", default="0", help="serve the dashboard to `rerun --connect` on P of 127.0.0.1"
    )
    parser.add_argument("--no-dashboard", action="store_true", help="no dashboard node, no dashboard.rrd")
    add_no_sync(parser)
    parser.add_argument(
        "--no-lock",
        action="store_true",
        help="for file systems without locks; see that no other process uses the run",
    )
    parser.set_defaults(run=_sweep)


_SAME = {name: name for name in ("model", "v_mid", "periods", "adaptive", "record")}
_SHORT = {**_SAME, "nx": "x.count", "ny": "y.count"}
"""Option -> the setting that it gives."""


def _sweep(args: argparse.Namespace) -> int:
    args.asked_simulators = args.simulators
    args.simulators = cores() if args.simulators is None else args.simulators
    if args.simulators < 1:
        return fail(f"--simulators {args.simulators}: should be at least 1")
    if not 1 <= args.stations <= args.simulators:
        return fail(f"--stations {args.stations}: should be 1 ... {args.simulators}, as each needs a simulator")
    if not environment_is_ready():
        return USAGE
    try:
        dashboard = wanted(args.view, args.port, args.no_dashboard)
    except WantedError as error:
        return fail(str(error))
    if args.network:
        try:
            os.environ.update(discovery.variables_for(args.network, args.trusted))
        except discovery.NetworkError as error:
            return fail(f"--network {error}")
    short = [f"{key}={getattr(args, name)}" for name, key in _SHORT.items() if getattr(args, name) is not None]
    if args.resume and (args.preset or short or args.settings or args.out or args.save_preset):
        return fail("--resume takes the sweep from the run directory; give no preset, setting or --out with it")
    if args.lost and not args.resume:
        return fail("--lost: says of a run that is resumed which bags are lost; give --resume RUN with it")
    from bow_sweep.cli.sweep_jobs import begin, resume
    from bow_sweep.run.directory import RunError

    try:
        if args.resume:
            work = resume(args.resume.resolve(), not args.no_lock, args.lost)
        else:
            chosen = choose(args.preset, campaigns())
            if chosen.path:
                print(f"preset {chosen.label}: from {chosen.path}", flush=True)
            settings = embed_files([*chosen.settings, *short, *args.settings])
            work = begin(chosen, settings, args.out, not args.no_lock, args.save_preset)
    except (ParameterError, RunError, OSError) as error:
        return fail(str(error))
    most = bounded(args.simulators, cores())
    if most < args.simulators:
        if args.asked_simulators:
            warn(f"--simulators {args.simulators}: {most} are started, more do not start well here")
        args.simulators, args.stations = most, min(args.stations, most)
    from bow_sweep.view.viewer import Screen

    # Before all else: a window needs a second to appear, and viewers connect from the beginning on.
    screen = Screen.open(dashboard.window, dashboard.port) if work.jobs else Screen()
    try:
        return _run_and_report(args, work, dashboard, screen)
    finally:
        screen.close(warn)


def _run_and_report(args: argparse.Namespace, work: Work, dashboard: Wanted, screen: Screen) -> int:
    left_out: list[Path] = []
    status = run_jobs(args, work, dashboard, screen, left_out)
    if status != DONE:
        return status
    if work.study:
        quarantined = print_study(work.study, work.owned.directory, left_out)
    else:
        quarantined = print_run(work.owned.directory, left_out, nothing_to_do=not work.jobs)
    return QUARANTINED if quarantined else DONE


def run_jobs(
    args: argparse.Namespace, work: Work, dashboard: Wanted, screen: Screen, left_out: list[Path], command: str = ""
) -> int:
    """Make the runs with one display, and release their directory; append the logs of processes that were left out.

    Parameters
    ----------
    args
        With `simulators`, `no_sync` and `no_lock`; perhaps with `own_graph`, and with `asked_simulators`, the number
        that the user gave.
    command
        With which the user goes on after an interruption; "" for that of a resumed sweep.
    """
    from bow_sweep.processes.progress import Display
    from bow_sweep.processes.run_graph import run_graph
    from bow_sweep.processes.supervisor import GraphError
    from bow_sweep.run.errors import RunError

    owned, jobs = work.owned, work.jobs
    display = Display()
    for note in (*dashboard.notes, *screen.notes):
        display.print_line(note)
    again = f"go on with: {command or f'bow sweep --resume {shlex.quote(str(owned.directory))}'}"
    unbegun = "no run was begun, and nothing is left of it: the same command can be given again"
    runs = [job.directory for job in jobs]
    total = sum(job.sweep.budget for job in jobs)
    before = 0

    def show(progress: Progress | None, waiting: str) -> None:
        display.show(progress, waiting, time.monotonic())

    if args.no_lock:
        display.print_line("the run directory is not locked: make sure that no other process is at work on it")
    try:
        with _lasting_graph(args, work, dashboard, screen, display) if jobs else nullcontext() as graph:
            for number, job in enumerate(jobs, 1):
                p, x, y = job.sweep.parameters, job.sweep.x, job.sweep.y
                name = job.sweep.preset or (job.directory.name if len(jobs) > 1 else "sweep")
                display.begin(f"{name} ({number} of {len(jobs)})" if len(jobs) > 1 else "", before, total)
                repeats = job.sweep.repeats.count
                repeated = f" and {repeats} repeats of each" if repeats else ""
                display.print_line(
                    f"{name}: {p.model}, v_mid = {p.v_mid:g}, {x.count} x {y.count} cells{repeated}, "
                    f"{p.periods} periods, {graph.state.simulators if graph else args.simulators} simulators -> "
                    f"{job.directory}"
                )
                for note in job.sweep.notes:
                    display.print_line(f"note: {note}")
                if graph is None and discovery.goes_beyond(os.environ):
                    display.print_line(
                        f"other machines join with: {discovery.join_command(f'/bow/{job.run_id}', os.environ)}"
                    )
                    display.print_line(
                        "or, with a recorder and a classifier of their own: "
                        f"{discovery.station_command(job.run_id, os.environ)}"
                    )
                job.directory.mkdir(exist_ok=True)
                shown = dashboard.dashboard and not left_out  # one that failed once would fail again
                check = RunCheck(job.directory, display.print_line, whole=job.resume)
                if graph is not None:
                    directory, resume = job.directory, job.resume
                    graph.run(job.sweep, directory, job.run_id, progress=show, resume=resume, dashboard=shown)
                    left_out += _newly_left_out(graph, owned.directory, left_out, display)
                    problem = check.end()
                else:
                    close_all(FAILED, again)  # the node of the run before
                    without, problem = run_graph(
                        job.directory,
                        job.run_id,
                        job.sweep,
                        resume=job.resume,
                        simulators=args.simulators,
                        dashboard=shown,
                        display=display,
                        screen=screen,
                        sync=not args.no_sync,
                        lock=not args.no_lock,
                        stations=getattr(args, "stations", 1),
                        check=check,
                    )
                    left_out += without
                if problem:
                    display.stop()
                    owned.release(*runs)
                    return fail(problem, FAILED)
                before += job.sweep.budget
    except KeyboardInterrupt:
        display.stop()
        begun = owned.release(*runs)
        return fail(f"interrupted; {f'nothing is lost, {again}' if begun else unbegun}", INTERRUPTED)
    except (GraphError, RunError, OSError) as error:
        display.stop()
        return fail(f"{error}\n{again if owned.release(*runs) else unbegun}", FAILED)
    display.stop()
    owned.release(*runs)
    return DONE


def _newly_left_out(graph: Graph, directory: Path, known: list[Path], display: Display) -> list[Path]:
    """Say which nodes a graph goes on without, and return their logs, copied to where the runs are."""
    from bow_sweep.processes.run_graph import LOGS
    from bow_sweep.standing.state import left_out

    logs = []
    for name, (why, log) in left_out(graph.folder).items():
        kept = directory / LOGS / log.name
        if kept not in known:
            kept.parent.mkdir(exist_ok=True)
            with contextlib.suppress(OSError):  # the graph has ended, or the disk is full
                shutil.copyfile(log, kept)
            display.print_line(f"the sweep goes on without {name} ({why}); see {kept}")
            logs.append(kept)
    return logs


@contextlib.contextmanager
def _lasting_graph(
    args: argparse.Namespace, work: Work, dashboard: Wanted, screen: Screen, display: Display
) -> Iterator[Graph | None]:
    """Yield a graph that lasts for all runs; None where each of them needs a graph of its own.

    It is the graph of `bow up` if it is there and fits, else, for several runs, one that ends with them.
    """
    from bow_sweep.standing.client import connect, private_graph
    from bow_sweep.standing.fits import objection, since
    from bow_sweep.standing.state import default_folder, read_state

    stations = getattr(args, "stations", 1)
    divided = stations > 1
    state = None if getattr(args, "own_graph", False) else read_state(default_folder())
    asked, watched = getattr(args, "asked_simulators", None), bool(screen.uri)
    sync, lock = not args.no_sync, not args.no_lock
    if state is not None:
        shown = dashboard.dashboard
        problem = objection(
            state, simulators=asked, dashboard=shown, watched=watched, sync=sync, lock=lock, stations=stations
        )
        if problem:
            display.print_line(f"the graph of `bow up` is not used, {problem}")
            state = None
    if state is None:
        if len(work.jobs) < 2 or watched or divided or not (sync and lock) or discovery.goes_beyond(os.environ):
            yield None
            return
        drawn, root = dashboard.dashboard, work.owned.directory
        with private_graph(args.simulators, root, dashboard=drawn, say=display.print_line) as graph:
            yield graph
        return
    display.print_line(f"uses the graph of `bow up`, there since {since(state)}; --own-graph does without it")
    with connect() as graph:
        yield graph
