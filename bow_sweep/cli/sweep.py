"""The command `bow sweep`: one sweep, or the several of a campaign."""

from __future__ import annotations

import argparse
import contextlib
import json
import os
import shlex
import sys
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from bow_sim.graph import discovery, environment
from bow_sim.physics.errors import ParameterError
from bow_sim.physics.parameters import MODELS
from bow_sim.physics.reflection_text import embed_files
from bow_sim.protocol.identity import random_id
from bow_sweep.plan.sweep import Sweep, presets
from bow_sweep.run.campaign import FILE, Campaign, campaigns, report
from bow_sweep.view.wanted import Wanted, WantedError, wanted

if TYPE_CHECKING:
    from bow_sweep.processes.new_directory import Claim

DONE, FAILED, USAGE, QUARANTINED, INTERRUPTED = 0, 1, 2, 3, 130
"""Exit statuses."""


def fail(message: str, status: int = USAGE) -> int:
    """Say what is wrong and return the exit status."""
    warn(message)
    return status


def warn(message: str) -> None:
    """Say what people should know."""
    with contextlib.suppress(OSError):  # nobody reads it
        print(f"bow: {message}", file=sys.stderr)


def settled() -> bool:
    """Return whether a graph can start in this environment; says why not, or what is ignored."""
    try:
        ignored = environment.settle()
    except environment.EnvironmentProblem as error:
        fail(str(error))
        return False
    if ignored:
        warn(ignored)
    return True


def tell(text: str) -> None:
    """Print what there is to say of a finished sweep; where that cannot be, only words are lost."""
    try:
        print(text, flush=True)
    except OSError as error:
        environment.silence("stdout")
        warn(f"the sweep is done, but standard output: {error.strerror}")


MOST_A_CORE = 8
"""Simulators that start well on a core. More take each other's time until they hear each other, and compute no faster:
of 64 on two cores none began within minutes."""

MOST = 64
"""Simulators of one graph on one machine: each hears every other node."""


def _cores() -> int:
    return len(os.sched_getaffinity(0))


def bounded(simulators: int, cores: int) -> int:
    """Return how many simulators are started where so many are asked for."""
    return min(simulators, MOST_A_CORE * cores, MOST)


def add_command(commands: Any) -> None:
    """Add the parser of `sweep`; its default `run` takes the arguments."""
    names, more = (
        "\n".join(f"  {name:16} {title}" for name, title in listed.items()) for listed in (presets(), campaigns())
    )
    parser = commands.add_parser(
        "sweep",
        help="run a sweep on this machine, recorded and classified",
        formatter_class=argparse.RawDescriptionHelpFormatter,
        description="Start the graph on this machine (loopback only, unless --network says else), run a sweep, and "
        "leave a run directory.",
        epilog=f"presets:\n{names}\n\ncampaigns, several sweeps one after the other:\n{more}\n\nexamples:\n"
        "  bow sweep fig11d                          the paper's Fig 11(d), 8192 cells\n"
        "  bow sweep fig11c --nx 32 --ny 16 --out small\n"
        "  bow sweep fig11d --set x.first=2 --set x.last=8 --set mu_s=0.9\n"
        "  bow sweep --resume small                  go on where a run was cut off\n"
        "  bow sweep fig11d --network SUBNET         says how simulators of other machines join\n\n"
        "exit status: 0 done, 1 failed, 2 wrong usage, 3 done but for quarantined blocks, 130 interrupted",
    )
    parser.add_argument("preset", nargs="?", default="", help="named sweep; without one, the defaults of the package")
    parser.add_argument("--model", help=f"one of {', '.join(MODELS)}")
    parser.add_argument("--v-mid", metavar="V", help="string speed where friction is midway, in v_b; below 1")
    parser.add_argument("--nx", metavar="N", help="cells along x (f_asym)")
    parser.add_argument("--ny", metavar="N", help="cells along y (f_init/f_asym)")
    parser.add_argument("--periods", metavar="N", help="length of each simulation, a multiple of 5")
    parser.add_argument("--adaptive", metavar="F", help="simulate at most this share of the cells, predict the others")
    parser.add_argument("--set", metavar="NAME=VALUE", action="append", default=[], dest="settings", help=SET_HELP)
    parser.add_argument(
        "--simulators",
        metavar="N",
        type=int,
        default=bounded(_cores(), _cores()),
        help="processes (default: one a core)",
    )
    parser.add_argument("--out", metavar="DIR", type=Path, help="run directory (default: runs/PRESET-DATE)")
    parser.add_argument("--resume", metavar="RUN", type=Path, help="go on with this run directory")
    parser.add_argument(
        "--network",
        metavar="WHERE",
        default="",
        help="let simulators of other machines join: SUBNET, or their names or addresses, separated by commas",
    )
    parser.add_argument("--view", action="store_true", help="open the rerun viewer and watch the map grow")
    parser.add_argument(
        "--port", metavar="P", default="0", help="serve the dashboard to `rerun --connect` on P of 127.0.0.1"
    )
    parser.add_argument("--no-dashboard", action="store_true", help="no dashboard node, no dashboard.rrd")
    parser.add_argument(
        "--no-sync", action="store_true", help="call blocks done before they are on the disk: who trusts the power"
    )
    parser.add_argument(
        "--no-lock", action="store_true", help="where the file system has no locks; see that nobody else is at work"
    )
    parser.set_defaults(run=_sweep)


