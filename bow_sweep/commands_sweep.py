"""The command `bow sweep`: one sweep, or the several of a campaign."""

from __future__ import annotations

import argparse
import json
import os
import shlex
import sys
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from bow_sim import reach
from bow_sim.identity import random_id
from bow_sim.model import MODELS, ParameterError
from bow_sim.taps import embed_files

from .campaign import FILE, Campaign, campaigns, report
from .plan import Sweep, presets

DONE, FAILED, USAGE, QUARANTINED, INTERRUPTED = 0, 1, 2, 3, 130
"""Exit statuses."""


def fail(message: str, status: int = USAGE) -> int:
    """Say what is wrong and return the exit status."""
    print(f"bow: {message}", file=sys.stderr)
    return status


def _cores() -> int:
    return len(os.sched_getaffinity(0))


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
    parser.add_argument("--simulators", metavar="N", type=int, default=_cores(), help="processes (default: one a core)")
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
        "--port", metavar="P", type=int, default=0, help="serve the dashboard to `rerun --connect` on P"
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
    from .run import RunError

    if args.simulators < 1:
        return fail(f"--simulators {args.simulators}: should be at least 1")
    if args.network:
        try:
            os.environ.update(reach.asked(args.network))
        except reach.ReachError as error:
            return fail(f"--network {error}")
    short = [f"{key}={getattr(args, name)}" for name, key in _SHORT.items() if getattr(args, name) is not None]
    if args.resume and (args.preset or short or args.settings or args.out):
        return fail("--resume takes the sweep from the run directory; give no preset, setting or --out with it")
    campaign = None
    try:
        if args.resume:
            directory = args.resume.resolve()
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
            directory = (args.out or Path("runs") / f"{name}-{time.strftime('%Y%m%d-%H%M%S')}").resolve()
            problem = _directory_problem(directory)
            if problem:
                return fail(problem)
            jobs = {preset: replace(job, directory=directory / preset) for preset, job in jobs.items()}
            if campaign:
                campaign.begin(directory)
    except (ParameterError, RunError) as error:
        return fail(str(error))
    status = _run(args, directory, list(jobs.values()))
    if status != DONE:
        return status
    if campaign:
        return _conclude(campaign, directory)
    print(("" if jobs else "nothing to do: every block of this run is done or quarantined\n\n") + _summary(directory))
    return QUARANTINED if _report(directory)["cells"]["quarantined"] else DONE


def _resumed(directory: Path, locks: bool) -> dict[str, _Job]:
    """Return what is left to do of a run: it, or nothing; says what was found in ledger and bag."""
    from .resume import prepare

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


def _directory_problem(directory: Path) -> str:
    """Return why a new run cannot go into `directory`, or ""; makes it."""
    if directory.exists() and not directory.is_dir():
        return f"--out {directory}: is a file; should be a directory that is new or empty"
    try:
        if directory.is_dir() and any(directory.iterdir()):
            return f"--out {directory}: is not empty; choose a new one, or go on with --resume {directory}"
        directory.mkdir(parents=True, exist_ok=True)
        probe = directory / ".writable"
        probe.touch()
        probe.unlink()
    except OSError as error:
        return f"--out {directory}: cannot be written: {error.strerror}"
    return ""


def _run(args: argparse.Namespace, directory: Path, jobs: Sequence[_Job]) -> int:
    """Carry out runs, one after the other, on one display."""
    from .conduct import conduct
    from .display import Display
    from .supervisor import GraphError

    display = Display()
    dashboard = None if args.no_dashboard else {"view": args.view, "port": args.port}
    again = f"go on with: bow sweep --resume {shlex.quote(str(directory))}"
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
            if reach.goes_beyond(os.environ):
                display.say(f"other machines join with: {reach.joining(f'/bow/{job.run_id}', os.environ)}")
            job.directory.mkdir(exist_ok=True)
            options = {"simulators": args.simulators, "dashboard": dashboard, "display": display}
            options |= {"sync": not args.no_sync, "lock": not args.no_lock}
            conduct(job.directory, job.run_id, job.sweep, resume=job.resume, **options)
            problem = _self_check(job, display.say)
            if problem:
                display.stop()
                return fail(problem, FAILED)
            before += job.sweep.budget
    except KeyboardInterrupt:
        display.stop()
        return fail(f"interrupted; nothing is lost, {again}", INTERRUPTED)
    except GraphError as error:
        display.stop()
        return fail(f"{error}\n{again}", FAILED)
    display.stop()
    return DONE


SAID_S = 2.0
"""A self-check that takes longer is mentioned."""


def _self_check(job: _Job, say: Callable[[str], None]) -> str:
    """Hold bag, ledger, map and report of a finished run against each other; return what does not agree, or "".

    By index, without reading every byte; a run that was gone on with is read whole, as nobody knows what befell it.
    """
    from .record.verify import verify

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


def _conclude(campaign: Campaign, directory: Path) -> int:
    """Report on a finished campaign, and draw the figure that it makes."""
    from .commands_paper import draw_maps
    from .view.maps import MapFileError

    found = report(directory, campaign)
    drawn = False
    if campaign.figure:
        try:
            draw_maps(campaign.figure, [directory / preset for preset in campaign.presets], directory / "maps.png")
            drawn = True
        except MapFileError as error:  # the settings make it another one
            print(f"bow: no picture of figure {campaign.figure}: {error}", file=sys.stderr)
    print(f"{campaign.title}\n")
    for preset, run in found["runs"].items():
        length = run["median_transient_periods"]
        print(
            f"  {preset:10} Helmholtz motion in {run['helmholtz_fraction']:.3f} of {run['cells']['planned']} cells"
            + (f", median transient {length:g} periods" if length else "")
        )
    cells = found["cells"]
    print(
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


def _summary(directory: Path) -> str:
    report = _report(directory)
    cells = report["cells"]
    regimes = ", ".join(f"{name.replace('_', ' ')} {count}" for name, count in report["regimes"].items() if count)
    predicted = report.get("cells_predicted", 0)
    whole = f"the map, of which {predicted} cells are predicted" if predicted else "them"
    lines = [
        f"{cells['done']} of {cells['planned']} cells in {report['wall_seconds']:.1f} s; "
        f"Helmholtz motion in {report['helmholtz_fraction']:.3f} of {whole}",
        f"at the last test: {regimes}",
        "",
        f"{directory}/",
        "  map.png         the basin map, to look at",
        "  map.npz         the same as arrays",
        f"  dashboard.rrd   rerun {shlex.quote(str(directory / 'dashboard.rrd'))}",
        "  bag/            every sample, rosbag2/MCAP: ros2 bag play, rosbags, Foxglove, rerun",
        "  report.json     accounts, versions, parameters",
        "",
        f"check it: bow verify {shlex.quote(str(directory))}",
    ]
    for block, why in report["quarantined_blocks"].items():
        lines.insert(2, f"QUARANTINED block {block}: {why}")
    return "\n".join(lines)