SET_HELP = "any setting, repeatable; `bow settings` lists them; @FILE is a reflection function of your own"
_SAME = {name: name for name in ("model", "v_mid", "periods", "adaptive")}
_SHORT = {**_SAME, "nx": "x.count", "ny": "y.count"}


@dataclass(frozen=True)
class _Job:
    """One run that is to be made, or gone on with."""

    directory: Path
    run_id: str
    sweep: Sweep
    resume: bool = False


def _sweep(args: argparse.Namespace) -> int:
    from bow_sweep.processes.new_directory import claim, take_up
    from bow_sweep.run.directory import RunError

    if args.simulators < 1:
        return fail(f"--simulators {args.simulators}: should be at least 1")
    if not settled():
        return USAGE
    try:
        dashboard = wanted(args.view, args.port, args.no_dashboard)
    except WantedError as error:
        return fail(str(error))
    if args.network:
        try:
            os.environ.update(discovery.asked(args.network))
        except discovery.ReachError as error:
            return fail(f"--network {error}")
    short = [f"{key}={getattr(args, name)}" for name, key in _SHORT.items() if getattr(args, name) is not None]
    if args.resume and (args.preset or short or args.settings or args.out):
        return fail("--resume takes the sweep from the run directory; give no preset, setting or --out with it")
    campaign = None
    held: Claim | None = None
    try:
        if args.resume:
            held = take_up(args.resume.resolve(), not args.no_lock)
            directory = held.directory
            if (directory / FILE).exists():
                campaign = Campaign.in_directory(directory)
            locks = not args.no_lock
            jobs = _unfinished(campaign, directory, locks) if campaign else _resumed(directory, locks)
        else:
            settings = embed_files(short + args.settings)
            if args.preset in campaigns():
                campaign = Campaign.of(args.preset, settings)
                jobs = {preset: _Job(Path(preset), random_id(), sweep) for preset, sweep in campaign.sweeps().items()}
            else:
                jobs = {"": _Job(Path(), random_id(), Sweep.from_spec(args.preset, settings))}
            name = args.preset or jobs[""].sweep.parameters.model
            held = claim(args.out, name, not args.no_lock)
            directory = held.directory
            jobs = {preset: replace(job, directory=directory / preset) for preset, job in jobs.items()}
            if campaign:
                campaign.begin(directory)
    except (ParameterError, RunError, OSError) as error:
        if held is not None:
            held.release()
        return fail(str(error))
    most = bounded(args.simulators, _cores())
    if most < args.simulators:
        warn(f"--simulators {args.simulators}: {most} are started, more do not start well here")
        args.simulators = most
    left_out: list[Path] = []
    status = _run(args, held, list(jobs.values()), dashboard, left_out)
    if status != DONE:
        return status
    if campaign:
        return _conclude(campaign, directory, left_out)
    nothing = "" if jobs else "nothing to do: every block of this run is done or quarantined\n\n"
    tell(nothing + _summary(directory, left_out))
    return QUARANTINED if _report(directory)["cells"]["quarantined"] else DONE


def _resumed(directory: Path, locks: bool) -> dict[str, _Job]:
    """Return what is left to do of a run: it, or nothing; says what was found in ledger and bag."""
    from bow_sweep.coordinator.resume import prepare

    run = prepare(directory, lambda line: print(f"resume: {line}", flush=True), locks)
    return {} if run.complete else {"": _Job(directory, run.run_id, run.sweep, True)}


def _unfinished(campaign: Campaign, directory: Path, locks: bool) -> dict[str, _Job]:
    """Return what is left to do of a campaign that was cut off."""
    left: dict[str, _Job] = {}
    for preset, sweep in campaign.sweeps().items():
        run = directory / preset
        if not run.is_dir() or not (any(run.glob("ledger.jsonl*")) or any(run.glob("bag/*"))):
            left[preset] = _Job(run, random_id(), sweep)
        elif job := _resumed(run, locks).get(""):
            left[preset] = job
    return left


def _run(args: argparse.Namespace, held: Claim, jobs: Sequence[_Job], dashboard: Wanted, left_out: list[Path]) -> int:
    """Carry out runs on one display and let go of their directory; add the logs of what was left out."""
    from bow_sweep.processes.progress import Display
    from bow_sweep.processes.run_graph import conduct
    from bow_sweep.processes.supervisor import GraphError

    display = Display()
    for note in dashboard.notes:
        display.say(note)
    again = f"go on with: bow sweep --resume {shlex.quote(str(held.directory))}"
    unbegun = "no run was begun, and nothing is left of it: the same command can be given again"
    runs = [job.directory for job in jobs]
    total = sum(job.sweep.budget for job in jobs)
    before = 0
    if args.no_lock:
        display.say("the run directory is not locked: see that nobody else is at work on it")
    try:
        for number, job in enumerate(jobs, 1):
            p, x, y = job.sweep.parameters, job.sweep.x, job.sweep.y
            name = job.sweep.preset or "sweep"
            display.begin(f"{name} ({number} of {len(jobs)})" if len(jobs) > 1 else "", before, total)
            display.say(
                f"{name}: {p.model}, v_mid = {p.v_mid:g}, {x.count} x {y.count} cells, {p.periods} periods, "
                f"{args.simulators} simulators -> {job.directory}"
            )
            if discovery.goes_beyond(os.environ):
                display.say(f"other machines join with: {discovery.joining(f'/bow/{job.run_id}', os.environ)}")
            job.directory.mkdir(exist_ok=True)
            shown = None if left_out else dashboard.parameters  # one that could not live once is left out for good
            options = {"simulators": args.simulators, "dashboard": shown, "display": display}
            options |= {"sync": not args.no_sync, "lock": not args.no_lock}
            left_out += conduct(job.directory, job.run_id, job.sweep, resume=job.resume, **options)
            if problem := _self_check(job, display.say):
                display.stop()
                held.release(*runs)
                return fail(problem, FAILED)
            before += job.sweep.budget
    except KeyboardInterrupt:
        display.stop()
        begun = held.release(*runs)
        return fail(f"interrupted; {f'nothing is lost, {again}' if begun else unbegun}", INTERRUPTED)
    except (GraphError, OSError) as error:
        display.stop()
        return fail(f"{error}\n{again if held.release(*runs) else unbegun}", FAILED)
    display.stop()
    held.release(*runs)
    return DONE


SAID_S = 2.0
"""A self-check that takes longer is mentioned."""


def _self_check(job: _Job, say: Callable[[str], None]) -> str:
    """Hold bag, ledger, map and report of a finished run against each other; return what does not agree, or "".

    By index, without reading every byte; a run that was gone on with is read whole, as nobody knows what befell it.
    """
    from bow_sweep.record.verify import verify

    began = time.monotonic()
    result = verify(job.directory, judge=False, index=not job.resume)
    took = time.monotonic() - began
    if took > SAID_S:
        say(f"checking bag, ledger, map and report took {took:.1f} s")
    if result["ok"]:
        return ""
    lines = [
        ", ".join(
            [problem["what"], *(f"{name} {problem[name]}" for name in ("file", "block", "chunk") if name in problem)]
        )
        for problem in result["problems"][:SHOWN]
    ]
    run = shlex.quote(str(job.directory))
    return (
        f"the run does not hold, {result['problem_count']} problems:\n  " + "\n  ".join(lines) + "\n"
        f"all of them: bow verify {run}\nwhat is not whole is computed again by: bow sweep --resume {run}"
    )


SHOWN = 5
"""Problems of a self-check on the screen."""


def _conclude(campaign: Campaign, directory: Path, left_out: Sequence[Path] = ()) -> int:
    """Report on a finished campaign, and draw the figure that it makes."""
    from bow_sweep.cli.paper import draw_maps

    found = report(directory, campaign)
    drawn = False
    if campaign.figure:
        try:
            draw_maps(campaign.figure, [directory / preset for preset in campaign.presets], directory / "maps.png")
            drawn = True
        except Exception as error:  # MapFileError: the settings make it another one; else as write_results
            print(f"bow: no picture of figure {campaign.figure}: {error}", file=sys.stderr)
    tell("\n".join([campaign.title, *map(_left_out, left_out), ""]))
    for preset, run in found["runs"].items():
        length = run["median_transient_periods"]
        tell(
            f"  {preset:10} Helmholtz motion in {run['helmholtz_fraction']:.3f} of {run['cells']['planned']} cells"
            + (f", median transient {length:g} periods" if length else "")
        )
    cells = found["cells"]
    tell(
        f"\n{cells['done']} of {cells['planned']} cells, {cells['quarantined']} quarantined, "
        f"in {found['wall_seconds']:.1f} s\n\n{directory}/\n"
        + ("  maps.png        all maps, to look at\n" if drawn else "")
        + "  report.json     all accounts\n"
        f"  {', '.join(campaign.presets)}: a run directory each\n\n"
        f"check one: bow verify {shlex.quote(str(directory / campaign.presets[0]))}"
    )
    return QUARANTINED if cells["quarantined"] else DONE


def _report(directory: Path) -> dict[str, Any]:
    report: dict[str, Any] = json.loads((directory / "report.json").read_text())
    return report


FILES = {
    "map.png": "the basin map, to look at",
    "map.npz": "the same as arrays",
    "dashboard.rrd": "rerun {path}",
    "bag": "every sample, rosbag2/MCAP: ros2 bag play, rosbags, Foxglove, rerun",
    "report.json": "accounts, versions, parameters",
}
"""What a run directory has for people; pictures may be missing."""


def _left_out(log: Path) -> str:
    return f"without {log.stem} to its end: see {log}"


def _summary(directory: Path, left_out: Sequence[Path] = ()) -> str:
    report = _report(directory)
    cells = report["cells"]
    regimes = ", ".join(f"{name.replace('_', ' ')} {count}" for name, count in report["regimes"].items() if count)
    predicted = report.get("cells_predicted", 0)
    whole = f"the map, of which {predicted} cells are predicted" if predicted else "them"
    lines = [
        f"{cells['done']} of {cells['planned']} cells in {report['wall_seconds']:.1f} s; "
        f"Helmholtz motion in {report['helmholtz_fraction']:.3f} of {whole}",
        f"at the last test: {regimes}",
        *map(_left_out, left_out),
        "",
        f"{directory}/",
        *(
            f"  {name + '/' * (directory / name).is_dir():15} {what.format(path=shlex.quote(str(directory / name)))}"
            for name, what in FILES.items()
            if (directory / name).exists()
        ),
        "",
        f"check it: bow verify {shlex.quote(str(directory))}",
    ]
    for block, why in report["quarantined_blocks"].items():
        lines.insert(2, f"QUARANTINED block {block}: {why}")
    return "\n".join(lines)
